"""Run one of the attacks: `python -m lab.attacks NAME ...`."""

from lab.program import run_part

if __name__ == "__main__":
    run_part("lab.attacks", ("claims", "delay", "faults", "files", "forgery", "hold"))
