"""What the simulated world is held to: `python -m benchmarks.simulation`."""
