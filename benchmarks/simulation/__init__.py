"""Check the simulation against its targets: `python -m benchmarks.simulation`."""
