"""Lower and upper bounds of the least time of a drive, with the whole map known.

`shortest_path` gives the lower bound T_bound. The time-optimal drive, which `search` finds from
`first_guesses` by solving the problem in `minimum_time`, gives the upper bound T_opt.
"""
