"""Times of the stages of the control cycle and of other libraries, and throughput.

`stage_times` times stages in drives, `beside` the cycle on the wall clock, `rates` and `throughput`
measure rates, and `peers…` and `hall` compare with other libraries. `sized_maps` makes maps and
poses for them, `measurements` keeps finished measurements in a folder, and `tables` makes the
tables.
"""
