"""Find the tuned numbers of the front end in its sources, and what depends on them.

Each module constant in capitals is tuned that is a number, alone or in a tuple, and
each number that is a default of a configuration or of a record of constants, a named
tuple of which the module has one. Not tuned are numbers by which something is indexed;
zero and negative numbers, which stand for nothing; and those of `NOT_TUNED`.
"""

import ast
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import final

import numpy as np

NOT_TUNED = {
    "NEVER": "stands for nothing",
    "PA_PER_KPA": "unit",
    "UM_PER_M": "unit",
    "MICROMETRE": "rounding",
    "EPSILON": "rounding",
    "BEND_SIGMAS": "mathematics",
    "VERSIONS": "files",
    "MAX_CALIBRATION_BYTES": "files",
    "MAX_FULL_SCALE": "files",
    "MAX_SECONDS": "files",
    "MAX_PAIRS": "limit of skins",
    "MAX_CELLS_PER_TAXEL": "limit of skins",
    "FREE_CELLS": "limit of skins",
}
"""Constants that are not tuned, and what they are of."""
FUNCTIONS = {
    "round": round,
    "int": int,
    "float": float,
    "min": min,
    "max": max,
    "abs": abs,
    "math": math,
    "np": np,
}
"""What a constant may be computed by."""
Place = tuple[str, str]
"""A module and a name in it."""


@dataclass(frozen=True)
class Number:
    """A number that is tuned by hand."""

    module: str
    """Its module, such as `touch.fault_kernels`."""
    name: str
    """Its name, with the class in front of a field: `ContactConfig.on`."""
    part: int | None
    """Its place in a tuple; None where it is no part of one."""
    value: int | float

    @property
    def label(self) -> str:
        """Its name, with its place in a tuple."""
        return self.name if self.part is None else f"{self.name}[{self.part}]"

    @property
    def key(self) -> str:
        """What identifies it."""
        return f"{self.module}:{self.label}"

    def scale(self, factor: float) -> int | float:
        """Return it times a factor; whole numbers stay whole, and at least 1."""
        if isinstance(self.value, int):
            return max(round(self.value * factor), 1)
        return self.value * factor


@final
@dataclass(frozen=True, eq=False)
class ModuleSource:
    """The constants of one module."""

    module: str
    tree: ast.Module

    @cached_property
    def constants(self) -> dict[str, ast.expr]:
        """The expressions of its constants, by their names in capitals."""
        found: dict[str, ast.expr] = {}
        for node in self.tree.body:
            if isinstance(node, ast.AnnAssign) and node.value is not None:
                pairs = [(node.target, node.value)]
            elif isinstance(node, ast.Assign) and len(node.targets) == 1:
                pairs = list(pair_targets(node.targets[0], node.value))
            else:
                continue
            for target, value in pairs:
                if isinstance(target, ast.Name) and target.id.isupper():
                    found[target.id] = value
        return found

    @cached_property
    def records(self) -> dict[str, str]:
        """The classes of its records of constants, by the names of the constants."""
        kinds = {
            node.name
            for node in self.tree.body
            if isinstance(node, ast.ClassDef)
            and any(
                isinstance(b, ast.Name) and b.id == "NamedTuple" for b in node.bases
            )
        }
        return {
            name: node.func.id
            for name, node in self.constants.items()
            if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in kinds
        }

    @cached_property
    def defaults(self) -> dict[str, ast.expr]:
        """The expressions of the defaults of its configurations, as `Class.field`."""
        return {
            name: value
            for kind in self.tree.body
            if isinstance(kind, ast.ClassDef) and kind.name.endswith("Config")
            for name, value in list_fields(kind)
        }

    @cached_property
    def members(self) -> dict[str, ast.expr]:
        """The expressions of the fields of its records, as `Class.field`."""
        return {
            name: value
            for kind in self.tree.body
            if isinstance(kind, ast.ClassDef) and kind.name in self.records.values()
            for name, value in list_fields(kind)
        }

    @cached_property
    def numbers(self) -> dict[str, ast.expr]:
        """The expressions of all that may be tuned."""
        return self.constants | self.defaults | self.members

    @cached_property
    def imported(self) -> dict[str, Place]:
        """Where names are from that it imports from eskin."""
        return {
            each.asname or each.name: (node.module.removeprefix("eskin."), each.name)
            for node in self.tree.body
            if isinstance(node, ast.ImportFrom)
            and node.module
            and node.module.startswith("eskin.")
            for each in node.names
        }

    @cached_property
    def indices(self) -> set[str]:
        """Names by which something is indexed."""
        slices = (
            node.slice
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Subscript)
        )
        found = set()
        for each in slices:
            parts = each.elts if isinstance(each, ast.Tuple) else [each]
            for part in parts:
                bounds = [part]
                if isinstance(part, ast.Slice):
                    bounds = [part.lower, part.upper]
                found |= {one.id for one in bounds if isinstance(one, ast.Name)}
        return found


def list_fields(kind: ast.ClassDef) -> Iterator[tuple[str, ast.expr]]:
    """Yield each field of a class that has a default, as `Class.field`."""
    for each in kind.body:
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            if each.value is not None:
                yield f"{kind.name}.{each.target.id}", each.value


def pair_targets(
    target: ast.expr, value: ast.expr
) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield each name that a statement assigns, with its expression."""
    if not isinstance(target, ast.Tuple):
        yield target, value
    elif isinstance(value, ast.Tuple) and len(value.elts) == len(target.elts):
        yield from zip(target.elts, value.elts, strict=True)


@final
@dataclass(frozen=True, eq=False)
class Sources:
    """The sources of eskin, of which some modules are the front end."""

    folder: Path
    """Folder of the package."""
    read: dict[str, ModuleSource] = field(default_factory=dict)
    """Modules that were read, by their names."""

    @cached_property
    def modules(self) -> list[str]:
        """Names of the modules of the front end."""
        paths = sorted((self.folder / "touch").glob("*.py"))
        return [f"touch.{path.stem}" for path in paths]

    def get(self, module: str) -> ModuleSource:
        """Return a module of eskin; for a package its `__init__`."""
        if module not in self.read:
            place = self.folder.joinpath(*module.split("."))
            path = place.with_suffix(".py")
            if not path.is_file():
                path = place / "__init__.py"
            tree = ast.parse(path.read_text("utf-8"))
            self.read[module] = ModuleSource(module, tree)
        return self.read[module]

    def find(self, module: str, name: str) -> Place:
        """Return where a name of a module is defined."""
        imported = self.get(module).imported
        if name in imported:
            return self.find(*imported[name])
        return module, name

    @cached_property
    def indices(self) -> set[Place]:
        """Constants by which something is indexed."""
        return {
            self.find(module, name)
            for module in self.modules
            for name in self.get(module).indices
        }

    def compute(
        self, place: Place, changed: Mapping[str, float] | None = None
    ) -> int | float | tuple | None:
        """Compute a constant, or a default of a configuration.

        Args:
            place: where it is.
            changed: values of numbers in place of their own, by `Number.key`.

        Returns:
            A number or a tuple of numbers; None for anything else.
        """
        module, name = place
        changed = changed or {}
        node = self.get(module).numbers.get(name)
        if node is None:
            return None
        names: dict[str, object] = {}
        for each in ast.walk(node):
            if isinstance(each, ast.Name) and each.id not in FUNCTIONS:
                value = self.compute_name(self.find(module, each.id), changed)
                if value is None:
                    return None
                names[each.id] = value
        try:
            code = compile(ast.Expression(node), module, "eval")
            value = eval(code, {"__builtins__": {}}, FUNCTIONS | names)
        except (ArithmeticError, AttributeError, NameError, TypeError, ValueError):
            return None
        key = f"{module}:{name}"
        if is_number(value):
            return changed.get(key, value)
        if isinstance(value, tuple) and value and all(map(is_number, value)):
            parts = [changed.get(f"{key}[{n}]", one) for n, one in enumerate(value)]
            return tuple(parts)
        return None

    def compute_name(self, place: Place, changed: Mapping[str, float]) -> object:
        """Compute what a name stands for: a constant, or a record of them."""
        module, name = place
        source = self.get(module)
        if name not in source.records:
            return self.compute(place, changed)
        kind = source.records[name]
        return SimpleNamespace(
            **{
                member.removeprefix(f"{kind}."): self.compute((module, member), changed)
                for member in source.members
                if member.startswith(f"{kind}.")
            }
        )

    def find_member(self, module: str, node: ast.Attribute) -> Place | None:
        """Return the place of a field that is read from a record; None of others."""
        if not isinstance(node.value, ast.Name):
            return None
        owner, name = self.find(module, node.value.id)
        kind = self.get(owner).records.get(name)
        return None if kind is None else (owner, f"{kind}.{node.attr}")

    def is_given(self, place: Place) -> bool:
        """Return whether a constant is written as numbers, not computed from others."""
        module, name = place
        node = self.get(module).numbers.get(name)
        return node is not None and not any(
            isinstance(each, ast.Name | ast.Call | ast.Attribute)
            for each in ast.walk(node)
        )

    def list_places(self) -> Iterator[Place]:
        """Yield all constants and defaults of the front end that are numbers."""
        for module in self.modules:
            for name in self.get(module).numbers:
                if self.compute((module, name)) is not None:
                    yield module, name

    def why_not_tuned(self, place: Place) -> str:
        """Return why a constant is not tuned; an empty text where it is."""
        value = self.compute(place)
        values = value if isinstance(value, tuple) else (value,)
        if place in self.indices:
            return "index"
        if not self.is_given(place):
            return "computed from others"
        if any(one <= 0 for one in values if one is not None):
            return "stands for nothing"
        return NOT_TUNED.get(place[1], "")

    def list_numbers(self) -> list[Number]:
        """List the tuned numbers."""
        found: list[Number] = []
        for module, name in self.list_places():
            value = self.compute((module, name))
            if self.why_not_tuned((module, name)) or value is None:
                continue
            if isinstance(value, tuple):
                found += [Number(module, name, n, one) for n, one in enumerate(value)]
            else:
                found.append(Number(module, name, None, value))
        return found


def is_number(value: object) -> bool:
    """Return whether a value is a number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)
