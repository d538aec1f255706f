"""Motion: the car's dynamics, the paths that it follows, and the plans that it drives.

`path` holds paths, and their references for the MPC's cost; `goal` the distances at which the goal
counts as reached. `dynamics` is the model of the car, and a `plan` is a motion by this model.
`contact` finds where the body meets a blocked cell on a plan.
"""
