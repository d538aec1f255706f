"""Training of networks: batches, steps, validation, checkpoints and weights."""
