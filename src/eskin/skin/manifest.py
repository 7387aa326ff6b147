"""This module reads, validates and writes `skin.yaml`."""

from collections.abc import Hashable
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.errors import SkinError
from eskin.skin.skin import Patch, Skin

MAX_SHOWN = 40
"""Number of characters of a value that messages show."""
MAX_DEPTH = 20
"""Largest depth of nested collections in a file."""
# No spaces at the ends, no control characters, one line.
NAME = r"^[^\s\p{Cc}]([^\p{Cc}\p{Zl}\p{Zp}]*[^\s\p{Cc}])?$"
Name = Annotated[str, Field(pattern=NAME, max_length=200)]
Extent = Annotated[int, Field(ge=1, le=65535)]


class PatchEntry(BaseModel):
    """An entry describes one patch in `skin.yaml`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    id: Name
    link: Name
    address: Annotated[int, Field(ge=0, le=65535)]
    rows: Extent
    columns: Extent
    kind: Literal["pressure", "shear"] = "pressure"
    units: Name = "kPa"


class SkinManifest(BaseModel):
    """A manifest holds the content of `skin.yaml`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    version: Literal[1] = 1
    name: Name
    calibrated: bool = True
    taxels: Name = "taxels.csv"
    patches: Annotated[list[PatchEntry], Field(min_length=1)]

    def build_patches(self) -> tuple[Patch, ...]:
        """Return the patches, in the order of the file."""
        return tuple(Patch(**entry.model_dump()) for entry in self.patches)


class PlainLoader(yaml.SafeLoader):
    """This loader reads plain data: only YAML's own tags, and no repeated keys."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        """Construct a value; raise a YAML error where it does not match its tag."""
        try:
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
                    problem=f"the key {shorten(key.value)} stands twice",
                    problem_mark=key.start_mark,
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def parse_manifest(text: str, file: str) -> SkinManifest:
    """Read the text of a `skin.yaml`.

    Raises:
        SkinError: It names every wrong entry, in one line that begins with the file.
    """
    try:
        check_yaml_size(text)
        data = yaml.load(text, PlainLoader)  # noqa: S506  It is a SafeLoader.
    except yaml.YAMLError as error:
        raise SkinError(f"{file}{describe_yaml_error(error)}") from None
    except (OverflowError, ValueError) as error:  # An invalid character code.
        raise SkinError(f"{file}: not plain YAML: {error}") from None
    if not isinstance(data, dict):
        raise SkinError(
            f"{file}: got {shorten(data)}, allowed a mapping with the keys "
            f"{', '.join(SkinManifest.model_fields)}"
        )
    try:
        return SkinManifest.model_validate(data)
    except ValidationError as error:
        lines = "; ".join(describe_entry_error(detail) for detail in error.errors())
        raise SkinError(f"{file}: {lines}") from None


def format_manifest(skin: Skin) -> str:
    """Return the text of a skin's `skin.yaml`."""
    manifest = SkinManifest(
        name=skin.name,
        calibrated=bool(skin.calibrated),
        patches=[PatchEntry(**vars(patch)) for patch in skin.patches],
    )
    return yaml.safe_dump(manifest.model_dump(), sort_keys=False, allow_unicode=True)


def check_yaml_size(text: str) -> None:
    """Raise where a short text would take hours to read.

    A few aliases can expand to billions of values, and the time to read nested
    collections grows with the square of their depth.
    """
    depth = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent):
            raise yaml.MarkedYAMLError(
                problem="aliases are not allowed", problem_mark=event.start_mark
            )
        if depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(
                problem=f"more than {MAX_DEPTH} collections lie in each other",
                problem_mark=event.start_mark,
            )


def describe_yaml_error(error: yaml.YAMLError) -> str:
    """Describe where and why a YAML text is invalid, in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = getattr(error, "problem", None) or str(error)
    return f"{where}: not plain YAML: {' '.join(str(why).split())}"


def describe_entry_error(detail: ErrorDetails) -> str:
    """Describe which entry is wrong, what was got and what is allowed."""
    path = ""
    for step in detail["loc"]:
        plain = str(step) if str(step).isidentifier() else shorten(step)
        path += f"[{step}]" if isinstance(step, int) else f".{plain}"
    path = path.lstrip(".")
    if detail["type"] == "missing":
        return f"{path} is missing; add it"
    if detail["type"] == "extra_forbidden":
        allowed = PatchEntry if "[" in path else SkinManifest
        return f"{path} is not known, allowed {', '.join(allowed.model_fields)}"
    if detail["type"] == "string_pattern_mismatch":
        return (
            f"{path}: got {shorten(detail['input'])}, allowed one line of text without "
            "spaces at its ends"
        )
    wanted = detail["msg"].removeprefix("Input ").removeprefix("should ")
    return f"{path}: got {shorten(detail['input'])}, {wanted}"


def shorten(value: object) -> str:
    """Return the representation of a value, cut to a length for messages."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "..."
