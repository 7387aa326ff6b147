"""This package learns from recordings: sets, training, scores (most needs torch)."""
