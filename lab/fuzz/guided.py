"""Fuzz with mutations guided by coverage, by atheris (libFuzzer)."""

import random
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from lab.fuzz.run import LONGEST
from lab.fuzz.target import Target

STARTS = 200
"""Number of mutated inputs that the search starts from."""
LARGEST = 8192
"""Greatest size of an input [bytes]."""
READERS = [
    "eskin.command",
    "eskin.drivers",
    "eskin.recording",
    "eskin.skin",
    "cobs",
    "mcap",
    "yaml",
]


def guide(kind_of_target: Callable[[], type[Target]], inputs: int, seed: int) -> None:
    """Fuzz a target until there is a finding or enough inputs were read; then exit.

    Args:
        kind_of_target: function that imports and instruments the target and its reader.
        inputs: number of inputs.
        seed: seed of the mutations.
    """
    try:
        atheris = import_module("atheris")
    except ImportError:
        sys.exit("guided fuzzing needs atheris; pip install 'eskin[fuzz]'")
    with atheris.instrument_imports(include=READERS):
        kind = kind_of_target()
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    target = kind(folder)
    corpus = folder / "corpus"
    corpus.mkdir()
    for number in range(STARTS):
        start = target.make(random.Random(seed + number))[:LARGEST]
        (corpus / str(number)).write_bytes(start)
    options = {
        "runs": inputs,
        "seed": seed + 1,
        "max_len": LARGEST,
        "timeout": round(LONGEST),
        "artifact_prefix": f"{folder}/",
        "print_final_stats": 1,
    }
    arguments = [f"-{name}={value}" for name, value in options.items()]
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], target.feed)
    atheris.Fuzz()
