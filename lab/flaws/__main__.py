"""Run one of the parts: `python -m lab.flaws PART ...`.

    python -m lab.flaws touches --builds 20 --minutes 3 --keep FILE
    python -m lab.flaws touches --builds 2 --minutes 1 --rows none "all typical"
    python -m lab.flaws rest --builds 3 --starts 3
    python -m lab.flaws real --sets shearsense

`touches` has untouched skins and touches for each flaw, `rest` hands that rest on a
skin, `real` untouched stretches of real recordings. `--help` after a part lists its
options.
"""

import sys
from importlib import import_module

PARTS = ("real", "rest", "touches")
"""Modules of this package that have a `main`."""


def main() -> None:
    """Run the part that is named by the first argument."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in PARTS:
        print(f"part '{name}'; allowed are {', '.join(PARTS)}", file=sys.stderr)
        sys.exit(2)
    import_module(f"lab.flaws.{name}").main(sys.argv[2:])


if __name__ == "__main__":
    main()
