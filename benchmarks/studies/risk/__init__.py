"""Requested against realised risk, and speed against collisions.

`series` lists the series of drives, `drives` makes them, `contact_test` tests them for contacts
independently of planner and simulator, `recalibration` repeats calibrations on them, `report`
evaluates them, and `tables` and `figures` present the results.
"""
