"""This module builds skins from the patches that files of other projects hold.

None of these files holds bus addresses or units, so patches get the addresses 1, 2, 3
and so on, and measure pressure in kPa.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinError
from eskin.files import read_file
from eskin.near import measure_nearest
from eskin.skin.check import check_crowding, find_fatal_problems
from eskin.skin.skin import Patch, Skin
from eskin.skin.taxel_table import MAX_TAXELS

MAX_SIDE = 65_535
"""Largest number of rows, and of columns, of a patch."""

Vectors = Float[np.ndarray, "taxel 3"]


@dataclass(frozen=True, eq=False)
class PatchTaxels:
    """A patch with its taxels, as they are read from a file."""

    id: str
    link: str
    rows: Int[np.ndarray, "taxel"]
    columns: Int[np.ndarray, "taxel"]
    extent: tuple[int, int]
    """Number of rows and of columns."""
    positions: Vectors
    normals: Vectors
    areas: Float[np.ndarray, "taxel"]
    tangents: Vectors
    index: Int[np.ndarray, "taxel"]
    """Number of each taxel in its data, by which taxels are ordered."""
    channel: str | None = None
    """Data that the numbers are of, which patches may share; None for its own."""


ARRAYS = ("rows", "columns", "positions", "normals", "areas", "tangents")
"""Fields of `PatchTaxels` with a value of each taxel, as in a `Skin`."""


def join_patches(name: str, parts: Sequence[PatchTaxels], file: Path) -> Skin:
    """Join patches to a skin, whose taxels are in the order of their data.

    That is channel by channel, and by their numbers inside.

    Raises:
        SkinError: There are no taxels, too many, or some that no skin may have; or two
            have one number.
    """
    count = sum(len(part.rows) for part in parts)
    if not 1 <= count <= MAX_TAXELS:
        raise SkinError(f"{file} has {count} taxels; allowed are 1 to {MAX_TAXELS}")
    repeated = [part.id for part in parts]
    if len(set(repeated)) < len(repeated):
        twice = next(each for each in repeated if repeated.count(each) > 1)
        raise SkinError(f"{file} has patch '{twice}' twice; allowed is once")
    channels = [part.channel or f"patch '{part.id}'" for part in parts]
    names = list(dict.fromkeys(channels))
    counts = [len(part.rows) for part in parts]
    group = np.repeat([names.index(each) for each in channels], counts)
    index = np.concatenate([part.index for part in parts])
    order = np.lexsort((index, group))
    same = (np.diff(group[order]) == 0) & (np.diff(index[order]) == 0)
    if same.any():
        first = order[int(np.argmax(same))]
        raise SkinError(
            f"{file} has number {index[first]} of {names[group[first]]} twice; allowed "
            "is once, as a number tells which value of the data is the taxel's"
        )
    arrays: dict[str, Any] = {
        field: np.concatenate([getattr(part, field) for part in parts])[order]
        for field in ARRAYS
    }
    skin = Skin(
        name=name,
        patches=tuple(
            Patch(part.id, part.link, number, *part.extent)
            for number, part in enumerate(parts, 1)
        ),
        patch_index=np.repeat(np.arange(len(parts)), counts)[order],
        **arrays,
    )
    if problems := find_fatal_problems(skin):
        raise SkinError(f"{file}: {problems[0]}")
    check_crowding(skin, str(file))
    return skin


def number_taxels(
    skin: Skin, taxels: Int[np.ndarray, "some"]
) -> Int[np.ndarray, "some"]:
    """Return the numbers of some taxels in their data, which rise in their order.

    They are those of the cells of their grid, row by row, where these rise.
    """
    widths = np.array([patch.columns for patch in skin.patches])
    width = widths[skin.patch_index[taxels]]
    cells = skin.rows[taxels] * width + skin.columns[taxels]
    return cells if (np.diff(cells) > 0).all() else np.arange(len(taxels))


def read_source(file: Path, max_bytes: int) -> bytes:
    """Read a file of a limited size, and turn exceptions into a `SkinError`."""
    try:
        return read_file(file, max_bytes)
    except OSError as error:
        raise SkinError(f"cannot read {file}: {error.strerror}") from None


def estimate_areas(positions: Vectors, place: str) -> Float[np.ndarray, "taxel"]:
    """Estimate the areas of taxels from the distance of nearest neighbours [m2].

    Args:
        positions: positions of the taxels of a patch [m].
        place: file or patch, for messages.

    Raises:
        SkinError: There is one taxel, or most lie in one place.
    """
    if len(positions) < 2:
        raise SkinError(
            f"{place}: a patch of one taxel has no spacing to tell its area by; "
            "allowed are two taxels or more; leave it out"
        )
    nearest = measure_nearest(positions, 1)
    if not np.median(nearest) > 0:
        raise SkinError(
            f"{place}: {np.count_nonzero(nearest == 0)} of {len(positions)} taxels lie "
            "where another is; allowed is a place for each; leave placeholders out"
        )
    return np.full(len(positions), float(np.median(nearest)) ** 2)


def format_numbers(numbers: Sequence[float] | np.ndarray) -> str:
    """Format numbers without loss, with spaces between them."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)
