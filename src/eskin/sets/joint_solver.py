"""This module solves the joint positions of a robot from the places of its taxels."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.skin import MountedSkin

STARTS = 128
"""Number of joint positions from which a pose is solved that is far from the last."""
MAX_ITERATIONS = 60
CONVERGED = 1e-10
"""Change of the joint positions at which iterations end [rad] or [m]."""
DOUBTED = 0.001
"""Root mean square distance of a link's taxels above which a solution may be that of
another minimum [m]."""
JACOBIAN_STEP = 1e-6
"""Joint step of the finite differences of the Jacobian [rad] or [m]."""
DAMPING = 1e-6
"""First damping, by the mean squared motion of the taxels by a joint."""
MOTIONLESS = 1e-6
"""Derivative of all columns up to which a joint moves no taxel."""

TURN = 2 * np.pi


@final
class JointSolver:
    """This solver finds the joint positions that put taxels where they were measured.

    The sum of the squared distances of all taxels is minimised by damped least squares
    (Marquardt 1963), from the joint positions of the reading before; where these lead
    to no solution, from many. Joints that move no taxel stay at zero.

    The homogeneous positions of the taxels of each link are factored into `weights @
    columns` with orthonormal weights (QR). The sum of squared distances of the taxels
    from measured places is then, but for a constant, that of the four columns from the
    weighted sums of these places, under every pose of the link.

    Attributes:
        mounted: the skin on its robot.
        moving: whether each joint moves a taxel.
        is_free: whether each joint moves a taxel, and a full turn of it none.
    """

    def __init__(self, mounted: MountedSkin) -> None:
        """Factor the positions of the taxels of each link."""
        self.mounted = mounted
        self.links = np.unique(mounted.taxel_link_index)
        self.taxels = [
            np.flatnonzero(mounted.taxel_link_index == link) for link in self.links
        ]
        factors = [
            factor_positions(mounted.skin.positions[taxels]) for taxels in self.taxels
        ]
        self.weights = [weights for weights, _ in factors]
        self.columns = np.array([columns for _, columns in factors])
        self.counts = np.array([len(taxels) for taxels in self.taxels])
        low = np.maximum(mounted.robot.lower, -np.pi)
        high = np.minimum(mounted.robot.upper, np.pi)
        rng = np.random.default_rng(0)
        self.starts = rng.uniform(low, high, (STARTS, len(low)))
        _, jacobian = self.linearise(self.starts)
        greatest = np.abs(jacobian).max(axis=(0, 1), initial=0.0)
        self.moving = greatest > MOTIONLESS
        self.starts[:, ~self.moving] = 0.0
        followed = {joint.mimic.joint for joint in mounted.robot.joints if joint.mimic}
        turning = [
            joint.kind != "prismatic" and joint.name not in followed
            for joint in mounted.robot.actuated_joints
        ]
        self.is_free = np.array(turning, np.bool_) & self.moving
        self.last = np.zeros(len(low))

    def solve(
        self, positions: Float[np.ndarray, "reading taxel 3"]
    ) -> Float[np.ndarray, "reading joint"]:
        """Return joint positions [rad] or [m], given positions of all taxels [m].

        The readings of a call, and those of one call after another, are in the order of
        time.
        """
        found = np.empty((len(positions), len(self.last)))
        for number, target in enumerate(self.weigh(positions)):
            q = self.minimise(self.last[None], target)
            if self.measure_distances(q, target)[0] > DOUBTED:
                tried = np.concatenate([q, self.minimise(self.starts, target)])
                best = np.argmin(self.measure_distances(tried, target))
                q = tried[best, None]
            self.last = self.unwind(q[0])
            found[number] = self.last
        return found

    def unwind(self, q: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "joint"]:
        """Return a solution less full turns: near the last one, and within limits."""
        robot = self.mounted.robot
        turns = np.rint((q - self.last) / TURN)
        turns += np.ceil(np.maximum(q - turns * TURN - robot.upper, 0.0) / TURN)
        turns -= np.ceil(np.maximum(robot.lower - q + turns * TURN, 0.0) / TURN)
        return q - turns * TURN * self.is_free

    def weigh(
        self, positions: Float[np.ndarray, "reading taxel 3"]
    ) -> Float[np.ndarray, "reading link 3 4"]:
        """Return the weighted sums of positions, which the columns should reach."""
        parts = [
            positions[:, taxels].swapaxes(1, 2) @ weights
            for taxels, weights in zip(self.taxels, self.weights, strict=True)
        ]
        return np.stack(parts, axis=1)

    def place(self, q: Float[np.ndarray, "n joint"]) -> Float[np.ndarray, "n link 3 4"]:
        """Return the columns of each link in the world at joint positions."""
        T_world_link = self.mounted.kinematics.poses(q)[:, self.links, :3]
        return T_world_link @ self.columns.swapaxes(1, 2)

    def linearise(
        self, q: Float[np.ndarray, "n joint"]
    ) -> tuple[
        Float[np.ndarray, "n coordinate"], Float[np.ndarray, "n coordinate joint"]
    ]:
        """Return the coordinates of all columns at joint positions, and derivatives."""
        joints = q.shape[1]
        shifted = np.concatenate(
            [q[:, None], q[:, None] + JACOBIAN_STEP * np.eye(joints)], axis=1
        )
        placed = self.place(shifted.reshape(-1, joints))
        placed = placed.reshape(len(q), 1 + joints, -1)
        derivatives = (placed[:, 1:] - placed[:, :1]) / JACOBIAN_STEP
        return placed[:, 0], derivatives.swapaxes(1, 2)

    def minimise(
        self,
        start: Float[np.ndarray, "n joint"],
        target: Float[np.ndarray, "link 3 4"],
    ) -> Float[np.ndarray, "n joint"]:
        """Return the joint positions to which each start leads."""
        q = start
        identity = np.eye(start.shape[1])
        damping = np.full(len(start), DAMPING)
        for _ in range(MAX_ITERATIONS):
            placed, jacobian = self.linearise(q)
            error = target.ravel() - placed
            transposed = jacobian.swapaxes(1, 2)
            squares = transposed @ jacobian
            scale = np.trace(squares, axis1=1, axis2=2) / max(len(identity), 1)
            damped = squares + (damping * scale)[:, None, None] * identity
            step = np.linalg.solve(damped, transposed @ error[:, :, None])[:, :, 0]
            left = (target - self.place(q + step)).reshape(len(q), -1)
            is_better = (left**2).sum(axis=1) < (error**2).sum(axis=1)
            q = np.where(is_better[:, None], q + step, q)
            damping = damping * np.where(is_better, 0.1, 100.0)
            if np.abs(step).max(initial=0.0) < CONVERGED:
                break
        return q

    def measure_distances(
        self, q: Float[np.ndarray, "n joint"], target: Float[np.ndarray, "link 3 4"]
    ) -> Float[np.ndarray, "n"]:
        """Return the root mean square distance [m] of the taxels of the worst link."""
        squares = ((self.place(q) - target) ** 2).sum(axis=(2, 3))
        return np.sqrt((squares / self.counts).max(axis=1))


def factor_positions(
    positions: Float[np.ndarray, "part 3"],
) -> tuple[Float[np.ndarray, "part 4"], Float[np.ndarray, "4 4"]]:
    """Factor homogeneous positions into orthonormal weights and four columns.

    Of fewer than four taxels, weights and columns are filled with zeros.
    """
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    weights, columns = np.linalg.qr(homogeneous)
    lacking = 4 - len(columns)
    return (
        np.pad(weights, ((0, 0), (0, lacking))),
        np.pad(columns, ((0, lacking), (0, 0))),
    )
