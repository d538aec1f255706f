"""The study of `benchmarks.risk`: requested against realised risk, and speed against collisions.

`cells` lists the groups of drives ("cells"), `drives` makes them, `geometry` tests them for
contacts independently of planner and simulator, `recalibration` repeats calibrations on them,
`report` and `figures` present them. `arcs` is for `benchmarks.sweeps`.
"""
