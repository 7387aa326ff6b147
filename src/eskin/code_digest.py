"""This module computes a digest of code, by which kept results can be told stale."""

import ast
import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def digest_code(module: str) -> str:
    """Return a digest of a module and of all that it imports from eskin.

    A module of another package counts with what it imports from that package as well.
    Comments, docstrings and layout do not count, nor what is imported from elsewhere.
    Data files are not read.

    Args:
        module: dotted name, such as `eskin.learn.dataset`.

    Raises:
        ValueError: there is no such module.
    """
    digest = hashlib.sha256()
    for name in sorted(imported_modules(module)):
        digest.update(f"{name}\n{digest_source(name)}\n".encode())
    return digest.hexdigest()


def imported_modules(module: str) -> set[str]:
    """Return a module and those of its package and of eskin that it imports."""
    packages = {"eskin", module.split(".", 1)[0]}
    found, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            imports = direct_imports(name)
            waiting += [each for each in imports if each.split(".", 1)[0] in packages]
    return found


@cache
def direct_imports(module: str) -> tuple[str, ...]:
    """Return the modules that one imports itself, of packages whose code is found."""
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
    """Return the syntax tree of a module."""
    path = find_source(module)
    if path is None:
        raise ValueError(f"no module '{module}'; allowed are modules with Python code")
    return ast.parse(path.read_bytes())


def find_source(module: str) -> Path | None:
    """Return the file of a module; None if there is none."""
    first, *rest = module.split(".")
    place = find_top_level(first)
    if place is None:
        return None
    place = place.joinpath(*rest)
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return None


@cache
def find_top_level(name: str) -> Path | None:
    """Return the folder of a package, or the path of a module without its suffix."""
    spec = find_spec(name)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(spec.submodule_search_locations[0])
    origin = spec.origin if spec.has_location else None
    return Path(origin).with_suffix("") if origin else None
