"""Planning on predicted maps: risk map, path, MPC, collision checker, last resort, navigator.

Nothing is imported here: casadi and ompl take a while to load, and not all who come need them.
"""
