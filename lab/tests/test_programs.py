"""Tests of the programs of the laboratory: each is found by who looks for it."""

import re
from pathlib import Path

LAB = Path(__file__).parents[1]
ROOT = LAB.parent
PLACES = [
    *(ROOT / "docs").glob("*.md"),
    *(LAB / "notes").glob("*.md"),
    LAB / "README.md",
    ROOT / "Makefile",
    ROOT / ".ci" / "run",
]
"""Where a program may be named."""


def find_programs():
    """Return the programs by the names with which `python -m` starts them."""
    for path in sorted(LAB.rglob("*.py")):
        if '\nif __name__ == "__main__":' in path.read_text():
            parts = path.relative_to(ROOT).with_suffix("").parts
            yield ".".join(part for part in parts if part != "__main__")


def test_every_program_is_named_by_a_page_a_note_or_a_target():
    text = "\n".join(path.read_text() for path in PLACES)
    named = set(re.findall(r"\blab(?:\.\w+)+", text))
    assert [name for name in find_programs() if name not in named] == []


def test_every_program_of_the_readme_exists():
    row = re.compile(r"^\| `python -m (lab[.\w]*)", re.MULTILINE)
    assert set(row.findall((LAB / "README.md").read_text())) <= set(find_programs())
