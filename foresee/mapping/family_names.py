"""Names of the families of generated buildings; `sim.families.generate` makes a building of one.

Append only: the position of a name is part of the random seed.
"""

FAMILIES = (
    "corridor",
    "narrow",
    "office",
    "trap",
    "paper",
    "floor_plan",
    "maze",
    "obstacle_field",
    "as_built",
)
