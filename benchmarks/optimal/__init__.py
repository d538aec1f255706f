"""Lower and upper bounds of the least time of a drive, with the whole map known.

`shortest_way` gives the lower bound T_bound, `minimum_time` the upper bound T_opt, with
`first_guesses` for its solver.
"""
