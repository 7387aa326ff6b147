"""What `skin.yaml` holds, read safely and validated."""

from collections.abc import Hashable
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.errors import SkinError
from eskin.skin.skin import Patch, Skin

SHOWN = 40
DEEPEST = 20
# No spaces at its ends, no control characters, all on one line.
NAME = r"^[^\s\p{Cc}]([^\p{Cc}\p{Zl}\p{Zp}]*[^\s\p{Cc}])?$"
Name = Annotated[str, Field(pattern=NAME, max_length=200)]
Extent = Annotated[int, Field(ge=1, le=65535)]


class PatchEntry(BaseModel):
    """One patch as `skin.yaml` writes it."""

    model_config = ConfigDict(extra="forbid", strict=True)

    id: Name
    link: Name
    address: Annotated[int, Field(ge=0, le=65535)]
    rows: Extent
    columns: Extent
    kind: Literal["pressure", "shear"] = "pressure"
    units: Name = "kPa"


class SkinManifest(BaseModel):
    """The whole of `skin.yaml`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    version: Literal[1] = 1
    name: Name
    calibrated: bool = True
    taxels: Name = "taxels.csv"
    patches: Annotated[list[PatchEntry], Field(min_length=1)]

    def patch_list(self) -> tuple[Patch, ...]:
        """The patches, in the order of the file."""
        return tuple(Patch(**entry.model_dump()) for entry in self.patches)


class PlainLoader(yaml.SafeLoader):
    """Plain data only: no tags but YAML's own, and no key twice in one mapping."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        """Refuse a value that is not what its tag says; PyYAML raises anything then."""
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
        """Refuse a key that stands twice in one mapping."""
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
    """Read `skin.yaml`.

    Raises:
        SkinError: every entry that is wrong, in one line that begins with the file.
    """
    try:
        check_yaml_size(text)
        data = yaml.load(text, PlainLoader)  # noqa: S506  It is a SafeLoader.
    except yaml.YAMLError as error:
        raise SkinError(f"{file}{describe_yaml_error(error)}") from None
    except (OverflowError, ValueError) as error:  # A character that there is not.
        raise SkinError(f"{file}: not plain YAML: {error}") from None
    if not isinstance(data, dict):
        raise SkinError(
            f"{file}: got {shorten(data)}, allowed a mapping with the keys "
            f"{', '.join(SkinManifest.model_fields)}"
        )
    try:
        return SkinManifest.model_validate(data)
    except ValidationError as error:
        lines = "; ".join(describe_entry(detail) for detail in error.errors())
        raise SkinError(f"{file}: {lines}") from None


def format_manifest(skin: Skin) -> str:
    """Write a skin's `skin.yaml`."""
    manifest = SkinManifest(
        name=skin.name,
        calibrated=bool(skin.calibrated),
        patches=[PatchEntry(**vars(patch)) for patch in skin.patches],
    )
    return yaml.safe_dump(manifest.model_dump(), sort_keys=False, allow_unicode=True)


def check_yaml_size(text: str) -> None:
    """Refuse what a skin has no use for, and a short text can fill hours with.

    A few aliases stand for billions; reading takes the square of the depth.
    """
    depth = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent):
            raise yaml.MarkedYAMLError(
                problem="aliases are not allowed", problem_mark=event.start_mark
            )
        if depth > DEEPEST:
            raise yaml.MarkedYAMLError(
                problem=f"more than {DEEPEST} collections lie in each other",
                problem_mark=event.start_mark,
            )


def describe_yaml_error(error: yaml.YAMLError) -> str:
    """Say where the YAML breaks and why, in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = getattr(error, "problem", None) or str(error)
    return f"{where}: not plain YAML: {' '.join(str(why).split())}"


def describe_entry(detail: ErrorDetails) -> str:
    """Say which entry is wrong, what was got and what is allowed."""
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
    """Show a value from a file without letting it fill the screen."""
    text = repr(value)
    return text if len(text) <= SHOWN else text[:SHOWN] + "..."
