"""Walks of a new user: the tutorial, and an engineer with her own robot and matrix."""
