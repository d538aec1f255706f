"""Planning on predicted maps: the risk map, the path, the MPC, and the navigator.

Nothing is imported eagerly: casadi and ompl load where they are used.
"""
