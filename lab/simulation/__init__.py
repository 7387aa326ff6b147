"""Check the simulation against its targets: `python -m lab.simulation`."""
