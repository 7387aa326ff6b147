"""What `skin.yaml` holds, read safely and validated."""

from collections.abc import Hashable
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.errors import SkinError
from eskin.skin.skin import Patch, Skin

SHOWN = 40
Name = Annotated[str, Field(pattern=r"^\S(.*\S)?$", max_length=200)]
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


class Manifest(BaseModel):
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

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, object]:
        """Refuse a key that stands twice in one mapping."""
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"the key '{key.value}' stands twice",
                    problem_mark=key.start_mark,
                )
            seen.add(str(key.value))
        return super().construct_mapping(node, deep)


def parse_manifest(text: str, file: str) -> Manifest:
    """Read `skin.yaml`.

    Raises:
        SkinError: every entry that is wrong, in one line that begins with the file.
    """
    try:
        refuse_aliases(text)
        data = yaml.load(text, PlainLoader)  # noqa: S506  It is a SafeLoader.
    except yaml.YAMLError as error:
        raise SkinError(f"{file}{describe(error)}") from None
    except (RecursionError, ValueError) as error:
        raise SkinError(f"{file}: not a skin description: {error}") from None
    if not isinstance(data, dict):
        raise SkinError(
            f"{file}: got {shorten(data)}, allowed a mapping with the keys "
            f"{', '.join(Manifest.model_fields)}"
        )
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        lines = "; ".join(describe_entry(detail) for detail in error.errors())
        raise SkinError(f"{file}: {lines}") from None


def format_manifest(skin: Skin) -> str:
    """Write a skin's `skin.yaml`."""
    manifest = Manifest(
        name=skin.name,
        calibrated=bool(skin.calibrated),
        patches=[PatchEntry(**vars(patch)) for patch in skin.patches],
    )
    return yaml.safe_dump(manifest.model_dump(), sort_keys=False, allow_unicode=True)


def refuse_aliases(text: str) -> None:
    """Refuse aliases: a skin has no use for them, and a few can stand for billions."""
    for event in yaml.parse(text, yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise yaml.MarkedYAMLError(
                problem="aliases are not allowed", problem_mark=event.start_mark
            )


def describe(error: yaml.YAMLError) -> str:
    """Say where the YAML breaks and why, in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = getattr(error, "problem", None) or str(error)
    return f"{where}: not plain YAML: {' '.join(str(why).split())}"


def describe_entry(detail: ErrorDetails) -> str:
    """Say which entry is wrong, what was got and what is allowed."""
    path = ""
    for step in detail["loc"]:
        path += f"[{step}]" if isinstance(step, int) else f".{step}"
    path = path.lstrip(".")
    if detail["type"] == "missing":
        return f"{path} is missing; add it"
    if detail["type"] == "extra_forbidden":
        allowed = PatchEntry if "[" in path else Manifest
        return f"{path} is not known, allowed {', '.join(allowed.model_fields)}"
    wanted = detail["msg"].removeprefix("Input ").removeprefix("should ")
    return f"{path}: got {shorten(detail['input'])}, {wanted}"


def shorten(value: object) -> str:
    """Show a value from a file without letting it fill the screen."""
    text = repr(value)
    return text if len(text) <= SHOWN else text[:SHOWN] + "..."
