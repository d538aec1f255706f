"""Simulated drives recorded as training samples, as frames of data sets, and as scores."""
