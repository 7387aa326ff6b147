"""Units that more than one package converts between."""

NS_PER_S = 1_000_000_000
"""Nanoseconds in one second; stamps are in nanoseconds, durations in seconds."""
