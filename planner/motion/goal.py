"""Distances to the goal at which the planner treats it as reached.

A drive ends within `foresee.mapping.conventions.GOAL_RADIUS` of the goal. Each distance differs
from it for a reason of its own.
"""

PATH_GOAL_RADIUS = 0.3
"""Distance from the goal within which a path must pass to lead to it [m]. It is the smallest one:
the car tracks a path with some error, and the search uses cells of 0.1 to 0.2 m."""
PLAN_GOAL_RADIUS = 0.4
"""Distance from the goal within which a plan or a smooth line must come to reach it [m]. It is
0.1 m less than the goal's radius, so that a plan that is improved in the next tick still ends the
drive."""
STOP_GOAL_RADIUS = 0.7
"""Distance from the goal within which a plan's end counts as a stop for the goal, and not for an
obstacle [m]. Plans may come to rest a little before the goal's radius."""
ONWARD_GOAL_RADIUS = 0.8
"""Distance from the goal within which the car need not be able to go on from a plan's end [m]. The
drive ends in the next ticks, before the car would have to go on."""
