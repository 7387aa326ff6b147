"""Run one of the attacks: `python -m lab.attacks NAME ...`."""

import sys
from importlib import import_module

ATTACKS = ("delay", "faults", "files", "forgery", "hold")
"""Modules of this package that have a `main`."""


def main() -> None:
    """Run the attack that is named by the first argument."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in ATTACKS:
        print(f"attack '{name}'; allowed are {', '.join(ATTACKS)}", file=sys.stderr)
        sys.exit(2)
    import_module(f"lab.attacks.{name}").main(sys.argv[2:])


if __name__ == "__main__":
    main()
