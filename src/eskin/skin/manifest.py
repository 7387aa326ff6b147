"""This module reads, validates and writes `skin.yaml`."""

from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.errors import SkinError
from eskin.plain_yaml import Name, format_entry_path, load_plain_yaml, shorten
from eskin.skin.skin import Patch, Skin

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


def parse_manifest(text: str, file: str) -> SkinManifest:
    """Read the text of a `skin.yaml`.

    Raises:
        SkinError: It names every wrong entry, in one line that begins with the file.
    """
    try:
        data = load_plain_yaml(text)
    except ValueError as error:
        raise SkinError(f"{file}{error}") from None
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


def describe_entry_error(detail: ErrorDetails) -> str:
    """Describe which entry is wrong, what was got and what is allowed."""
    path = format_entry_path(detail["loc"])
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
