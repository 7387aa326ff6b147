"""Measure what flaws of sensors do to touches, at rest and while touched."""
