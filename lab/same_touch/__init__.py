"""Touches whose counts are the same in two poses, where they mean other gestures."""
