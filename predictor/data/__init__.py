"""Data sets: frames of simulated drives and of real logs, and samples to learn from.

In the order of the data:

- `laser_log`: the scans of a real robot, and the pose of each.
- `carmen`: reads such a log from a text of the CARMEN toolkit.
- `bags`: reads such a log from a bag of ROS; `bag_config` names its topics.
- `transforms`: gives the poses in a bag.
- `log_files`: tells which files are such logs, and reads each with its reader.
- `survey`: makes the map of a log, and its frames with this map as truth.
- `frame_set`: records the frames of a drive or a log, and writes them into a data set.
- `frames`: reads the frames of a data set.
- `packed_samples`: writes and reads samples, packed.
- `samples`, `frontier_samples`: the samples of drives, and those of frontiers.
- `mcap_file`: writes scans, maps and predictions of a drive as a bag, which Foxglove shows in the
  layout of `foxglove_layout`.
- `squares`: codes of the observed and the true map, in frames and samples alike.
"""

from pathlib import Path

SIMULATED, PHYSICAL = Path("data/simulated"), Path("data/physical")
"""Default folders of the two data sets of `predictor.dataset`."""
CARMEN = (".log", ".clf", ".carmen")
"""Endings of CARMEN logs, before .gz."""
BAGS = (".bag", ".mcap", ".db3")
"""Endings of ROS bags; a bag of ROS 2 may also be a folder."""
PACKED = (".gz", ".bz2", ".lz4", ".xz", ".zst", ".zstd", ".zip")
"""Endings of compressed files."""
LOG_FORMATS = (
    f"CARMEN ({', '.join(CARMEN)}, also compressed: .gz), "
    f"ROS ({', '.join(BAGS)}, or the folder of a ROS 2 bag)"
)
"""The formats of logs, as messages name them."""
