"""Planner: from a LIDAR scan to a control, on the observed and predicted map.

`risk` decides which cells a plan may enter, `guide` plans a path to the goal, `mpc` plans motions
along it, and `safety` tests these plans and chooses one. `motion` holds what they share: the car's
dynamics, paths and plans. `navigator` calls all of them in each tick.

This module imports nothing, as casadi and ompl take a while to load, and not every user needs them.
"""
