"""Tests of how statements are written: one a line, and no tuple starred to fit a line.

Code that is only checked by its length is packed to be short. Two values may share a
statement where a reader thinks of them together: a swap, coordinates, limits. Errors
end with what is allowed, unless a remedy says more than that it is to be given.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from helpers.source import MODULES, name_module, parse_module

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "lab", "plugins", "ros2", "examples", "tests")
TOGETHER = (
    {"x", "y"},
    {"x", "y", "z"},
    {"u", "v"},
    {"i", "j"},
    {"row", "column"},
    {"rows", "columns"},
    {"width", "height"},
    {"low", "high"},
    {"lower", "upper"},
    {"start", "end"},
    {"begin", "end"},
    {"first", "last"},
    {"left", "right"},
)
"""Names of coordinates and of limits that one statement may assign."""
MOST = 0.01
"""Greatest share of all assignments that are packed."""
PLAIN = re.compile(
    r"(change|correct|give|take|name) (it|them|one|those|the name|the path)"
)
"""Remedies that say nothing after a list of what is allowed."""


@cache
def parse_all() -> tuple[tuple[str, ast.AST], ...]:
    """Return every node of the Python files of the project, with its file."""
    return tuple(
        (str(path.relative_to(ROOT)), node)
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Assign | ast.Call | ast.Tuple | ast.List | ast.Constant)
    )


def is_packed(node: ast.AST) -> bool:
    """Tell whether a statement assigns several values to as many targets."""
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Tuple | ast.List)
        and any(isinstance(each, ast.Tuple | ast.List) for each in node.targets)
    )


def may_pack(node: ast.Assign) -> bool:
    """Tell whether the values belong together: a swap, coordinates or limits."""
    if len(node.targets) > 1:
        return False
    targets = [ast.unparse(each) for each in node.targets[0].elts]
    values = [ast.unparse(each) for each in node.value.elts]
    names = {text.rpartition(".")[2] for text in targets}
    return sorted(targets) == sorted(values) or names in TOGETHER


def find_starred(node: ast.AST) -> Iterator[ast.Starred]:
    """Yield the tuples that are written out and starred into a call or a display."""
    for each in getattr(node, "args", getattr(node, "elts", ())):
        if isinstance(each, ast.Starred):
            if isinstance(each.value, ast.Tuple | ast.List):
                yield each


def test_only_values_that_belong_together_share_a_statement():
    packed = [(path, node) for path, node in parse_all() if is_packed(node)]
    wrong = [
        f"{path}:{node.lineno}: {ast.unparse(node)}"
        for path, node in packed
        if not may_pack(node)
    ]
    assert not wrong
    count = sum(isinstance(node, ast.Assign) for _, node in parse_all())
    assert len(packed) <= MOST * count


def test_no_tuple_is_starred_where_it_is_written_out():
    wrong = [
        f"{path}:{each.lineno}: {ast.unparse(each)}"
        for path, node in parse_all()
        for each in find_starred(node)
    ]
    assert not wrong


def test_no_error_ends_in_a_remedy_that_says_nothing():
    texts = [
        (path, node.lineno, node.value)
        for path, node in parse_all()
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    wrong = [
        f"{path}:{line}: {text}"
        for path, line, text in texts
        if not path.startswith("tests") and PLAIN.fullmatch(text.rpartition("; ")[2])
    ]
    assert not wrong


def test_push_takes_the_next_scan_and_nothing_is_named_add():
    """Any other name tells what is taken, so that a call leads to one method."""
    functions = [
        (name_module(path), node)
        for path in MODULES
        for node in parse_module(path)
        if isinstance(node, ast.FunctionDef)
    ]
    assert not [
        (module, node.lineno) for module, node in functions if node.name == "add"
    ]
    taken = [
        (module, ast.unparse(node.args.args[1].annotation))
        for module, node in functions
        if node.name == "push"
    ]
    assert taken and {kind for _, kind in taken} <= {"Scan", "Scan | Reading"}, taken
