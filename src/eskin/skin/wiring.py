"""This module checks that taxels respond where the skin file says, press by press."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, permutations, product

import numpy as np
from jaxtyping import Float, Int

from eskin.skin.skin import Skin

CORNERS = ((0.2, 0.2), (0.2, 0.8), (0.8, 0.2))
"""Rows and columns of a patch's three targets, as fractions of its grid. Every rotation
and reflection of a patch moves at least one of them."""
MAX_ERROR = 2.5
MAX_ERROR_FRACTION = 0.28
"""Largest error of a press in rows or columns, and as a fraction of a small grid."""


@dataclass(frozen=True)
class PressTarget:
    """A target is a taxel to press."""

    patch: str
    link: str
    taxel: int
    """Index of the taxel."""


@dataclass(frozen=True)
class PressResponse:
    """A response is what was measured when a target was pressed."""

    target: PressTarget
    """Target that was to be pressed."""
    taxel: int | None
    """Index of the taxel of greatest pressure; None where there was no press."""


def choose_press_targets(skin: Skin) -> tuple[PressTarget, ...]:
    """Choose three targets on each patch, near three corners of its grid."""
    return tuple(
        PressTarget(patch.id, patch.link, find_nearest_taxel(skin, patch.id, corner))
        for patch in skin.patches
        for corner in CORNERS
    )


def find_nearest_taxel(skin: Skin, patch: str, corner: tuple[float, float]) -> int:
    """Return the taxel of a patch nearest to a place in fractions of its grid."""
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
    """Describe each patch whose responses differ from its file, with all of them.

    Responses are those of all targets, or of the three of some patches.
    """
    texts = []
    for patch in skin.patches:
        own = [response for response in responses if response.target.patch == patch.id]
        if own and (text := check_patch(skin, patch.id, own)):
            felt = ", ".join(describe_response(skin, response) for response in own)
            texts.append(f"{text} ({felt})")
    return texts


def describe_response(skin: Skin, response: PressResponse) -> str:
    """Describe which taxel was to be pressed, and where that was felt."""
    target = response.target.taxel
    felt = "not felt"
    if response.taxel == target:
        felt = "felt there"
    elif response.taxel is not None:
        felt = f"felt at {skin.describe_taxel(response.taxel)}"
    return f"{skin.describe_taxel(target)} {felt}"


def check_patch(
    skin: Skin, patch: str, responses: Sequence[PressResponse]
) -> str | None:
    """Describe the mistake of a patch, with a remedy; None without one."""
    measured = [response.taxel for response in responses if response.taxel is not None]
    silent = len(responses) - len(measured)
    if silent:
        return (
            f"patch '{patch}' did not respond at {silent} of {len(responses)} targets; "
            "check its cable, and press harder"
        )
    others = {skin.patches[int(skin.patch_index[taxel])].id for taxel in measured}
    if others != {patch}:
        names = ", ".join(f"'{other}'" for other in sorted(others))
        return (
            f"where patch '{patch}' was pressed, {names} responded; exchange their "
            "addresses or plugs"
        )
    reordering = find_reordering(skin, patch, responses)
    if reordering is None:
        return (
            f"patch '{patch}' responded elsewhere than it was pressed; check the rows "
            "and columns in its file, and press again"
        )
    if reordering:
        return f"patch '{patch}' has {reordering}; correct its file, or its plugs"
    return None


def find_reordering(
    skin: Skin, patch: str, responses: Sequence[PressResponse]
) -> str | None:
    """Find how the rows and columns of a patch are reordered.

    Returns:
        What is exchanged or reversed, empty where nothing is; None where no reordering
        explains the responses.
    """
    cells = get_cells(skin, skin.find_taxels(patch))
    low, high = cells.min(axis=0), cells.max(axis=0)
    pressed = get_cells(skin, np.array([r.target.taxel for r in responses]))
    measured = get_cells(skin, np.array([r.taxel for r in responses]))
    max_error = np.minimum(MAX_ERROR, MAX_ERROR_FRACTION * (high - low))
    for axes, mirrored in product(permutations((0, 1)), product((0, 1), repeat=2)):
        fraction = (pressed - low) / np.maximum(high - low, 1.0)
        fraction = np.where(mirrored, 1.0 - fraction, fraction)[:, axes]
        if (np.abs(low + fraction * (high - low) - measured) <= max_error).all():
            changes = (*mirrored, axes == (1, 0))
            words = ("rows reversed", "columns reversed", "rows and columns exchanged")
            return " and ".join(compress(words, changes))
    return None
