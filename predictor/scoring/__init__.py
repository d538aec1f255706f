"""Scores of predictions on unobserved cells, and the similarity of images (SSIM)."""
