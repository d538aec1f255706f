"""Tests of robustness: drives with hostile predictors, and interruptions of commands.

- `hostile_predictors`: predictors that predict falsely, answer late, or raise.
- `hostile_drives`: drives with each of them, for `attack`.
- `interruptions`: commands interrupted at random moments, for `interrupt`.
"""
