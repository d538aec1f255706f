"""Tests of robustness: drives with hostile predictors, and interruptions of commands."""
