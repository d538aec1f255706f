"""Runs: the settings, drives, results and statistics of a comparison."""
