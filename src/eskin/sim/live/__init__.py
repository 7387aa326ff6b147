"""Simulated touches without end, made while they are played."""
