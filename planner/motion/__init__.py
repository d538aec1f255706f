"""Motion: the car's dynamics, the paths that it follows, and the plans that it drives.

`path` holds paths, and `goal` the distances at which the goal counts as reached. `dynamics` is the
model of the car, and a `plan` is a motion by this model.
"""
