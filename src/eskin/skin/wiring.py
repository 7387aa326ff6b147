"""Whether taxels answer where the skin file says they are: pressed spot by spot."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from jaxtyping import Float, Int

from eskin.skin.skin import Skin

CORNERS = ((0.2, 0.2), (0.2, 0.8), (0.8, 0.2))
"""Rows and columns of a patch's three spots, as parts of its grid: no way of turning or
mirroring a patch leaves all three in place."""

BESIDE, BESIDE_SHARE = 2.5, 0.28
"""A finger is right when it meets the asked cell within so many rows and columns, and
within that part of a small grid."""


@dataclass(frozen=True)
class PressTarget:
    """A place to press."""

    patch: str
    """Patch it is on."""

    link: str
    """Link of that patch."""

    taxel: int
    """Taxel that should answer, as an index into the skin."""


@dataclass(frozen=True)
class PressResponse:
    """What was felt when a spot was pressed."""

    spot: PressTarget
    """Where it was to be pressed."""

    taxel: int | None
    """Taxel that felt most; None where nothing was felt."""


def choose_press_targets(skin: Skin) -> tuple[PressTarget, ...]:
    """Three spots on each patch, near three corners of its grid."""
    return tuple(
        PressTarget(patch.id, patch.link, nearest_cell(skin, patch.id, corner))
        for patch in skin.patches
        for corner in CORNERS
    )


def nearest_cell(skin: Skin, patch: str, corner: tuple[float, float]) -> int:
    """The taxel nearest to a place in a patch's grid, given as parts of it."""
    taxels = skin.find_taxels(patch)
    cells = cells_of(skin, taxels)
    place = cells.min(axis=0) + np.array(corner) * np.ptp(cells, axis=0)
    return int(taxels[np.argmin(np.linalg.norm(cells - place, axis=1))])


def cells_of(
    skin: Skin, taxels: Int[np.ndarray, "part"]
) -> Float[np.ndarray, "part 2"]:
    """Row and column of some taxels."""
    return np.column_stack([skin.rows[taxels], skin.columns[taxels]]).astype(float)


def check_wiring(skin: Skin, answers: Sequence[PressResponse]) -> list[str]:
    """What the answers say of each patch that is not as its file says.

    Args:
        skin: that was pressed.
        answers: of all spots, or of some patches' three.
    """
    found = []
    for patch in skin.patches:
        own = [answer for answer in answers if answer.spot.patch == patch.id]
        if own and (text := judge_patch(skin, patch.id, own)):
            found.append(text)
    return found


def judge_patch(skin: Skin, patch: str, answers: Sequence[PressResponse]) -> str | None:
    """What is wrong with a patch, with a remedy; None where nothing is."""
    felt = [answer.taxel for answer in answers if answer.taxel is not None]
    if len(felt) < len(answers):
        silent = len(answers) - len(felt)
        return (
            f"patch '{patch}' felt nothing at {silent} of {len(answers)} spots; check "
            "its cable, and press harder"
        )
    others = {skin.patches[int(skin.patch_index[taxel])].id for taxel in felt}
    if others != {patch}:
        names = ", ".join(f"'{other}'" for other in sorted(others))
        return (
            f"where patch '{patch}' was pressed, {names} answered; exchange their "
            "addresses or plugs"
        )
    turned = turn_of(skin, patch, answers)
    if turned == "":
        return None
    if turned is None:
        return (
            f"patch '{patch}' answered elsewhere than it was pressed; check the rows "
            "and columns in its file, and press again"
        )
    return f"patch '{patch}' has {turned}; mend its file, or its plugs"


def turn_of(skin: Skin, patch: str, answers: Sequence[PressResponse]) -> str | None:
    """How its rows and columns lie to what the file says.

    Returns:
        Nothing where they are right, else what is exchanged or reversed; None where
        that does not explain it.
    """
    cells = cells_of(skin, skin.find_taxels(patch))
    low, high = cells.min(axis=0), cells.max(axis=0)
    asked = cells_of(skin, np.array([answer.spot.taxel for answer in answers]))
    felt = cells_of(skin, np.array([answer.taxel for answer in answers]))
    beside = np.minimum(BESIDE, BESIDE_SHARE * (high - low))
    for axes, mirrored in product(permutations((0, 1)), product((0, 1), repeat=2)):
        share = (asked - low) / np.maximum(high - low, 1.0)
        share = np.where(mirrored, 1.0 - share, share)[:, axes]
        if (np.abs(low + share * (high - low) - felt) <= beside).all():
            return " and ".join(words_of(axes, mirrored))
    return None


def words_of(axes: Sequence[int], mirrored: Sequence[int]) -> list[str]:
    """What a way of turning does, in words."""
    words = [
        f"{name} reversed"
        for name, is_mirrored in zip(("rows", "columns"), mirrored, strict=True)
        if is_mirrored
    ]
    return words + (["rows and columns exchanged"] if tuple(axes) == (1, 0) else [])
