"""Constants that all parts share: control period, goal, and the sizes of cells and of the crop."""

TICK = 0.1
"""Control period: each control is applied for this long [s]. 10 Hz, as in Katyal et al. 2018."""
REST = 1e-6
"""Speed below which a car stands, and may change its gear [m/s]; braking may leave a little."""
GOAL_RADIUS = 0.5
"""Distance of the car's centre from the goal at which a drive ends, at any speed [m]."""
RESOLUTION = 0.05
"""Side of a cell of generated buildings, frames and samples [m]."""
START_MARGIN = 0.5
"""Margin around the body at the start in which cells count as observed free [m]."""
CROP_SIDE = 5.0
"""Side of the crop [m], the square around the car that the paper's networks expand."""
CROP_CELLS = round(CROP_SIDE / RESOLUTION)
"""Side of the crop [cells]."""
LONGEST_STOP = 35.0
"""Longest stopping distance of a car [m]: a drive's memory and time grow with its square."""
NOISE_CUT = 3.0
"""Largest noise of a range of the simulated LIDAR, in standard deviations: the error of a real one
has a bound, too."""
TIGHTEST = 4.0
"""Largest ratio of the half diagonal of a car's body to its turning radius."""
