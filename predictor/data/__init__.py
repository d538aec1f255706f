"""Data sets: frames of simulated drives and of real logs, and samples to learn from."""
