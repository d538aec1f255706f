"""Training: what is learnt from, step by step, and what is kept of it."""
