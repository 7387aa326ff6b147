"""Count files and lines of each package, of the laboratory and tests, words of docs.

    python -m lab.rooms

The product is `src/eskin` without its leaves.
"""

from collections.abc import Iterable
from pathlib import Path

from lab.tables import format_head, format_row

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "eskin"
LEAVES = ("arms", "design", "exports", "labelling", "learn", "sets", "sim")


def count(paths: Iterable[Path]) -> tuple[int, int]:
    """Return the numbers of files and of lines."""
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return len(texts), sum(text.count("\n") for text in texts)


def count_words(folder: Path) -> int:
    """Return the number of words of the pages in a folder."""
    return sum(len(path.read_text().split()) for path in folder.glob("*.md"))


def main() -> None:
    """Print a row for each package, then the sums."""
    packages = {path.name: path.rglob("*.py") for path in SOURCE.iterdir()}
    packages = {
        name: sorted(paths)
        for name, paths in sorted(packages.items())
        if (SOURCE / name / "__init__.py").is_file()
    }
    packages["root"] = sorted(SOURCE.glob("*.py"))
    product = [
        p for name, found in packages.items() if name not in LEAVES for p in found
    ]
    rows = {
        **packages,
        "product": product,
        "leaves": [path for name in LEAVES for path in packages[name]],
        "src": sorted(SOURCE.rglob("*.py")),
        "lab, with its tests": sorted((ROOT / "lab").rglob("*.py")),
        "tests": sorted((ROOT / "tests").rglob("*.py")),
    }
    print(format_head(("room", "files", "lines")))
    for name, paths in rows.items():
        files, lines = count(paths)
        print(format_row((name, str(files), f"{lines:,}")))
    words = {place: count_words(ROOT / place) for place in ("docs", "lab/notes")}
    print("\nwords: " + ", ".join(f"{place} {n:,}" for place, n in words.items()))


if __name__ == "__main__":
    main()
