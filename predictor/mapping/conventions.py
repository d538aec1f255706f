"""Constants that the planner and the simulator share: control period and radius of the goal."""

TICK = 0.1
"""Control period: each control is applied for this long [s]. 10 Hz, as in Katyal et al. 2018."""
GOAL_RADIUS = 0.5
"""Distance of the car's centre from the goal at which a drive ends, at any speed [m]."""
