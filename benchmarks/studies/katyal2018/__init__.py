"""The prediction study: scores of predictors on frames of simulated and of real drives.

The command is `python -m benchmarks.studies.katyal2018`. In the order of the data:

- `square`: the observed and the true square of a frame, prepared for scoring.
- `contestants`: the predictors that are compared, and their answers about a square.
- `stretch_scores`: the scores of contestants on some frames of a drive.
- `evaluation`: which drives are scored and by whom; fills the folder.
- `cost`: the size of each predictor, and the time of a prediction.
- `transients`: whether networks filter transient obstacles.
- `report`: the results of all these.
- `tables`: the results as Markdown.
- `pictures`: example squares, chosen by fixed rules.
- `figures`: the results and the examples as figures.
"""
