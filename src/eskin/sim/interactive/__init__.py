"""This package simulates touches without end, computed while they are played."""
