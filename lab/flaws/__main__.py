"""Run one of the parts: `python -m lab.flaws PART ...`.

    python -m lab.flaws touches --builds 20 --minutes 3 --keep FILE
    python -m lab.flaws touches --builds 2 --minutes 1 --rows none "all typical"
    python -m lab.flaws rest --builds 3 --starts 3
    python -m lab.flaws real --sets shearsense

`touches` has untouched skins and touches for each flaw, `rest` hands that rest on a
skin, `real` untouched stretches of real recordings. `--help` after a part lists its
options.
"""

from lab.program import run_part

if __name__ == "__main__":
    run_part("lab.flaws", ("real", "rest", "touches"))
