"""What prediction is worth: against baselines without a network, at the same certified risk.

`series` lists the series of drives, `report` evaluates them, and `tables` and `figures` present the
results.
"""
