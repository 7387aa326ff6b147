"""Count files and lines of each package, of the laboratory and tests, words of docs.

    python -m lab.rooms

The product is `src/eskin` without its leaves. Below the table are the words of pages
and their semicolons, and the lengths of the errors that `src` raises: of the text that
is written in them, without what they fill in.
"""

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lab.tables import format_head, format_row

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "eskin"
LEAVES = ("arms", "design", "exports", "labelling", "learn", "sets", "sim")


def count(paths: Iterable[Path]) -> tuple[int, int]:
    """Return the numbers of files and of lines."""
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return len(texts), sum(text.count("\n") for text in texts)


def count_words(pages: Iterable[Path]) -> tuple[int, int]:
    """Return the numbers of words and of semicolons of pages, without their code."""
    texts = [
        re.sub(r"```.*?```|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.S)
        for path in pages
    ]
    return sum(len(text.split()) for text in texts), sum(t.count(";") for t in texts)


def read_text(node: ast.AST) -> str:
    """Return the text that is written in an expression; empty if it is no text."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(map(read_text, node.values))
    if isinstance(node, ast.BinOp):
        return read_text(node.left) + read_text(node.right)
    return ""


def find_errors(paths: Iterable[Path]) -> Iterator[str]:
    """Yield the texts of the errors that modules raise."""
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                if node.exc.args and (text := read_text(node.exc.args[0])):
                    yield text


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
    print()
    for place in ("README.md", "docs", "lab/notes"):
        path = ROOT / place
        pages = [path] if path.is_file() else sorted(path.glob("*.md"))
        words, semicolons = count_words(pages)
        share = 1000 * semicolons / max(words, 1)
        print(f"{place}: {words:,} words, {share:.1f} semicolons in 1,000")
    lengths = [len(text) for text in find_errors(rows["src"])]
    middle, long = np.percentile(lengths, [50, 90])
    print(f"errors: {len(lengths)}, {middle:.0f} / {long:.0f} characters (p50 / p90)")


if __name__ == "__main__":
    main()
