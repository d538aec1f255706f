"""Registers the environments of Gymnasium; importing it is enough.

    import foresee.gym, gymnasium
    env = gymnasium.make("foresee/Corridor-v1")

The simulator is imported when the first environment is made.
"""

import gymnasium

SUITES = {
    "foresee/Corridor-v1": "corridor-v1",
    "foresee/Office-v1": "office-v1",
    "foresee/FloorPlans-v1": "floor-plans-v1",
    "foresee/Mixed-v1": "mixed-v1",
}
"""Environment → the suite of the race whose rules it has, see `sim.suite`."""

for _name, _suite in SUITES.items():
    gymnasium.register(_name, entry_point="sim.gym_env:DriveEnv", kwargs={"suite": _suite})
