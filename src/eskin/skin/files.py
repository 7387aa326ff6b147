"""This module reads and writes skins, as folders or as bytes."""

import os
from contextlib import ExitStack
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from jaxtyping import Int
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.errors import SkinError
from eskin.files import (
    MAX_YAML_BYTES,
    Name,
    atomic_path,
    describe_entry_error,
    load_plain_yaml,
    read_file,
    shorten,
)
from eskin.robot import Robot
from eskin.robot.urdf import MAX_URDF_BYTES
from eskin.skin.check import SkinProblem, check_crowding, find_fatal_problems
from eskin.skin.presets import SKIN_PRESETS
from eskin.skin.skin import MountedSkin, Patch, Skin
from eskin.skin.taxel_table import (
    MAX_TABLE_BYTES,
    build_arrays,
    format_taxels,
    parse_taxels,
)

MANIFEST = "skin.yaml"
ROBOT_URDF = "robot.urdf"
"""Name of the URDF of a skin's robot, beside `skin.yaml` and in a recording."""
END = "...\n"
"""End of the YAML document; the taxels follow."""
Extent = Annotated[int, Field(ge=1, le=65535)]
MAX_PATCHES = 1000
"""Largest number of patches of a skin."""


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
    robot_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    patches: Annotated[list[PatchEntry], Field(min_length=1, max_length=MAX_PATCHES)]


@dataclass(frozen=True, eq=False)
class ParsedSkin:
    """A parsed skin holds the readable taxels of its files, and all problems."""

    skin: Skin
    """Skin of the rows that could be read, sorted by id."""
    ids: Int[np.ndarray, "taxel"]
    """Id of each taxel in the file."""
    problems: tuple[SkinProblem, ...]
    """Problems of the rows that could not be read, and of the ids."""


def load_skin(name_or_path: str | Path) -> Skin:
    """Load a preset by its name, or a skin from a folder.

    Args:
        name_or_path: a name in `SKIN_PRESETS`, a folder with `skin.yaml`, or that file.

    Raises:
        SkinError: The skin does not exist or has problems; the message has the first.
    """
    name = str(name_or_path)
    if name in SKIN_PRESETS:
        return SKIN_PRESETS[name].build()
    path = Path(name_or_path)
    if not path.exists():
        raise SkinError(
            f"no skin '{name}'; allowed is a preset ({', '.join(SKIN_PRESETS)}) or a "
            f"folder with {MANIFEST}"
        )
    parsed = parse_skin_folder(path)
    return require_valid(parsed, f"`eskin skin check {name}` lists them")


def save_skin(skin: Skin, folder: str | Path, robot: Robot | None = None) -> None:
    """Write a skin into a folder, which is created where it does not exist.

    Args:
        skin: the skin.
        folder: the folder. What it holds of another skin is replaced.
        robot: robot that wears the skin. Its URDF is copied into the folder, without
            the meshes that it names, and the skin is mounted on it from then on. The
            folder names no robot without one, or where it was not read from a URDF.

    Raises:
        SkinError: The skin is none that `load_skin` reads; nothing is written.
        SkinMismatchError: The robot lacks a link that the skin lies on.
    """
    folder = Path(folder)
    skin_from_bytes(skin_to_bytes(skin), f"skin {skin.name!r}")
    urdf = None
    if robot is not None:
        MountedSkin(skin, robot)
        urdf = robot.urdf or None
    with ExitStack() as files:
        taxels = files.enter_context(atomic_path(folder / "taxels.csv"))
        manifest = files.enter_context(atomic_path(folder / MANIFEST))
        taxels.write_text(format_taxels(skin), encoding="utf-8", newline="\n")
        manifest.write_text(format_manifest(skin, urdf), encoding="utf-8", newline="\n")
        if urdf is not None:
            files.enter_context(atomic_path(folder / ROBOT_URDF)).write_bytes(urdf)
    if urdf is None and (folder / ROBOT_URDF).is_file():
        (folder / ROBOT_URDF).unlink()


def read_robot_urdf(path: Path) -> bytes | None:
    """Read the URDF of the robot that a skin's folder names; None where it names none.

    Args:
        path: the folder, or its `skin.yaml`.

    Raises:
        SkinError: It is missing, cannot be read, or was changed since it was written.
    """
    file = path if path.name == MANIFEST else path / MANIFEST
    if not file.exists():
        return None
    manifest = parse_manifest(read_text(file, MAX_YAML_BYTES), str(file))
    if manifest.robot_sha256 is None:
        return None
    target = resolve_inside(file.parent, ROBOT_URDF, str(file))
    remedy = "give the robot with --robot-urdf, or copy the whole folder again"
    try:
        urdf = read_file(target, MAX_URDF_BYTES)
    except OSError as error:
        raise SkinError(
            f"{file.parent / ROBOT_URDF}, the robot of the skin, cannot be read "
            f"({error.strerror}); {remedy}"
        ) from None
    if sha256(urdf).hexdigest() != manifest.robot_sha256:
        raise SkinError(
            f"{file.parent / ROBOT_URDF}, the robot of the skin, was changed since it "
            f"was written; allowed is the file whose SHA-256 is in {MANIFEST}; {remedy}"
        )
    return urdf


def skin_to_bytes(skin: Skin) -> bytes:
    """Return the whole skin as one text, without loss of precision."""
    return (format_manifest(skin) + END + format_taxels(skin)).encode()


def skin_from_bytes(data: bytes, source: str = "skin") -> Skin:
    """Read what `skin_to_bytes` wrote; messages name the source of the text.

    Raises:
        SkinError: The skin has problems; the message has the first.
    """
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise SkinError(f"{source}: byte {error.start} is not UTF-8") from None
    head, mark, table = text.partition("\n" + END)
    if not mark:
        raise SkinError(f"{source}: got no line '...' between patches and taxels")
    manifest = parse_manifest(head, source)
    parsed = parse_skin(manifest, table, f"{source}, taxels")
    return require_valid(parsed, "correct its source")


def require_valid(parsed: ParsedSkin, remedy: str) -> Skin:
    """Return the skin of a parsed skin; raise where it has problems."""
    problems = list(parsed.problems) or find_fatal_problems(parsed.skin)
    if problems:
        more = f" (and {len(problems) - 1} more; {remedy})" if problems[1:] else ""
        raise SkinError(f"{problems[0]}{more}")
    return parsed.skin


def parse_skin_folder(path: Path) -> ParsedSkin:
    """Read a folder with `skin.yaml` and its taxels, and list the problems.

    Raises:
        SkinError: A file is missing, or is no file of a skin.
    """
    file = path if path.name == MANIFEST else path / MANIFEST
    manifest = parse_manifest(read_text(file, MAX_YAML_BYTES), str(file))
    taxels = resolve_inside(file.parent, manifest.taxels, str(file))
    return parse_skin(manifest, read_text(taxels, MAX_TABLE_BYTES), str(taxels))


def parse_skin(manifest: SkinManifest, table_text: str, file: str) -> ParsedSkin:
    """Build a skin from a manifest and the text of its taxels; list the problems.

    Raises:
        SkinError: It is no table of taxels, or many of them lie in one place.
    """
    patches = tuple(Patch(**entry.model_dump()) for entry in manifest.patches)
    taxels, problems = parse_taxels(table_text, patches, file)
    ids = np.array([taxel.id for taxel in taxels], np.int64)
    ids_wrong = find_id_problems(ids, problems, file)
    problems = [*find_repeated_patches(manifest), *problems, *ids_wrong]
    skin = Skin(
        manifest.name, patches, **build_arrays(taxels), calibrated=manifest.calibrated
    )
    check_crowding(skin, file)
    return ParsedSkin(skin, ids, tuple(problems))


def find_repeated_patches(manifest: SkinManifest) -> list[SkinProblem]:
    """Find patch ids that occur more than once."""
    ids = [entry.id for entry in manifest.patches]
    return [
        SkinProblem(
            f"stands {ids.count(name)} times in skin.yaml, allowed once",
            "repeated id",
            name,
        )
        for name in dict.fromkeys(ids)
        if ids.count(name) > 1
    ]


def find_id_problems(
    ids: Int[np.ndarray, "taxel"], problems: list[SkinProblem], file: str
) -> list[SkinProblem]:
    """Find ids that are not 0 to n-1, provided that all rows could be read."""
    expected = np.arange(len(ids))
    if len(expected) == 0 and not problems:
        text = f"{file}: got no taxels, allowed one or more"
        return [SkinProblem(text, "no taxels")]
    missing = np.setdiff1d(expected, ids)
    if problems or len(missing) == 0:
        return []
    return [
        SkinProblem(
            f"{file}: id {missing[0]} is missing; allowed the ids 0 to "
            f"{len(expected) - 1}, each once, which fix the order of the taxels",
            "missing id",
        )
    ]


def resolve_inside(folder: Path, name: str, file: str) -> Path:
    """Return the path of a file in the folder; raise where it is outside."""
    # `Path.resolve` raises where links lead in a circle, before the file is read.
    target = Path(os.path.realpath(folder / name))
    if not target.is_relative_to(os.path.realpath(folder)):
        raise SkinError(
            f"{file}: got the file '{name}', which leaves the folder; allowed a file "
            "inside it"
        )
    return target


def read_text(file: Path, max_bytes: int) -> str:
    """Read a text file of a limited size, and turn exceptions into a `SkinError`."""
    try:
        return read_file(file, max_bytes).decode("utf-8-sig")
    except FileNotFoundError:
        raise SkinError(f"{file} does not exist; a skin is a folder with it") from None
    except UnicodeDecodeError as error:
        raise SkinError(
            f"{file}: byte {error.start} is not UTF-8; save the file as UTF-8 text"
        ) from None
    except OSError as error:
        raise SkinError(f"{file} cannot be read: {error.strerror}") from None


def parse_manifest(text: str, file: str) -> SkinManifest:
    """Read the text of a `skin.yaml`.

    Raises:
        SkinError: The message names the file and every wrong entry, in one line.
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
    return build_manifest(data, file)


def build_manifest(data: dict[str, object], source: str) -> SkinManifest:
    """Build a manifest of its entries.

    Raises:
        SkinError: The message names the source and every wrong entry, in one line.
    """
    try:
        return SkinManifest.model_validate(data)
    except ValidationError as error:
        lines = "; ".join(map(describe_manifest_error, error.errors()))
        raise SkinError(f"{source}: {lines}") from None


def format_manifest(skin: Skin, urdf: bytes | None = None) -> str:
    """Return the text of a skin's `skin.yaml`, with the digest of its robot's URDF."""
    entries: dict[str, object] = {
        "name": skin.name,
        "calibrated": bool(skin.calibrated),
        "robot_sha256": None if urdf is None else sha256(urdf).hexdigest(),
        "patches": [vars(patch) for patch in skin.patches],
    }
    manifest = build_manifest(entries, f"skin {skin.name!r}")
    data = manifest.model_dump(exclude_none=True)
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def describe_manifest_error(detail: ErrorDetails) -> str:
    """Describe a wrong entry: the given and the allowed value."""
    if detail["loc"] == ("robot_sha256",) and "pattern" in detail["type"]:
        return (
            f"robot_sha256: got {shorten(detail['input'])}, allowed is 64 hexadecimal "
            f"digits, the SHA-256 of {ROBOT_URDF}"
        )
    known = PatchEntry if len(detail["loc"]) > 1 else SkinManifest
    return describe_entry_error(detail, tuple(known.model_fields))
