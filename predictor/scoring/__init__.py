"""Scores of predictions on unobserved cells, and the similarity of images (SSIM).

- `scores`: scores of probabilities, by the distance of the cells beyond the frontier.
- `images`: the image of a prediction, and its similarity to that of the true map.
"""
