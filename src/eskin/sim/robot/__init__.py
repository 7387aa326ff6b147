"""The robot: its poses, how it moves, and what keeps clear of what."""
