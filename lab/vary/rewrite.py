"""Copy the sources of eskin so that their tuned numbers can be changed while they run.

Numba compiles a constant into its code, which takes half a minute to compile. But it
reads a large global array where that lies. So in the copy each use of a number in a
function is an element of one such array, of which one element is changed to play a
variant. Code that refers to an address must not be kept on disk: see `keep_no_code`.
"""

import ast
import importlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, final

import numpy as np
from numba.core.caching import Cache

from lab.vary.numbers import Place, Sources

LENGTH = 200_000
"""Elements of the array; numba copies arrays of up to 1 MB into its code."""
ARRAY = "VARIED_VALUES"
"""Name of the array in the modules of the copy."""
COMPUTED = "computed from others"


@final
@dataclass(frozen=True, eq=False)
class Slots:
    """Elements of the array for the constants of some sources."""

    sources: Sources
    places: tuple[Place, ...]
    """Constants that have elements, in their order: one, or one each part."""

    @classmethod
    def build(cls, sources: Sources) -> "Slots":
        """Give elements to all tuned constants, and to those computed from them."""
        places = [
            place
            for place in sources.list_places()
            if place[1] not in sources.get(place[0]).defaults
            and sources.why_not_tuned(place) in ("", COMPUTED)
        ]
        return cls(sources, tuple(places))

    def find_first(self) -> dict[Place, int]:
        """Return the first element of each constant."""
        first = 0
        found = {}
        for place in self.places:
            found[place] = first
            value = self.sources.compute(place)
            first += len(value) if isinstance(value, tuple) else 1
        return found

    def compute(self, changed: Mapping[str, float]) -> list[float]:
        """Return the elements with some numbers changed, by their `Number.key`."""
        result: list[float] = []
        for place in self.places:
            value = self.sources.compute(place, changed)
            assert value is not None
            result += value if isinstance(value, tuple) else (value,)
        return result


@final
class FunctionRewriter(ast.NodeTransformer):
    """A rewriter replaces the constants that a module uses in functions by elements."""

    def __init__(self, slots: Slots, module: str) -> None:
        """Rewrite one module of the sources."""
        self.sources = slots.sources
        self.module = module
        self.first = slots.find_first()
        self.hidden: list[set[str]] = []

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:  # noqa: N802
        """Rewrite the body of a function, without names that are its own."""
        own = {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}
        own |= {
            each.id
            for each in ast.walk(node)
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
        }
        self.hidden.append(own)
        node.body = [self.visit(each) for each in node.body]
        self.hidden.pop()
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:  # noqa: N802
        """Replace the name of a constant."""
        if not self.hidden or any(node.id in own for own in self.hidden):
            return node
        place = self.sources.find(self.module, node.id)
        return self.build_value(place) if place in self.first else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:  # noqa: N802
        """Replace a field that is read from a record of constants."""
        place = self.sources.find_member(self.module, node) if self.hidden else None
        if place in self.first:
            return self.build_value(place)
        self.generic_visit(node)
        return node

    def build_value(self, place: Place) -> ast.expr:
        """Build the expression of the elements of a constant."""
        value = self.sources.compute(place)
        first = self.first[place]
        if isinstance(value, tuple):
            parts = [build_element(first + n, one) for n, one in enumerate(value)]
            return ast.Tuple(parts, ast.Load())
        assert value is not None
        return build_element(first, value)


def build_element(place: int, value: float) -> ast.expr:
    """Build the expression of an element, of the type that its number has."""
    kind = type(value).__name__
    return ast.parse(f"{kind}({ARRAY}[{place}])", mode="eval").body


@final
class NumberEditor(ast.NodeTransformer):
    """An editor writes changed numbers into the constants and defaults of a module."""

    def __init__(
        self, sources: Sources, module: str, changed: Mapping[str, float]
    ) -> None:
        """Edit one module; numbers are changed by their `Number.key`."""
        self.found: dict[ast.expr, ast.expr] = {}
        source = sources.get(module)
        for name, node in source.numbers.items():
            if any(key.split("[")[0] == f"{module}:{name}" for key in changed):
                value = sources.compute((module, name), changed)
                self.found[node] = ast.parse(repr(value), mode="eval").body

    def visit(self, node: ast.AST) -> ast.AST:
        """Replace an expression that has changed."""
        if isinstance(node, ast.expr) and node in self.found:
            return self.found[node]
        return self.generic_visit(node)


def write_copy(slots: Slots, target: Path) -> None:
    """Write a copy of eskin to a folder, whose numbers are elements of an array."""
    sources = slots.sources
    copy = copy_package(sources.folder, target)
    values = slots.compute({})
    lines = [
        '"""The numbers that are varied."""',
        "import numpy as np",
        f"VALUES = np.zeros({LENGTH})",
        f"VALUES[:{len(values)}] = {values!r}",
    ]
    (copy / "varied.py").write_text("\n".join(lines) + "\n", "utf-8")
    given = ast.parse(f"from eskin.varied import VALUES as {ARRAY}").body[0]
    for module in sources.modules:
        path = find_path(copy, module)
        tree = ast.parse(path.read_text("utf-8"))
        FunctionRewriter(slots, module).visit(tree)
        tree.body.insert(1, given)
        write_module(path, tree)


def write_edited(sources: Sources, changed: Mapping[str, float], target: Path) -> None:
    """Write a copy of eskin with numbers changed in its sources."""
    copy = copy_package(sources.folder, target)
    # Trees are changed in place, so those of the sources stay as they are.
    own = Sources(sources.folder)
    for module in own.modules:
        tree = own.get(module).tree
        edited = NumberEditor(own, module, changed)
        if edited.found:
            edited.visit(tree)
            write_module(find_path(copy, module), tree)


def copy_package(folder: Path, target: Path) -> Path:
    """Copy the package to a folder; return its place there."""
    copy = target / "eskin"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def find_path(package: Path, module: str) -> Path:
    """Return the file of a module."""
    return package.joinpath(*module.split(".")).with_suffix(".py")


def write_module(path: Path, tree: ast.Module) -> None:
    """Write a module."""
    path.write_text(ast.unparse(ast.fix_missing_locations(tree)) + "\n", "utf-8")


def keep_no_code() -> None:
    """Let numba neither keep compiled code on disk nor take it from there."""
    setattr(Cache, "load_overload", lambda *_: None)  # noqa: B010
    setattr(Cache, "save_overload", lambda *_: None)  # noqa: B010


def change_numbers(slots: Slots, changed: Mapping[str, float]) -> None:
    """Change numbers of the copy that is imported; all others are as they were."""
    values = importlib.import_module("eskin.varied").VALUES
    elements = slots.compute(changed)
    values[: len(elements)] = np.array(elements)
    for module in slots.sources.modules:
        forget_kept(importlib.import_module(f"eskin.{module}"))
        defaults: dict[str, dict[str, object]] = {}
        for name in slots.sources.get(module).defaults:
            value = slots.sources.compute((module, name), changed)
            if value is not None:
                kind, member = name.split(".")
                defaults.setdefault(kind, {})[member] = value
        for kind, given in defaults.items():
            set_defaults(
                getattr(importlib.import_module(f"eskin.{module}"), kind), given
            )


def set_defaults(kind: type, given: Mapping[str, object]) -> None:
    """Set the defaults of some fields of a dataclass."""
    start: Any = kind.__init__
    code = start.__code__
    usual = start.__defaults__ or ()
    names = code.co_varnames[: code.co_argcount][-len(usual) :]
    start.__defaults__ = tuple(
        given.get(name, value) for name, value in zip(names, usual, strict=True)
    )
    for name, value in given.items():
        setattr(kind, name, value)


def forget_kept(module: ModuleType) -> None:
    """Clear what functions of a module keep of earlier calls."""
    for found in list(vars(module).values()):
        members = list(vars(found).values()) if isinstance(found, type) else []
        for each in (found, *members):
            kept = getattr(each, "__func__", each)
            if hasattr(kept, "cache_clear"):
                kept.cache_clear()
