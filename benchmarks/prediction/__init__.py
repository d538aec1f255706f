"""The prediction study: scores of predictors on frames of simulated and of real drives.

python -m benchmarks.prediction --help
"""
