"""This module holds the figures that the paper prints (arXiv 2506.18256)."""

ACCURACIES = {
    "paper": (96.1, 91.1),
    "cnn-lstm": (95.7, 80.4),
    "svm-max": (81.7, 82.8),
    "knn-max": (90.3, 61.5),
    "mlp-max": (92.6, 76.1),
}
"""Table II: accuracy on validation and on test [%], by our names of the methods."""

TIMES_MS = {
    "paper": 3.81,
    "cnn-lstm": 2.56,
    "svm-max": 737.67,
    "knn-max": 30.82,
    "mlp-max": 2.14,
}
"""Table III: time of one step [ms], likewise. It names no processor."""
