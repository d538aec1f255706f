"""Mapping, the base of all packages: grids, scans, bodies, polylines, car limits, kernels."""
