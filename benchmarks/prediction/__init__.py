"""The prediction study: predictors compared on frames of simulated and of real drives.

python -m benchmarks.prediction --help
"""
