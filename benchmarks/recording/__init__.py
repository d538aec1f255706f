"""Simulated drives for the commands of `predictor`: training samples, data sets, and scores.

`training_drives` makes the samples of `predictor.drives` and `predictor.train`, `data_sets` the
frames of `predictor.dataset`, and `drive_scores` the scores of `predictor.evaluate`. `replay`
drives without prediction and repeats a drive with another LIDAR, for samples and for scores.
`own_buildings` reads a user's own maps and logs. These modules are not in `predictor`, since they
use the simulator and the planner.
"""
