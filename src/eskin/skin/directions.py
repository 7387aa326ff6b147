"""The directions a taxel has: its outward normal and its local x axis."""

import numpy as np
from jaxtyping import Float

from eskin.skin.problem import Problem
from eskin.skin.skin import Skin

DIRECTION_TOLERANCE = 1e-3


# What overflows is no unit vector, and refused as such.
@np.errstate(over="ignore", invalid="ignore")
def default_tangents(
    normals: Float[np.ndarray, "taxel 3"],
) -> Float[np.ndarray, "taxel 3"]:
    """Local x axes for taxels that have none: the link's x axis laid flat.

    Where the normal is nearly along x, the link's y axis is laid flat instead.
    """
    seed = np.where(np.abs(normals[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    across = seed - np.sum(seed * normals, axis=1, keepdims=True) * normals
    return across / np.linalg.norm(across, axis=1, keepdims=True)


@np.errstate(over="ignore", invalid="ignore")
def direction_problems(skin: Skin) -> list[Problem]:
    """Normals and tangents that are not unit vectors at right angles."""
    lengths = np.linalg.norm(skin.normals, axis=1)
    spans = np.linalg.norm(skin.tangents, axis=1)
    leaning = np.abs(np.sum(skin.normals * skin.tangents, axis=1))
    allowed = f"allowed 1 +- {DIRECTION_TOLERANCE:g}"
    lean_allowed = f"allowed up to {DIRECTION_TOLERANCE:g}"
    found: list[Problem] = []
    for what, got, wrong, bounds in (
        ("normal has length", lengths, off_one(lengths), allowed),
        ("tangent has length", spans, off_one(spans), allowed),
        (
            "tangent is not at a right angle to the normal: their product is",
            leaning,
            ~(leaning <= DIRECTION_TOLERANCE) & ~off_one(lengths) & ~off_one(spans),
            lean_allowed,
        ),
    ):
        for taxel in np.flatnonzero(wrong):
            patch = skin.patches[skin.patch_index[taxel]].id
            text = f"{what} {got[taxel]:.6g}, {bounds}"
            found.append(Problem(text, patch, int(taxel)))
    return found


def off_one(lengths: Float[np.ndarray, "taxel"]) -> np.ndarray:
    """Where a length is not one; NaN is not one."""
    return ~(np.abs(lengths - 1.0) <= DIRECTION_TOLERANCE)
