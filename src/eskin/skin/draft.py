"""A skin as far as its files can be read, with what is wrong with the rest."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from eskin.errors import SkinError
from eskin.skin.directions import default_tangents
from eskin.skin.manifest import Manifest, parse_manifest
from eskin.skin.problem import Problem
from eskin.skin.skin import Skin
from eskin.skin.table import Table, parse_table

MANIFEST = "skin.yaml"


@dataclass(frozen=True, eq=False)
class Draft:
    """The readable taxels of a skin's files, sorted by id, and every problem."""

    skin: Skin
    """The skin made of the rows that could be read."""

    ids: Int[np.ndarray, "taxel"]
    """The id that each of them has in the file."""

    problems: tuple[Problem, ...]
    """What is wrong with the rows that could not be read, and with the ids."""


def read_draft(path: Path) -> Draft:
    """Read a folder with `skin.yaml` and its taxels, as far as it can be read.

    Raises:
        SkinError: if there is no such folder, or its files are no skin files.
    """
    file = path if path.name == MANIFEST else path / MANIFEST
    manifest = parse_manifest(read_text(file), str(file))
    taxels = inside(file.parent, manifest.taxels, str(file))
    return make_draft(manifest, read_text(taxels), str(taxels))


def make_draft(manifest: Manifest, table_text: str, file: str) -> Draft:
    """Put a manifest and the text of its taxels together."""
    patches = manifest.patch_list()
    table, problems = parse_table(table_text, patches, file)
    problems = [*repeated_patches(manifest), *problems, *gaps(table, problems, file)]
    order = np.argsort(table.ids, kind="stable")
    normals = table.normals[order]
    if table.tangents is None:
        tangents = default_tangents(normals)
    else:
        tangents = table.tangents[order]
    skin = Skin(
        name=manifest.name,
        patches=patches,
        patch_index=table.patch_index[order],
        rows=table.rows[order],
        columns=table.columns[order],
        positions=table.positions[order],
        normals=normals,
        areas=table.areas[order],
        tangents=tangents,
        calibrated=manifest.calibrated,
    )
    return Draft(skin, table.ids[order], tuple(problems))


def repeated_patches(manifest: Manifest) -> list[Problem]:
    """Patch ids that stand more than once."""
    ids = [entry.id for entry in manifest.patches]
    return [
        Problem(f"stands {ids.count(name)} times in skin.yaml, allowed once", name)
        for name in dict.fromkeys(ids)
        if ids.count(name) > 1
    ]


def gaps(table: Table, problems: list[Problem], file: str) -> list[Problem]:
    """Ids that are not 0 to n-1; only worth saying where all rows could be read."""
    expected = np.arange(len(table.ids))
    if len(expected) == 0 and not problems:
        return [Problem(f"{file}: got no taxels, allowed one or more")]
    missing = np.setdiff1d(expected, table.ids)
    if problems or len(missing) == 0:
        return []
    return [
        Problem(
            f"{file}: id {missing[0]} is missing; allowed the ids 0 to "
            f"{len(expected) - 1}, each once, which fix the order of the taxels"
        )
    ]


def inside(folder: Path, name: str, file: str) -> Path:
    """The file of that name in the folder; anything outside it is refused."""
    target = (folder / name).resolve()
    if not target.is_relative_to(folder.resolve()):
        raise SkinError(
            f"{file}: taxels: got '{name}', which leaves the folder; allowed a file "
            "inside it"
        )
    return target


def read_text(file: Path) -> str:
    """Read a text file, or say in one line why not."""
    try:
        return file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SkinError(f"{file} does not exist; a skin is a folder with it") from None
    except UnicodeDecodeError as error:
        raise SkinError(
            f"{file}: byte {error.start} is not UTF-8; save the file as UTF-8 text"
        ) from None
    except OSError as error:
        raise SkinError(f"{file} cannot be read: {error.strerror}") from None
