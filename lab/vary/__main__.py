"""Run one of the parts: `python -m lab.vary PART ...`.

    python -m lab.vary make FOLDER             # simulate the worlds, once
    python -m lab.vary play FOLDER FOUND.jsonl # an hour; goes on where it stopped
    python -m lab.vary table FOUND.jsonl       # a row a number
    python -m lab.vary play FOLDER FOUND.jsonl --names FaultConfig.offset
    python -m lab.vary play LONGER MOVED.jsonl --moved FOUND.jsonl

`--help` after a part lists its options.
"""

from lab.program import run_part

if __name__ == "__main__":
    run_part("lab.vary", ("make", "play", "table"))
