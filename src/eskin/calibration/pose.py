"""This module estimates how a patch is mounted, from presses at known points.

A patch lies elsewhere than its file says: its taxels are moved on their link by one
rotation and one shift. A press at a known point of the link is felt at a point of the
file; the motion that takes these points to the known ones is found by least squares.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import t as t_distribution

from eskin.calibration.guide import (
    PressGuide,
    PressRefusal,
    PressRequest,
    PressSummary,
)
from eskin.errors import SkinError
from eskin.files import read_file
from eskin.reasons import Reason
from eskin.skin import MountedSkin, Skin
from eskin.skin.surfaces import fit_centre
from eskin.touch import Calibration
from eskin.transforms import apply, exp_so3, log_so3, make_transform, rotate, skew

MIN_PRESSES = 5
"""Smallest number of presses of a patch: three place it, the others tell how well."""
MIN_SPREAD = 0.005
"""Smallest deviation of the known points from any line [m]."""
MIN_NOISE = 1e-4
"""Smallest deviation of a press that is assumed [m]."""
MAX_NOISE = 0.005
"""Largest deviation of a press along the surface that is believed [m]."""
USUAL_NOISE = (0.0008, 0.0003)
"""Deviation along and across the surface by which presses are chosen [m]."""
WIDE_TURN = 1.0
WIDE_SHIFT = 0.1
"""Deviation of rotation [rad] and shift [m] before the first press."""
ITERATIONS = 30
CONVERGED = 1e-10
"""Change of the estimate at which iterations end [rad] or [m]."""
CONFIDENCE = 0.95
MAX_BYTES = 1 << 20
"""Largest size of a file of points [bytes]."""
TARE_SECONDS = 3.0
"""Time without touch at the start [s]."""
MM = 1e-3

Points = Float[np.ndarray, "press 3"]


@dataclass(frozen=True)
class KnownPoint:
    """A known point is a place on the outside of a patch, measured on its link."""

    patch: str
    """Id of the patch that is pressed there."""
    p_link: tuple[float, float, float]
    """Position in the frame of the patch's link [m]."""


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """An estimate says how a patch is moved from where its file has it."""

    patch: str
    """Id of the patch."""
    centre: Float[np.ndarray, "3"]
    """Middle of the taxels of the file, about which the rotation is [m]."""
    rotation: Float[np.ndarray, "3"]
    """Rotation vector, in the frame of the link [rad]."""
    shift: Float[np.ndarray, "3"]
    """Shift of the middle, in the frame of the link [m]."""
    covariance: Float[np.ndarray, "6 6"]
    """Covariance of rotation [rad] and shift [m]."""
    noise: tuple[float, float]
    """Deviation of a press along the surface, in each direction, and across it [m]."""
    freedom: float
    """Degrees of freedom from which the noise was estimated."""

    @property
    def T_true_file(self) -> Float[np.ndarray, "4 4"]:  # noqa: N802
        """Return the motion from positions of the file to the true ones."""
        turn = exp_so3(self.rotation)
        return make_transform(turn, self.centre + self.shift - turn @ self.centre)

    @property
    def deviations(self) -> Float[np.ndarray, "6"]:
        """Return standard deviations of rotation [rad] and shift [m]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_widths(self) -> Float[np.ndarray, "6"]:
        """Return half the widths of the 95 % confidence intervals, by Student's t.

        They are of each component of rotation [rad] and shift [m].
        """
        quantile = t_distribution.ppf(0.5 + CONFIDENCE / 2, self.freedom)
        return float(quantile) * self.deviations


def find_felt_point(
    skin: Skin,
    taxels: Int[np.ndarray, "some"],
    pressure: Float[np.ndarray, "some"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Find the centre of pressure on the surface of a patch, and its outward normal.

    The mean of places on a curved surface lies below it; it is lifted onto the sphere
    that passes nearest to the taxels.

    Args:
        skin: the skin.
        taxels: pressed taxels of one patch.
        pressure: pressure on each of them [kPa].
    """
    force = pressure * skin.areas[taxels]
    force = force / force.sum()
    places = skin.positions[taxels]
    normals = skin.normals[taxels]
    normal = force @ normals
    normal /= np.linalg.norm(normal)
    radius, centre = fit_centre(places, normals)
    mean = force @ places
    if radius == 0.0:
        return mean, normal
    # Only across the surface: along it the centre of pressure counts.
    lift = (centre + radius * normal - mean) @ normal
    return mean + lift * normal, normal


def estimate_pose(
    skin: Skin, patch: str, known: Points, felt: Points, normals: Points
) -> PoseEstimate:
    """Estimate how a patch is moved from where its file has it.

    Presses deviate along the surface, as a finger is aimed and felt, and less across
    it. Both deviations are estimated with the motion, by iterated least squares.

    Args:
        skin: skin of the file.
        patch: id of the patch.
        known: points of the link that were pressed, in its frame [m].
        felt: points of the file at which they were felt, in that frame [m].
        normals: outward unit normals of the file there.

    Raises:
        ValueError: There are too few presses, or they lie along a line.
    """
    check_presses(patch, known)
    centre = find_middle(skin, patch)
    turn = np.eye(3)
    shift = np.zeros(3)
    noise = np.array([1e-3, 1e-3])
    freedom = np.ones(2)
    shares = np.ones(2)
    inverse = np.zeros((6, 6))
    for _ in range(ITERATIONS):
        arm = (felt - centre) @ turn.T
        jacobian, weights, across = linearise(arm, normals @ turn.T, noise)
        left = known - (centre + shift + arm)
        squares = np.einsum("pia,pij,pjb->ab", jacobian, weights, jacobian)
        step = np.linalg.solve(
            squares, np.einsum("pia,pij,pj->a", jacobian, weights, left)
        )
        turn = exp_so3(step[:3]) @ turn
        shift = shift + step[3:]
        left = left - jacobian @ step
        inverse = np.linalg.inv(squares)
        kinds = np.stack([np.eye(3) - across, across])
        used = np.einsum("kpij,pja,ab,pib->k", kinds, jacobian, inverse, jacobian)
        shares = used / noise**2
        freedom = np.array([2.0, 1.0]) * len(known) - shares
        found = np.einsum("kpij,pi,pj->k", kinds, left, left)
        previous = noise
        noise = np.sqrt(np.maximum(found / np.maximum(freedom, 1.0), MIN_NOISE**2))
        if max(np.abs(step).max(), np.abs(noise - previous).max()) < CONVERGED:
            break
    return PoseEstimate(
        patch=patch,
        centre=centre,
        rotation=log_so3(turn),
        shift=shift,
        covariance=inverse,
        noise=(float(noise[0]), float(noise[1])),
        # Each deviation counts by the part of the motion that rests on it.
        freedom=float(shares.sum() / np.sum(shares / np.maximum(freedom, 1.0))),
    )


def find_middle(skin: Skin, patch: str) -> Float[np.ndarray, "3"]:
    """Find the mean of the positions of a patch's taxels [m]."""
    return skin.positions[skin.find_taxels(patch)].mean(axis=0)


def linearise(
    arm: Points, normals: Points, noise: Sequence[float] | Float[np.ndarray, "2"]
) -> tuple[
    Float[np.ndarray, "press 3 6"],
    Float[np.ndarray, "press 3 3"],
    Float[np.ndarray, "press 3 3"],
]:
    """Linearise places of presses in a small rotation and shift of their patch.

    Args:
        arm: places from the middle of the patch [m].
        normals: outward unit normals there.
        noise: deviation of a press along the surface and across it [m].

    Returns:
        The derivative of each place by rotation and shift, the weight of its error, and
        the projection onto its normal.
    """
    across = normals[:, :, None] * normals[:, None]
    weights = (np.eye(3) - across) / noise[0] ** 2 + across / noise[1] ** 2
    jacobian = np.concatenate(
        [-skew(arm), np.tile(np.eye(3), (len(arm), 1, 1))], axis=2
    )
    return jacobian, weights, across


def choose_taxels(skin: Skin, patch: str, count: int) -> Int[np.ndarray, "press"]:
    """Choose taxels of a patch whose presses tell most of how it is turned.

    They are chosen one after the other so that the variance of the rotation is smallest
    (A-optimality, Pukelsheim 2006), each once.

    Args:
        skin: skin of the file.
        patch: id of the patch.
        count: number of presses.

    Raises:
        ValueError: The patch has fewer taxels.
    """
    taxels = skin.find_taxels(patch)
    if not MIN_PRESSES <= count <= len(taxels):
        raise ValueError(
            f"{count} presses are asked for on patch '{patch}'; allowed are "
            f"{MIN_PRESSES} to {len(taxels)}, one a taxel"
        )
    arm = skin.positions[taxels] - find_middle(skin, patch)
    jacobian, weights, _ = linearise(arm, skin.normals[taxels], USUAL_NOISE)
    squares = np.einsum("pia,pij,pjb->pab", jacobian, weights, jacobian)
    found = np.diag([1.0 / WIDE_TURN**2] * 3 + [1.0 / WIDE_SHIFT**2] * 3)
    left = np.ones(len(taxels), bool)
    chosen = []
    for _ in range(count):
        covariance = np.linalg.inv(found + squares)
        variance = np.trace(covariance[:, :3, :3], axis1=1, axis2=2)
        best = int(np.argmin(np.where(left, variance, np.inf)))
        found = found + squares[best]
        left[best] = False
        chosen.append(best)
    return taxels[chosen]


def check_presses(patch: str, known: Points) -> None:
    """Raise where presses cannot place a patch."""
    if len(known) < MIN_PRESSES:
        raise ValueError(
            f"patch '{patch}' has {len(known)} presses; allowed are {MIN_PRESSES} or "
            "more"
        )
    spread = np.linalg.svd(known - known.mean(axis=0), compute_uv=False)
    deviation = float(spread[1]) / np.sqrt(len(known))
    if deviation < MIN_SPREAD:
        raise ValueError(
            f"the points of patch '{patch}' lie {1e3 * deviation:.1f} mm from a line; "
            f"allowed are {1e3 * MIN_SPREAD:g} mm or more; spread them over the patch"
        )


def move_patch(skin: Skin, estimate: PoseEstimate) -> Skin:
    """Return a skin with a patch where it was estimated to be."""
    taxels = skin.find_taxels(estimate.patch)
    T = estimate.T_true_file
    moves = {"positions": apply, "normals": rotate, "tangents": rotate}
    moved = {name: getattr(skin, name).copy() for name in moves}
    for name, move in moves.items():
        moved[name][taxels] = move(T, moved[name][taxels])
    return replace(skin, **moved)


def read_points(path: Path, skin: Skin) -> tuple[KnownPoint, ...]:
    """Read known points from a CSV file with columns patch, x_mm, y_mm and z_mm.

    Raises:
        SkinError: The file cannot be read, has an error, or names a patch that the skin
            does not have.
    """
    try:
        text = read_file(path, MAX_BYTES).decode()
        rows = list(csv.DictReader(StringIO(text)))
    except OSError as error:
        raise SkinError(f"cannot read {path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise SkinError(f"{path}: no CSV text ({error})") from None
    names = {patch.id for patch in skin.patches}
    points = []
    for number, row in enumerate(rows, 2):
        try:
            x, y, z = (MM * float(row[f"{axis}_mm"]) for axis in "xyz")
            if row["patch"] not in names or not np.isfinite([x, y, z]).all():
                raise ValueError
        except (KeyError, TypeError, ValueError):
            raise SkinError(
                f"{path}: line {number} is {','.join(map(str, row.values()))!r:.60}; "
                "allowed is a patch of the skin and three numbers, below the head "
                "patch,x_mm,y_mm,z_mm"
            ) from None
        points.append(KnownPoint(row["patch"], (x, y, z)))
    if not points:
        raise SkinError(
            f"{path} has no points; allowed are lines below the head "
            "patch,x_mm,y_mm,z_mm"
        )
    return tuple(points)


@dataclass(frozen=True, eq=False)
class PosePress:
    """A press was felt where a known point was pressed."""

    number: int
    """Index of the known point."""
    point: KnownPoint
    felt: Float[np.ndarray, "3"]
    """Centre of pressure in the frame of the link, by the file [m]."""
    normal: Float[np.ndarray, "3"]
    """Outward unit normal of the file there."""


@final
class PoseGuide(PressGuide[PosePress]):
    """A guide asks for presses at known points, one after the other.

    Attributes:
        points: all points.
        waiting: indices of those that are still to be pressed, in order.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        calibration: Calibration,
        points: Sequence[KnownPoint],
    ) -> None:
        """Start with some seconds without touch."""
        super().__init__(mounted, calibration, TARE_SECONDS)
        self.points = tuple(points)
        self.waiting = list(range(len(points)))

    def find_refusal(self, press: PressSummary, taxel: int) -> Reason | None:
        """Return on which other patch a press was felt; None if it can be used."""
        patch = self.skin.patches[int(self.skin.patch_index[taxel])].id
        asked = self.points[self.waiting[0]].patch
        return None if patch == asked else PressRefusal.OTHER_PATCH.reason(patch=patch)

    def build_press(self, press: PressSummary, taxel: int) -> PosePress:
        """Build the press of the point that is asked for from its mean pressure."""
        number = self.waiting.pop(0)
        point = self.points[number]
        total = press.sum_pressure()
        own = self.skin.find_taxels(point.patch)
        taxels = own[total[own] > 0]
        felt, normal = find_felt_point(self.skin, taxels, total[taxels])
        return PosePress(number, point, felt, normal)

    @property
    def press_share(self) -> float:
        """Share of the points that is done."""
        return 1.0 - len(self.waiting) / len(self.points)

    @property
    def request(self) -> PressRequest | None:
        """Point to press next; None where all are pressed or left out."""
        if not self.waiting:
            return None
        number = self.waiting[0]
        skin = self.skin
        point = self.points[number]
        own = skin.find_taxels(point.patch)
        distances = np.linalg.norm(skin.positions[own] - point.p_link, axis=1)
        taxel = int(own[np.argmin(distances)])
        return PressRequest(f"point {number + 1}", taxel, point.p_link)

    def leave_out(self) -> None:
        """Leave out the point that is asked for."""
        self.waiting.pop(0)

    def ask_again(self, press: PosePress) -> None:
        """Ask for the point of a press again."""
        self.waiting.insert(0, press.number)

    def estimate(self, patch: str) -> PoseEstimate:
        """Estimate the pose of a patch from its presses so far.

        Raises:
            ValueError: The patch has too few presses, or they lie along a line.
        """
        own = [press for press in self.presses if press.point.patch == patch]
        found = [(press.point.p_link, press.felt, press.normal) for press in own]
        known, felt, normals = np.array(found).reshape(-1, 3, 3).swapaxes(0, 1)
        return estimate_pose(self.skin, patch, known, felt, normals)

    def finish(self) -> tuple[PoseEstimate, ...]:
        """Estimate the poses of the patches that were pressed.

        Raises:
            ValueError: Rest was not measured, a patch has too few presses, they lie
                along a line, or they do not fit its points.
        """
        self.check_rested()
        patches = dict.fromkeys(press.point.patch for press in self.presses)
        if not patches:
            raise ValueError(
                f"no press was felt; allowed are {MIN_PRESSES} or more of a patch; "
                "press more firmly, at the points of the file in their order"
            )
        found = tuple(map(self.estimate, patches))
        for each in found:
            if each.noise[0] > MAX_NOISE:
                raise ValueError(
                    f"presses of patch '{each.patch}' scatter by "
                    f"{1e3 * each.noise[0]:.1f} mm; allowed are {1e3 * MAX_NOISE:g} "
                    "mm; press every point of the file once, in its order, after the "
                    f"first {self.rest_seconds:g} s"
                )
        return found
