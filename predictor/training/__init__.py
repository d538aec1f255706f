"""Training of networks: batches, steps, validation, checkpoints and weights.

`trainer.Trainer` is the training loop. `compact_training` trains the compact network, and
`image_training` trains the paper's networks, one by one or as a study in `parallel_trainings`.
"""
