"""How the planner drives: `stuck` drives, weaving (`weave`), and how far it could rely (`sweeps`).

`arcs` computes the results of `sweeps`.
"""
