"""The modules of src/eskin as syntax trees, for the tests of the source itself."""

import ast
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "eskin"
MODULES = sorted(SOURCE.rglob("*.py"))


def name_module(path: Path) -> str:
    """Return the dotted name of a module."""
    return ".".join(("eskin", *path.relative_to(SOURCE).with_suffix("").parts))


@cache
def parse_module(path: Path) -> tuple[ast.AST, ...]:
    """Return the nodes of a module; the first is the module itself."""
    return tuple(ast.walk(ast.parse(path.read_text())))
