"""Distances to the goal at which the planner treats it as reached.

A drive ends within `GOAL_RADIUS` of the goal. Each distance differs from it for its own reason.
"""

PATH_REACHES = 0.3
"""A path that passes within this distance leads to the goal [m]. It is the strictest: the car
tracks a path with some error, and the path's cells are 0.1 to 0.2 m wide."""
PLAN_REACHES = 0.4
"""A plan, or a line, that comes this near reaches the goal [m]. It lies 0.1 m within the goal's
radius, so that a plan that is improved at the next tick still ends the drive."""
STOPS_FOR_GOAL = 0.7
"""A plan that ends this near stops because of the goal, not because of an obstacle [m]. Plans may
come to rest a little before the goal's radius."""
GOES_ON = 0.8
"""A plan that ends this near need not leave the car a way to go on [m]. The drive ends within the
next ticks, before the car would have to."""
