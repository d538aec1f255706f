"""The settings, drives, results and statistics of a comparison.

- `settings`: the options and the arms.
- `tasks`, `drive`, `drive_result`: building, start and goal of an episode; one drive; its measures.
- `trace`: the arrays of a drive.
- `store`, `saved_run`: an unfinished run on disk, and a finished one.
- `statistics`, `summary`, `overview`: intervals, the table of a run, and that of several runs.
- `time_optimal`: the time-optimal drives of tasks, see `benchmarks.optimal`, and their file.
- `drive_file`: drives that other commands than the comparison add to a file one by one.
"""
