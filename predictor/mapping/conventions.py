"""Conventions that the planner and the simulator share: the control period and the goal's size."""

TICK = 0.1
"""Control period: each control is applied for this long [s]. 10 Hz, as in Katyal et al. 2018."""
GOAL_RADIUS = 0.5
"""A drive ends as soon as the car's centre is this near to the goal, at any speed [m]."""
