"""Risk: ask the predictor, and turn its answer into a risk map and a cost map."""
