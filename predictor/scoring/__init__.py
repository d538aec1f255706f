"""Scoring: how good predictions are of what the car had not seen."""
