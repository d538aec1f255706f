"""How the planner drives: `stuck` drives, weaving (`weave`), and how far it relies (`sweeps`)."""
