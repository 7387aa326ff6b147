"""This module reads the poses of all taxels at each reading as joint positions."""

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, final

import numpy as np
from jaxtyping import Bool, Float, Num

from eskin.errors import ImportSourceError
from eskin.sets.joint_solver import JointSolver
from eskin.skin import MountedSkin

POSE_NUMBERS = (7, 12)
"""Numbers of a pose: position and quaternion, or the upper three rows of a matrix."""
MAX_DISTANCE = 0.002
"""Largest distance of a taxel from where the joint positions put it [m]."""
MAX_ANGLE = float(np.radians(20.0))
"""Largest angle between the z axis of a pose and the taxel's normal [rad]."""
MAX_DEVIATION = 0.01
"""Largest deviation of the length of an axis from 1."""
SCALES = (0.1, 10.0)
"""Ratios of lengths of poses to the skin's within which units may be equal."""

Rows = Num[np.ndarray, "reading number"]
Vectors = Float[np.ndarray, "reading taxel 3"]


@dataclass(frozen=True)
class PoseFit:
    """A pose fit says how well joint positions give measured poses back."""

    worst: float
    """Largest distance of a taxel from its measured place [m]."""
    rms: float
    """Root mean square distance of all taxels, of poses that differ [m]."""
    where: str
    """File, reading and taxel of the largest distance."""
    unsolved: tuple[str, ...]
    """Joints that move no taxel, which are set to zero."""


@final
class PoseReader:
    """Reads poses of all taxels as joint positions, and keeps how well they fit.

    Poses that are those of the reading before are not solved again.
    """

    def __init__(self, mounted: MountedSkin) -> None:
        """Start without any pose."""
        self.mounted = mounted
        self.solver = JointSolver(mounted)
        self.last: Rows | None = None
        self.last_q = np.zeros((1, len(mounted.robot.joint_names)))
        self.worst = 0.0
        self.where = ""
        self.squares = 0.0
        self.count = 0

    @property
    def fit(self) -> PoseFit | None:
        """How well the poses so far fit; None without any."""
        if not self.count:
            return None
        names = self.mounted.robot.joint_names
        moving = self.solver.moving.tolist()
        unsolved = [n for n, moves in zip(names, moving, strict=True) if not moves]
        rms = float(np.sqrt(self.squares / self.count))
        return PoseFit(self.worst, rms, self.where, tuple(unsolved))

    def read(
        self,
        path: Path,
        first: int,
        rows: Rows,
        q: Float[np.ndarray, "reading joint"] | None = None,
    ) -> Float[np.ndarray, "reading joint"]:
        """Return the joint positions [rad] or [m] of poses.

        Args:
            path: file of the poses, for messages.
            first: index of the first reading in the file.
            rows: poses of all taxels in turn, a reading a row.
            q: joint positions, if they are known; they are compared with the poses.

        Raises:
            ImportSourceError: they are no poses, or those of no joint positions.
        """
        is_new = self.find_new(rows) if q is None else np.ones(len(rows), np.bool_)
        places = [f"{path}: reading {first + n}" for n in np.flatnonzero(is_new)]
        positions, axes = self.parse(places, rows[is_new])
        new_q = self.solver.solve(positions) if q is None else q
        self.check(places, new_q, positions, axes)
        known = np.concatenate([self.last_q, new_q])[np.cumsum(is_new)]
        self.last = rows[-1:].copy()
        self.last_q = known[-1:]
        return known

    def find_new(self, rows: Rows) -> Bool[np.ndarray, "reading"]:
        """Find the readings whose poses differ from the reading before."""
        last = self.last
        is_same = last is not None and np.array_equal(last, rows[:1])
        return np.concatenate([[not is_same], (rows[1:] != rows[:-1]).any(axis=1)])

    def parse(self, places: list[str], rows: Rows) -> tuple[Vectors, Vectors]:
        """Return the positions [m] and the z axes of poses."""
        count = self.mounted.skin.count
        width = rows.shape[1] // count
        numbers = rows.astype(np.float64).reshape(len(rows), count, width)
        if width == POSE_NUMBERS[0]:
            positions = numbers[:, :, :3]
            w, x, y, z = np.moveaxis(numbers[:, :, 3:], 2, 0)
            up = w * w - x * x - y * y + z * z
            axes = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), up], axis=2)
        else:
            positions = numbers[:, :, 3::4]
            axes = numbers[:, :, 2::4]
        lengths = np.linalg.norm(axes, axis=2)
        is_finite = np.isfinite(numbers).all(axis=2)
        for row, taxel in np.argwhere(~is_finite)[:1].tolist():
            self.refuse(
                places[row],
                taxel,
                "has a pose that is not finite; allowed are numbers; leave the reading "
                "out",
            )
        is_wrong = np.abs(lengths - 1.0) > MAX_DEVIATION
        for row, taxel in np.argwhere(is_wrong)[:1].tolist():
            self.refuse(
                places[row],
                taxel,
                f"has a z axis of length {lengths[row, taxel]:.3g}; allowed is 1, of a "
                "position and a unit quaternion wxyz, or of the rows of [R | p]",
            )
        return positions, axes

    def check(
        self,
        places: list[str],
        q: Float[np.ndarray, "reading joint"],
        positions: Vectors,
        axes: Vectors,
    ) -> None:
        """Raise unless joint positions give poses back; keep how well they do."""
        placed, normals = self.mounted.place_taxels(q)
        distances = np.linalg.norm(placed - positions, axis=2)
        is_far = (distances > MAX_DISTANCE).any(axis=1)
        for row in np.flatnonzero(is_far)[:1].tolist():
            self.check_scale(places[row], positions[row])
            taxel = int(distances[row].argmax())
            root = self.mounted.kinematics.order[0, 0]
            self.refuse(
                places[row],
                taxel,
                f"lies {1e3 * distances[row, taxel]:.1f} mm from where the joint "
                f"positions put it; allowed are {1e3 * MAX_DISTANCE:g} mm, in the "
                f"frame of '{self.mounted.robot.link_names[root]}'; give the skin and "
                "the robot that were recorded, or correct the poses",
            )
        angles = np.arccos(np.clip((normals * axes).sum(axis=2), -1.0, 1.0))
        is_turned = (angles > MAX_ANGLE).any(axis=1)
        for row in np.flatnonzero(is_turned)[:1].tolist():
            taxel = int(angles[row].argmax())
            self.refuse(
                places[row],
                taxel,
                f"has a z axis {np.degrees(angles[row, taxel]):.0f} degrees from its "
                f"normal; allowed are {np.degrees(MAX_ANGLE):.0f}; write quaternions "
                "as wxyz, matrices row by row, and z along the normal",
            )
        greatest = float(distances.max(initial=0.0))
        if greatest > self.worst or not self.count:
            row, taxel = divmod(int(distances.argmax()), distances.shape[1])
            self.worst = greatest
            self.where = f"{places[row]}, {self.describe(taxel)}"
        self.squares += float((distances**2).sum())
        self.count += distances.size

    def check_scale(self, place: str, positions: Float[np.ndarray, "taxel 3"]) -> None:
        """Raise if lengths of poses seem to be in another unit than metres."""
        own = np.float64(0.0)
        measured = np.float64(0.0)
        for taxels in self.solver.taxels:
            own += np.linalg.norm(self.mounted.skin.positions[taxels].std(axis=0))
            measured += np.linalg.norm(positions[taxels].std(axis=0))
        scale = measured / own if own > 0 else 1.0
        if not SCALES[0] < scale < SCALES[1]:
            raise ImportSourceError(
                f"{place}: taxels of a link lie {scale:.3g} times as far apart as on "
                f"skin '{self.mounted.skin.name}'; allowed are positions in metres; "
                "convert them, or give the skin that was recorded"
            )

    def describe(self, taxel: int) -> str:
        """Return the number of a taxel, and where it is in the skin."""
        return f"taxel {taxel} ({self.mounted.skin.describe_taxel(taxel)})"

    def refuse(self, place: str, taxel: int, problem: str) -> NoReturn:
        """Raise with the place of a reading, a taxel and its mistake."""
        raise ImportSourceError(f"{place}: {self.describe(taxel)} {problem}")
