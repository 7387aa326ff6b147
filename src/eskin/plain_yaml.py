"""This module loads YAML files that hold plain data, within limits on their size."""

from collections.abc import Hashable, Sequence
from typing import Annotated

import yaml
from pydantic import Field, ValidationError

MAX_SHOWN = 40
"""Number of characters of a value that messages show."""
MAX_DEPTH = 20
"""Largest depth of nested collections in a file."""
MAX_YAML_BYTES = 1 << 19
"""Largest size of a file [bytes]."""
MAX_VALUES = 16_000
"""Largest number of values in a file; keys and collections count too."""
MAX_SCALAR = 10_000
"""Largest number of characters of a single value."""
NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
MAX_DIGITS = 400
"""Largest number of characters of a number."""
# One line without control characters, and without spaces at its ends.
NAME = r"^[^\s\p{Cc}]([^\p{Cc}\p{Zl}\p{Zp}]*[^\s\p{Cc}])?$"
Name = Annotated[str, Field(pattern=NAME, max_length=200)]


def load_plain_yaml(text: str) -> object:
    """Load the data of a YAML text.

    Raises:
        ValueError: The text is not plain YAML. The message is one line that says where
            and why, to follow the name of the file.
    """
    try:
        if len(text) > MAX_YAML_BYTES:
            raise ValueError(
                f"it has {len(text):,} characters, allowed are {MAX_YAML_BYTES:,}"
            )
        return yaml.load(text, PlainLoader)  # noqa: S506  It is a SafeLoader.
    except yaml.YAMLError as error:
        raise ValueError(describe_yaml_error(error)) from None
    except (OverflowError, ValueError) as error:  # An invalid character code.
        raise ValueError(f": not plain YAML: {error}") from None


class PlainLoader(yaml.SafeLoader):
    """Loads plain data: only YAML's own tags are allowed, and no repeated keys.

    Within a second it has loaded a text, or refused it: a few aliases could expand to
    billions of values, and the time to read nested collections grows with the square of
    their depth.
    """

    def __init__(self, text: str) -> None:
        """Start at the beginning of a text."""
        super().__init__(text)
        self.values = self.depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Read a value; raise a YAML error where it is an alias, or one too many."""
        event = self.peek_event()
        self.values, self.depth = self.values + 1, self.depth + 1
        for is_wrong, problem in (
            (event.anchor is not None, "anchors and aliases are not allowed"),
            (self.values > MAX_VALUES, f"more than {MAX_VALUES:,} values"),
            (
                len(getattr(event, "value", "")) > MAX_SCALAR,
                f"a value has more than {MAX_SCALAR:,} characters",
            ),
            (self.depth > MAX_DEPTH, f"more than {MAX_DEPTH} nested collections"),
        ):
            if is_wrong:
                raise yaml.MarkedYAMLError(
                    problem=problem, problem_mark=event.start_mark
                )
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        """Construct a value; raise a YAML error where it does not match its tag."""
        try:
            if node.tag in NUMBER_TAGS and len(node.value) > MAX_DIGITS:
                # The time to read digits to the base 60 grows with the square.
                raise ValueError
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise yaml.MarkedYAMLError(
                problem=f"{shorten(node.value)} is no {node.tag.rpartition(':')[2]}",
                problem_mark=node.start_mark,
            ) from None

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, object]:
        """Construct a mapping; raise where a key is repeated or not a scalar."""
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(
                    problem="a key is not a word", problem_mark=key.start_mark
                )
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"the key {shorten(key.value)} is repeated",
                    problem_mark=key.start_mark,
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def describe_yaml_error(error: yaml.YAMLError) -> str:
    """Describe where and why a YAML text is invalid, in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = getattr(error, "problem", None) or str(error)
    return f"{where}: not plain YAML: {' '.join(str(why).split())}"


def format_entry_path(steps: Sequence[int | str]) -> str:
    """Return the path of an entry in a file, such as `patches[2].rows`."""
    path = ""
    for step in steps:
        plain = str(step) if str(step).isidentifier() else shorten(step)
        path += f"[{step}]" if isinstance(step, int) else f".{plain}"
    return path.lstrip(".")


def describe_first_error(error: ValidationError) -> str:
    """Describe where the first wrong entry of a file is, why, and what was got."""
    first = error.errors()[0]
    where = format_entry_path(first["loc"]) or "the file"
    return f"{where}: {first['msg']}, got {shorten(first['input'])}"


def shorten(value: object) -> str:
    """Return the representation of a value, cut to a length for messages."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "..."
