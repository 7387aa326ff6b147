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
from scipy.spatial import KDTree

from eskin.errors import SkinError
from eskin.files import read_file
from eskin.skin.check import check_crowding, find_direction_problems
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


ARRAYS = ("rows", "columns", "positions", "normals", "areas", "tangents")
"""Fields of `PatchTaxels` with a value of each taxel, as in a `Skin`."""


def join_patches(name: str, parts: Sequence[PatchTaxels], file: Path) -> Skin:
    """Join patches to a skin; its taxels are ordered by patch, row and column.

    Raises:
        SkinError: There are no taxels, too many, or some that no skin may have.
    """
    count = sum(len(part.rows) for part in parts)
    if not 1 <= count <= MAX_TAXELS:
        raise SkinError(f"{file} has {count} taxels; allowed are 1 to {MAX_TAXELS}")
    repeated = [part.id for part in parts]
    if len(set(repeated)) < len(repeated):
        twice = next(each for each in repeated if repeated.count(each) > 1)
        raise SkinError(
            f"{file} has patch '{twice}' twice; allowed is once; rename one"
        )
    orders = [np.lexsort((part.columns, part.rows)) for part in parts]

    def join(field: str) -> np.ndarray:
        return np.concatenate(
            [getattr(p, field)[order] for p, order in zip(parts, orders, strict=True)]
        )

    arrays: dict[str, Any] = {name: join(name) for name in ARRAYS}
    skin = Skin(
        name=name,
        patches=tuple(
            Patch(part.id, part.link, number, *part.extent)
            for number, part in enumerate(parts, 1)
        ),
        patch_index=np.repeat(
            np.arange(len(parts)), [len(part.rows) for part in parts]
        ),
        **arrays,
    )
    if problems := find_direction_problems(skin):
        raise SkinError(f"{file}: {problems[0]}")
    check_crowding(skin, str(file))
    return skin


def read_source(file: Path, max_bytes: int) -> bytes:
    """Read a file of a limited size, and turn exceptions into a `SkinError`."""
    try:
        return read_file(file, max_bytes)
    except OSError as error:
        raise SkinError(f"cannot read {file}: {error.strerror}") from None


def estimate_areas(positions: Vectors) -> Float[np.ndarray, "taxel"]:
    """Estimate the areas of taxels from the distance of nearest neighbours [m2]."""
    if len(positions) < 2:
        raise SkinError(
            "a patch of one taxel has no spacing to tell its area by; allowed are two "
            "taxels or more; leave it out"
        )
    nearest = KDTree(positions).query(positions, k=2)[0][:, 1]
    return np.full(len(positions), float(np.median(nearest)) ** 2)


def format_numbers(numbers: Sequence[float] | np.ndarray) -> str:
    """Format numbers without loss, with spaces between them."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)
