"""Run one of the attacks: `python -m lab.attacks NAME ...`."""

from lab.program import run_part

PARTS = ("claims", "crush", "delay", "events", "faults", "files", "forgery", "hold")

if __name__ == "__main__":
    run_part("lab.attacks", PARTS)
