"""Planning on predicted maps: risk map, path, MPC, collision checker, last resort, navigator.

This module imports nothing, as casadi and ompl take a while to load, and not every user needs them.
"""
