"""Motion: the car's dynamics, plans, paths, and what a moving body meets."""
