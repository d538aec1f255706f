"""The calibration of `benchmarks.calibrate`: the level of the last resort that belongs to a risk.

- `settings`: settings and options of a calibration.
- `learn_then_test`: drives at each level, from safe to bold, and tests it by betting on the
  collisions (`planner.risk.betting`).
- `together`: pools of calibrations, and joint certificates.
- `certificate`: the conditions that a calibration holds for, and the level that it certifies.
"""
