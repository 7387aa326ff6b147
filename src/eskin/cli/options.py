"""This module describes the options of commands to tyro, which parses them.

Their help is the docstring below each field, wrapped anew, with the kind of its value,
and with its default where there is one to tell.
"""

import ast
import contextlib
import inspect
import io
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from itertools import pairwise
from textwrap import fill
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TextIO,
    Union,
    final,
    get_args,
    get_origin,
    get_type_hints,
)

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""Sequence that sets a colour of a terminal."""

ROBOT = tyro.conf.arg(aliases=("--robot",))
"""Names of the option that gives the robot of a skin."""

registry = ConstructorRegistry()
"""What tyro is told of the classes of commands."""


@registry.struct_rule
def describe_class(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Describe the fields of a dataclass; return None for any other type."""
    if not (isinstance(info.type, type) and is_dataclass(info.type)):
        return None
    hints = get_type_hints(info.type, include_extras=True)
    found = []
    for each in fields(info.type):
        default = find_default(each, info.default)
        is_told = default not in (None, (), "", {}, tyro.MISSING)
        is_told = is_told and not isinstance(default, bool)
        hint = None if is_told else ""
        own = hints[each.name]
        words = tyro.conf.arg(metavar=describe_kind(own), help_behavior_hint=hint)
        metadata = get_args(own)[1:] if get_origin(own) is Annotated else ()
        # What the field says itself comes last, and counts.
        told: Any = Annotated[(own, words, *metadata)]
        text = partial(find_field_text, info.type, each.name)
        found.append(StructFieldSpec(each.name, told, default, text))
    return StructConstructorSpec(info.type, tuple(found))


def find_default(field: Field, given: object) -> object:
    """Return the default of a field, of an instance where one is given."""
    if is_dataclass(given):
        return getattr(given, field.name)
    if field.default_factory is not MISSING:
        return field.default_factory()
    return tyro.MISSING if field.default is MISSING else field.default


def find_field_text(command: type, field: str) -> str | None:
    """Return the docstring below a field of a class; only help and errors need it."""
    return read_field_texts(command).get(field)


@cache
def read_field_texts(command: type) -> dict[str, str]:
    """Return the docstrings below the fields of a class, each as one line."""
    found = {}
    for each in reversed(command.__mro__[:-1]):
        tree = ast.parse(inspect.getsource(sys.modules[each.__module__]))
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and node.name == each.__name__:
                found |= dict(iterate_texts(node.body))
    return found


def iterate_texts(body: Sequence[ast.stmt]) -> Any:  # noqa: ANN401
    """Yield the fields of a class that have a docstring, with it."""
    for field, below in pairwise(body):
        match field, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                yield name, " ".join(text.split())


def describe_kind(hint: Any) -> str | None:  # noqa: ANN401
    """Describe what a type takes, as `INT` or `{a,b}`; None where tyro knows better."""
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin is Annotated:
        return describe_kind(inner[0])
    if origin in (Union, UnionType):
        kinds = [each for each in inner if each is not NoneType]
        return describe_kind(kinds[0]) if len(kinds) == 1 else None
    if origin is Literal:
        return "{" + ",".join(map(str, inner)) + "}"
    if origin is tuple and inner[-1] is ...:
        return f"{describe_kind(inner[0])} ..."
    if origin is tuple:
        return " ".join(describe_kind(each) or "" for each in inner)
    if origin is dict:
        return " ".join(describe_kind(each) or "" for each in inner) + " ..."
    is_plain = hint in (int, float, str) or getattr(hint, "__name__", "") == "Path"
    return hint.__name__.upper() if is_plain else None


@final
class HelpText(io.TextIOWrapper):
    """A text of help has the characters and colours of the stdout that will show it."""

    def __init__(self, stdout: TextIO) -> None:
        """Start without text."""
        super().__init__(io.BytesIO(), stdout.encoding, write_through=True)
        self.has_colours = stdout.isatty()

    def isatty(self) -> bool:
        """Return whether it has colours."""
        return self.has_colours


@contextlib.contextmanager
def insert_description(command: type) -> Iterator[None]:
    """Insert the docstring of a command into the help that tyro prints in the block.

    It stands below the usage. Both are wrapped to the width of the terminal, since tyro
    wraps neither. Another text, such as a script that completes options, is printed as
    it is.
    """
    text = HelpText(sys.stdout)
    try:
        with contextlib.redirect_stdout(text):
            yield
    finally:
        text.seek(0)
        shown = text.read()
        usage, gap, options = shown.partition("\n\n")
        usage = COLOUR.sub("", usage)
        if usage.startswith("usage:"):
            width = shutil.get_terminal_size().columns
            usage = fill(usage, width, subsequent_indent=" " * 7)
            paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
            description = [fill(each, width) for each in paragraphs]
            shown = gap.join([usage, *description, options])
        print(shown, end="")


def list_options(command: type, group: str = "") -> list[str]:
    """Return the options of a command, options of groups with their group."""
    found = []
    for each in fields(command):
        name = group + each.name.replace("_", "-")
        if isinstance(each.type, type) and is_dataclass(each.type):
            found += list_options(each.type, f"{name}.")
        else:
            found.append(f"--{name}")
    return found
