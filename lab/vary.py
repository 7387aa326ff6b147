"""Halve and double each number of the belief and of the evidence; show what moves.

    python -m lab.front_ends make FOLDER --builds 1 --seconds 65 --touches 8
    python -m lab.vary FOLDER                          # hours
    python -m lab.vary FOLDER --names NOISE_SIGMAS noisy --workers 1

A copy of the sources with one number changed plays worlds of `lab.front_ends`. A row
gives the sums that differ from those of the numbers as they are, as `before -> after`;
of the faults one sum for all.
"""

import argparse
import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import eskin
from lab.tables import format_head, format_row

SOURCES = Path(eskin.__file__).parent
FILES = ("touch/belief_kernels.py", "touch/belief.py", "command/evidence.py")
Sums = dict[str, float]


def find_numbers(path: Path) -> Iterator[tuple[str, ast.Constant]]:
    """Find the named numbers of a module, and the defaults of its configurations."""
    tree = ast.parse(path.read_text("utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign):
            names, values = node.targets[0], node.value
            if isinstance(names, ast.Name):
                names, values = ast.Tuple([names]), ast.Tuple([values])
            if isinstance(names, ast.Tuple) and isinstance(values, ast.Tuple):
                for name, value in zip(names.elts, values.elts, strict=False):
                    if isinstance(name, ast.Name) and is_number(value):
                        yield name.id, value
        elif isinstance(node, ast.ClassDef) and node.name.endswith("Config"):
            for each in node.body:
                if isinstance(each, ast.AnnAssign) and is_number(each.value):
                    yield each.target.id, each.value


def is_number(node: ast.AST | None) -> bool:
    """Return whether a node is a number that is not far away on purpose."""
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def play(sources: Path, options: argparse.Namespace) -> Sums:
    """Play the worlds by some sources, and return the sums of all figures."""
    sums: Sums = {}
    for only in (["rest", "touch", "pats"], ["faults"]):
        out = sources / "found.json"
        command = [sys.executable, "-m", "lab.front_ends", "play"]
        command += [str(options.folder), str(out), "--workers", str(options.workers)]
        command += ["--only", *only, "--named", *options.named]
        command += ["--families", *options.families]
        paths = os.pathsep.join([str(sources), os.getcwd()])
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": paths})
        for key, figures in json.loads(out.read_text("utf-8")).items():
            row = key.split("|")[0] if "faults" not in only else "faults"
            for figure, value in figures.items():
                place = f"{row}: {figure}"
                sums[place] = sums.get(place, 0.0) + value
    return sums


def main() -> None:
    """Vary each number, and print a row a variant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--names", nargs="+", help="numbers to vary; all by default")
    named = ["floating row", "telegraph", "noisy"]
    parser.add_argument("--named", nargs="+", default=named, help="as of front_ends")
    families = ["divider", "capacitive"]
    parser.add_argument("--families", nargs="+", default=families)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        shutil.copytree(SOURCES, copy / "eskin")
        usual = play(copy, options)
        print(format_head(["number", "value", "what moves"]))
        for file in FILES:
            path = copy / "eskin" / file
            text = path.read_text("utf-8")
            for name, node in find_numbers(path):
                if options.names and name not in options.names:
                    continue
                for factor in (0.5, 2.0):
                    value = type(node.value)(node.value * factor)
                    lines = text.splitlines(keepends=True)
                    line = lines[node.lineno - 1]
                    start, end = node.col_offset, node.end_col_offset
                    lines[node.lineno - 1] = f"{line[:start]}{value!r}{line[end:]}"
                    path.write_text("".join(lines), "utf-8")
                    found = play(copy, options)
                    moved = [
                        f"{key} {usual[key]:.3g} -> {found[key]:.3g}"
                        for key in usual
                        if abs(found[key] - usual[key]) > 1e-9
                    ]
                    cells = [name, f"{value:g}", "; ".join(moved) or "nothing"]
                    print(format_row(cells), flush=True)
            path.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
