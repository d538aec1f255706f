"""The prediction study's evaluation: predictors on frames of simulated and of real drives.

python -m benchmarks.prediction --help
"""
