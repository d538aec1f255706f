"""Mapping: grids, scans, beams and bodies. It imports nothing else of this project."""
