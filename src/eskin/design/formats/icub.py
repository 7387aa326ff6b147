"""This module reads and writes files of positions as in `skinGui` of the iCub.

A file is a patch. It has a line of six numbers for each channel, position and normal,
all zero where a channel has no taxel. Its `taxel2Repr` has a number for each channel,
below zero for what is no taxel: -2 for a thermal pad, -1 for nothing.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.design.formats import ICUB_SUFFIX
from eskin.design.formats.patch_taxels import (
    MAX_SIDE,
    PatchTaxels,
    estimate_areas,
    format_numbers,
    join_patches,
    number_taxels,
    read_source,
)
from eskin.errors import SkinError
from eskin.files import atomic_path, parse_number
from eskin.skin.skin import Skin
from eskin.skin.taxel_table import (
    MAX_TABLE_BYTES,
    MAX_TAXELS,
    compute_default_tangents,
)

ICUB_CHANNELS = 12
"""Number of channels of a triangle of the iCub's skin: a row of its patch."""
THERMAL = -2
"""Number of a thermal pad in `taxel2Repr`."""
MIN_NORMAL = 0.5
"""Smallest length of a normal in a file, which is scaled to 1."""

logger = logging.getLogger(__name__)


def read_icub_positions(
    files: Sequence[Path], name: str, link: str | None = None
) -> Skin:
    """Read files of positions as in the iCub's `skinGui`, each as a patch.

    A row of the patch is a triangle of 12 channels, unless the file says `columns`.

    Args:
        files: the files.
        name: name of the skin.
        link: link of the patches; None for the `name` in each file.

    Raises:
        SkinError: A file cannot be read, or has an error.
    """
    parts = [read_icub_part(file, link) for file in files]
    return join_patches(name, parts, files[0] if len(files) == 1 else files[0].parent)


def read_icub_part(file: Path, link: str | None) -> PatchTaxels:
    """Read one file of positions."""
    try:
        lines = read_source(file, MAX_TABLE_BYTES).decode().splitlines()
    except UnicodeDecodeError as error:
        raise SkinError(f"{file}: byte {error.start} is not UTF-8") from None
    heads = [line.strip().lower() for line in lines]
    if "[calibration]" not in heads:
        raise SkinError(
            f"{file} has no line [calibration]; allowed is one, above the positions; "
            "name a file of positions of the iCub's skin"
        )
    start = heads.index("[calibration]") + 1
    facts = dict(
        line.split(None, 1) for line in lines[: start - 1] if len(line.split()) > 1
    )
    link = link or facts.get("name", "").strip()
    if not link:
        raise SkinError(
            f"{file} has no name, which tells the link; allowed is a line 'name LINK'; "
            "give it with --link"
        )
    width = facts.get("columns", str(ICUB_CHANNELS)).strip()
    if not width.isdecimal() or not 1 <= int(width) <= MAX_SIDE:
        raise SkinError(
            f"{file}: columns is '{width:.40}'; allowed are 1 to {MAX_SIDE}"
        )
    table = read_icub_table(file, lines, start)
    is_placed = np.any(table != 0.0, axis=1)
    kinds = read_channel_kinds(file, facts.get("taxel2Repr"), len(table))
    used = np.flatnonzero(is_placed & (kinds >= 0))
    if len(used) == 0:
        raise SkinError(
            f"{file} has no taxels, only zeros and what taxel2Repr says is none; "
            "allowed is one or more; name a part with taxels"
        )
    left_out = {
        "thermal pads": kinds == THERMAL,
        "without a position": ~is_placed & (kinds >= 0),
        "unused": (kinds < 0) & (kinds != THERMAL),
    }
    told = [f"{flags.sum()} {what}" for what, flags in left_out.items() if flags.any()]
    if told:
        counts = f"{len(used)} of {len(table)} channels are taxels"
        logger.warning("%s: %s; left out: %s", file, counts, ", ".join(told))
    columns = int(width)
    lengths = np.linalg.norm(table[used, 3:], axis=1)
    short = used[lengths < MIN_NORMAL]
    if len(short):
        raise SkinError(
            f"{file}: the normal of channel {short[0]} has length "
            f"{np.linalg.norm(table[short[0], 3:]):.3g}; allowed is 1"
        )
    normals = table[used, 3:] / lengths[:, None]
    return PatchTaxels(
        id=file.stem,
        link=link,
        rows=used // columns,
        columns=used % columns,
        extent=(-(-len(table) // columns), columns),
        positions=table[used, :3],
        normals=normals,
        areas=estimate_areas(table[used, :3], str(file)),
        tangents=compute_default_tangents(normals),
        index=used,
    )


def read_channel_kinds(
    file: Path, text: str | None, count: int
) -> Int[np.ndarray, "channel"]:
    """Read the numbers of `taxel2Repr`; all are taxels of a file without it."""
    if text is None:
        return np.zeros(count, np.int64)
    words = text.strip().removeprefix("(").removesuffix(")").split()
    try:
        numbers = np.array([parse_number(word) for word in words])
        kinds = numbers.astype(np.int64)
        if len(kinds) != count:
            raise ValueError(f"{len(kinds)} numbers for {count} positions")
        if (kinds != numbers).any():
            raise ValueError("numbers with a fraction")
    except (OverflowError, ValueError) as error:
        raise SkinError(
            f"{file}: taxel2Repr has {error}; allowed is one whole number for each "
            "position, below 0 where it is no taxel"
        ) from None
    return kinds


def read_icub_table(
    file: Path, lines: Sequence[str], start: int
) -> Float[np.ndarray, "channel 6"]:
    """Read the positions and normals of all channels, zeros where there is no taxel."""
    rows = []
    for number, line in enumerate(lines[start:], start + 1):
        words = line.split()
        if not words:
            continue
        try:
            row = [parse_number(word) for word in words]
            # Older files have a seventh number: the confidence of the position.
            if len(row) not in (6, 7):
                raise ValueError
        except ValueError:
            raise SkinError(
                f"{file}: line {number} is '{line.strip():.60}'; allowed are x, y, z "
                "and the normal's x, y, z"
            ) from None
        rows.append(row[:6])
    if not 1 <= len(rows) <= MAX_TAXELS:
        raise SkinError(f"{file} has {len(rows)} positions; allowed: 1 to {MAX_TAXELS}")
    return np.array(rows)


def write_icub_positions(folder: Path, skin: Skin) -> None:
    """Write a file of positions for each patch of a skin, named by its id."""
    for patch in skin.patches:
        taxels = skin.find_taxels(patch.id)
        channels = number_taxels(skin, taxels)
        table = np.zeros((patch.rows * patch.columns, 6))
        table[channels, :3] = skin.positions[taxels]
        table[channels, 3:] = skin.normals[taxels]
        own = np.full(len(table), -1)
        own[channels] = channels
        lines = [f"name\t{patch.link}", "spatial_sampling\ttaxel"]
        if patch.columns != ICUB_CHANNELS:
            lines.append(f"columns\t{patch.columns}")
        lines.append(f"taxel2Repr ( {'  '.join(map(str, own.tolist()))} )")
        lines.append("[calibration]")
        lines += map(format_numbers, table)
        with atomic_path(folder / f"{patch.id}{ICUB_SUFFIX}") as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")
