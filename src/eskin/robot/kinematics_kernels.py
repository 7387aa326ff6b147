"""This module computes forward kinematics in compiled code."""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled


@compiled
@no_type_check
def compute_link_poses(
    q: Float[np.ndarray, "pose joint"],
    order: Int[np.ndarray, "link 3"],
    mimic: Float[np.ndarray, "link 2"],
    motion: Float[np.ndarray, "link 4 3 4"],
    out: Float[np.ndarray, "pose link 4 4"],
) -> None:
    """Write T_world_link of every link at every pose.

    Args:
        q: values of the joints [rad] or [m].
        order: a link, its parent and the index in `q` of the joint between them, with
            parents before children; -1 for no parent or a fixed joint.
        mimic: multiplier and offset that turn a value of `q` into the joint's value.
        motion: matrices of each joint without their last row: the constant one, then
            those of sin q, 1 - cos q and q.
        out: the poses, which are written.
    """
    for n in range(len(q)):
        for i in range(len(order)):
            link, parent, source = order[i]
            T = out[n, link]
            for c in range(4):
                for r in range(3):
                    T[r, c] = motion[link, 0, r, c]
                T[3, c] = 0.0
            T[3, 3] = 1.0
            if source >= 0:
                value = q[n, source] * mimic[link, 0] + mimic[link, 1]
                add_joint_motion(value, motion[link], T)
            if parent >= 0:
                transform_to_world(out[n, parent], T)


@compiled
@no_type_check
def add_joint_motion(
    value: float, motion: Float[np.ndarray, "4 3 4"], T: Float[np.ndarray, "4 4"]
) -> None:
    """Add the motion of a joint at a value [rad] or [m] to its frame at value 0."""
    sine = math.sin(value)
    half = math.sin(0.5 * value)
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
def transform_to_world(
    T_world_parent: Float[np.ndarray, "4 4"], T: Float[np.ndarray, "4 4"]
) -> None:
    """Replace T_parent_link by T_world_link in place."""
    for c in range(4):
        x = T[0, c]
        y = T[1, c]
        z = T[2, c]
        one = T[3, c]
        for r in range(3):
            T[r, c] = (
                T_world_parent[r, 0] * x
                + T_world_parent[r, 1] * y
                + T_world_parent[r, 2] * z
                + T_world_parent[r, 3] * one
            )
