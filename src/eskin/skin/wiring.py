"""This module checks, press by press, that taxels respond where the file says."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from jaxtyping import Float, Int

from eskin.skin.skin import Skin

CORNERS = ((0.2, 0.2), (0.2, 0.8), (0.8, 0.2))
"""Rows and columns of a patch's three targets, as fractions of its grid. No rotation or
reflection of a patch maps all three to themselves."""

MAX_ERROR, MAX_ERROR_FRACTION = 2.5, 0.28
"""Largest error of a press in rows and columns, and as a fraction of a small grid."""


@dataclass(frozen=True)
class PressTarget:
    """A target is a place to press."""

    patch: str
    """Id of its patch."""

    link: str
    """Name of the link of that patch."""

    taxel: int
    """Index of the taxel that should respond."""


@dataclass(frozen=True)
class PressResponse:
    """A response is what was measured when a target was pressed."""

    target: PressTarget
    """Place that should have been pressed."""

    taxel: int | None
    """Index of the taxel with most pressure; None where there was none."""


def choose_press_targets(skin: Skin) -> tuple[PressTarget, ...]:
    """Choose three targets on each patch, near three corners of its grid."""
    return tuple(
        PressTarget(patch.id, patch.link, find_nearest_taxel(skin, patch.id, corner))
        for patch in skin.patches
        for corner in CORNERS
    )


def find_nearest_taxel(skin: Skin, patch: str, corner: tuple[float, float]) -> int:
    """Return the taxel nearest to a place, which is given as fractions of the grid."""
    taxels = skin.find_taxels(patch)
    cells = get_cells(skin, taxels)
    target = cells.min(axis=0) + np.array(corner) * np.ptp(cells, axis=0)
    return int(taxels[np.argmin(np.linalg.norm(cells - target, axis=1))])


def get_cells(
    skin: Skin, taxels: Int[np.ndarray, "part"]
) -> Float[np.ndarray, "part 2"]:
    """Return row and column of some taxels."""
    return np.column_stack([skin.rows[taxels], skin.columns[taxels]]).astype(float)


def check_wiring(skin: Skin, responses: Sequence[PressResponse]) -> list[str]:
    """Describe each patch whose responses differ from its file.

    Args:
        skin: the skin that was pressed.
        responses: responses of all targets, or those of the three of some patches.
    """
    found = []
    for patch in skin.patches:
        own = [response for response in responses if response.target.patch == patch.id]
        if own and (text := check_patch(skin, patch.id, own)):
            found.append(text)
    return found


def check_patch(
    skin: Skin, patch: str, responses: Sequence[PressResponse]
) -> str | None:
    """Describe what is wrong with a patch, with a remedy; None where nothing is."""
    felt = [response.taxel for response in responses if response.taxel is not None]
    if len(felt) < len(responses):
        silent = len(responses) - len(felt)
        return (
            f"patch '{patch}' did not respond at {silent} of {len(responses)} targets; "
            "check its cable, and press harder"
        )
    others = {skin.patches[int(skin.patch_index[taxel])].id for taxel in felt}
    if others != {patch}:
        names = ", ".join(f"'{other}'" for other in sorted(others))
        return (
            f"where patch '{patch}' was pressed, {names} responded; exchange their "
            "addresses or plugs"
        )
    reordering = find_reordering(skin, patch, responses)
    if reordering == "":
        return None
    if reordering is None:
        return (
            f"patch '{patch}' responded elsewhere than it was pressed; check the rows "
            "and columns in its file, and press again"
        )
    return f"patch '{patch}' has {reordering}; correct its file, or its plugs"


def find_reordering(
    skin: Skin, patch: str, responses: Sequence[PressResponse]
) -> str | None:
    """Find how the rows and columns of a patch differ from its file.

    Returns:
        An empty text where they do not, else what is exchanged or reversed; None where
        that does not explain the responses.
    """
    cells = get_cells(skin, skin.find_taxels(patch))
    low, high = cells.min(axis=0), cells.max(axis=0)
    asked = get_cells(skin, np.array([response.target.taxel for response in responses]))
    felt = get_cells(skin, np.array([response.taxel for response in responses]))
    max_error = np.minimum(MAX_ERROR, MAX_ERROR_FRACTION * (high - low))
    for axes, mirrored in product(permutations((0, 1)), product((0, 1), repeat=2)):
        share = (asked - low) / np.maximum(high - low, 1.0)
        share = np.where(mirrored, 1.0 - share, share)[:, axes]
        if (np.abs(low + share * (high - low) - felt) <= max_error).all():
            return " and ".join(describe_reordering(axes, mirrored))
    return None


def describe_reordering(axes: Sequence[int], mirrored: Sequence[int]) -> list[str]:
    """Describe an exchange and reversals in words."""
    words = [
        f"{name} reversed"
        for name, is_mirrored in zip(("rows", "columns"), mirrored, strict=True)
        if is_mirrored
    ]
    return words + (["rows and columns exchanged"] if tuple(axes) == (1, 0) else [])
