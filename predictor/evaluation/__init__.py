"""The scores of `predictor.evaluate`: predictions compared with the truth along simulated drives.

- `settings`: settings and options of an evaluation.
- `scored_drive`: the scores of predictors along one drive, which is replayed for them.
- `drive_scores`: the scores of all drives, and their table.
- `trial`: short drives with a predictor, and what they say about its use.
- `replayed_log`: the predictions along the log of a real robot, written to an MCAP file.
"""
