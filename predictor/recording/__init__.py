"""Simulated drives for the commands of `predictor`: training samples and data sets.

- `settings`: settings and options of all recorded drives.
- `own_buildings`: reads a user's own maps and logs.
- `walk`: walks through buildings along the planner's routes.
- `rescan`: repeats a walk or drive with another LIDAR.
- `simulated_log`: simulates the log of a robot.
- `sample_set`: makes the files of samples in parallel, apart from other seeds.
- `training_drives`: the samples of `predictor.drives` and `predictor.train`, made with these four
  modules.
- `exploration`: the samples of `predictor.train_frontiers`, and where frontiers truly lead.
- `paper_drives`: the drives of the paper's simulated data set.
- `data_sets`: the frames of `predictor.dataset`, of these drives or of real logs.
"""
