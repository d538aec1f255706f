"""Names of the families of generated buildings; `sim.families.generate` draws them."""

FAMILIES = (
    "corridor",
    "narrow",
    "office",
    "trap",
    "paper",
    "floor_plan",
    "maze",
    "obstacle_field",
)
