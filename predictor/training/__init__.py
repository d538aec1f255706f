"""Training of networks: batches, steps, validation, checkpoints and weights.

For all networks:

- `settings`: settings that decide the weights.
- `checkpoint`: the state of a training on disk.
- `optimisation`: a step of an optimiser, and its learning rate.
- `trainer`: the training loop.

For the compact network:

- `compact_targets`: its batches and losses.
- `compact_training`: its training.
- `compact_comparison`: its scores before and after a fine-tuning.

For the network of frontiers:

- `frontier_training`: its training, losses and scores.

For the paper's networks:

- `image_options`: their options on the command line.
- `image_learner`: their initial weights, and one step, with or without an adversary.
- `image_validation`: their input and target images, validation, and the calibration of their greys.
- `image_training`: the training of one network.
- `parallel_trainings`: several trainings at a time, for `predictor.study`.
"""
