"""Robustness: hostile predictors, and commands that are interrupted."""
