"""Requested against realised risk, and speed against collisions.

`series` lists the series of drives, `drives` makes them, `report` evaluates them, and `tables` and
`figures` present the results.
"""
