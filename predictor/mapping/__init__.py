"""Mapping, the base of all packages: grids, scans, beams, bodies, car limits, compiled kernels."""
