"""The settings, drives, results and statistics of a comparison, and calibrations.

`settings` lists the options and arms, `drive` makes one drive, `drive_result` holds its measures,
`summary` aggregates them over all drives, `store` keeps an unfinished run on disk, and `saved_run`
reads a finished one.
"""
