"""The compiled forward kinematics. `no_type_check` keeps the tests' hooks off."""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled


@compiled
@no_type_check
def pose_links(
    q: Float[np.ndarray, "pose joint"],
    order: Int[np.ndarray, "link 3"],
    gear: Float[np.ndarray, "link 2"],
    motion: Float[np.ndarray, "link 4 3 4"],
    out: Float[np.ndarray, "pose link 4 4"],
) -> None:
    """Write T_world_link of every link at every pose.

    Args:
        q: values of the joints [rad] or [m].
        order: parents before children: a link, its parent and the place in `q` of the
            joint between them; -1 where there is none, or where it does not move.
        gear: by link, multiplier and offset that make its joint's value from `q`.
        motion: by link, matrices without their last row: the parent's frame at rest,
            then what sin q, 1 - cos q and q multiply.
        out: where they go.
    """
    for n in range(len(q)):
        for i in range(len(order)):
            link, parent, source = order[i]
            T = out[n, link]
            T[:3] = motion[link, 0]
            T[3, :3], T[3, 3] = 0.0, 1.0
            if source >= 0:
                value = q[n, source] * gear[link, 0] + gear[link, 1]
                turn(math.sin(value), math.sin(0.5 * value), value, motion[link], T)
            if parent >= 0:
                hang(out[n, parent], T)


@compiled
@no_type_check
def turn(
    sine: float,
    half: float,
    value: float,
    motion: Float[np.ndarray, "4 3 4"],
    T: Float[np.ndarray, "4 4"],
) -> None:
    """Add a joint's motion to its frame at rest.

    Args:
        sine: of its value.
        half: sine of half its value.
        value: of the joint [rad] or [m].
        motion: see `pose_links`.
        T: the frame.
    """
    versine = 2.0 * half * half
    for r in range(3):
        for c in range(4):
            T[r, c] += (
                sine * motion[1, r, c]
                + versine * motion[2, r, c]
                + value * motion[3, r, c]
            )


@compiled
@no_type_check
def hang(parent: Float[np.ndarray, "4 4"], T: Float[np.ndarray, "4 4"]) -> None:
    """Replace a frame in its parent by the same in the world."""
    for c in range(4):
        x, y, z, one = T[0, c], T[1, c], T[2, c], T[3, c]
        for r in range(3):
            T[r, c] = (
                parent[r, 0] * x
                + parent[r, 1] * y
                + parent[r, 2] * z
                + parent[r, 3] * one
            )
