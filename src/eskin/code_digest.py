"""This module computes a digest of code, by which kept results can be told stale."""

import ast
import hashlib
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent


@cache
def digest_code(module: str) -> str:
    """Return a digest of a module of eskin and of all that it imports from eskin.

    Comments, docstrings and layout do not count, nor what is imported from other
    packages. Data files are not read.

    Args:
        module: dotted name, such as `eskin.learn.dataset`.

    Raises:
        ValueError: there is no such module in eskin.
    """
    digest = hashlib.sha256()
    for name in sorted(imported_modules(module)):
        digest.update(f"{name}\n{digest_source(name)}\n".encode())
    return digest.hexdigest()


def imported_modules(module: str) -> set[str]:
    """Return a module and the modules of eskin that it imports, at any depth."""
    found, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += direct_imports(name)
    return found


@cache
def direct_imports(module: str) -> tuple[str, ...]:
    """Return the modules of eskin that one imports itself."""
    names = []
    for node in ast.walk(parse_module(module)):
        if isinstance(node, ast.ImportFrom) and node.module:
            # What is imported may be a module itself.
            names += [node.module, *(f"{node.module}.{n.name}" for n in node.names)]
        elif isinstance(node, ast.Import):
            names += [each.name for each in node.names]
    return tuple(name for name in names if find_source(name) is not None)


@cache
def digest_source(module: str) -> str:
    """Return a digest of one module without its docstrings."""
    tree = parse_module(module)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            kept = [statement for statement in body if not is_text(statement)]
            node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def is_text(statement: ast.AST) -> bool:
    """Tell whether a statement is nothing but a string."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def parse_module(module: str) -> ast.Module:
    """Return the syntax tree of a module of eskin."""
    path = find_source(module)
    if path is None:
        raise ValueError(f"no module '{module}'; allowed are modules of eskin")
    return ast.parse(path.read_bytes())


def find_source(module: str) -> Path | None:
    """Return the file of a module of eskin; None for any other name."""
    first, *rest = module.split(".")
    if first != "eskin":
        return None
    place = PACKAGE.joinpath(*rest)
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return None
