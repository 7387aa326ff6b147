"""This module classifies windows by smooth surfaces fitted to the pressure.

It stands for Kubus et al. 2017 in the paper's Table I: 16 gestures on 2048 taxels, told
apart by a support vector machine. The paper says of it only "spline fitting for spatial
feature extraction" (section II). All else is our choice: which splines, the distance of
their knots, the smoothing, the parts in time, and moments of the surfaces as features.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import BSpline

from eskin.skin import MountedSkin, Skin
from lab.baselines.convolution import unroll_about_axis
from lab.baselines.estimators import Estimator
from lab.baselines.flat import PRESSURE_UNIT, TIME_BINS
from lab.baselines.interface import READINGS, RowBaseline, SkinWindows

DEGREE = 3
"""Degree of the splines."""

KNOT_DISTANCE = 0.03
"""Distance between knots [m], about the width of a finger's print."""

SMOOTHING = 0.1
"""Weight of the penalty on second differences of coefficients."""


@dataclass(frozen=True, eq=False)
class SplineSurface:
    """A spline surface is fitted to the pressures of one link's taxels, unrolled.

    It is linear in the pressures, so that it is one matrix (Eilers and Marx 1996).
    """

    taxels: Int[np.ndarray, "part"]
    """Indices of the taxels of the link."""
    smooth: Float[np.ndarray, "part part"]
    """Matrix from pressures to heights of the surface, both at the taxels."""
    places: Float[np.ndarray, "part 2"]
    """Place of each taxel along the link and around it [m]."""


def build_surfaces(skin: Skin) -> list[SplineSurface]:
    """Return the surface of each link that has taxels."""
    links = np.array(skin.link_names)[skin.patch_index]
    return [
        build_surface(skin, np.flatnonzero(links == link))
        for link in dict.fromkeys(skin.link_names)
    ]


def build_surface(skin: Skin, taxels: Int[np.ndarray, "part"]) -> SplineSurface:
    """Return the surface of some taxels of one link."""
    points = unroll_link(skin.positions[taxels], skin.normals[taxels])
    along = build_basis(points[:, 0])
    around = build_basis(points[:, 1])
    basis = (along[:, :, None] * around[:, None, :]).reshape(len(taxels), -1)
    penalty = np.kron(penalise(along.shape[1]), np.eye(around.shape[1]))
    penalty += np.kron(np.eye(along.shape[1]), penalise(around.shape[1]))
    # The small identity decides on coefficients that no taxel and no penalty does.
    normal = basis.T @ basis + SMOOTHING * penalty + 1e-6 * np.eye(len(penalty))
    return SplineSurface(taxels, basis @ np.linalg.solve(normal, basis.T), points)


def unroll_link(
    positions: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> Float[np.ndarray, "part 2"]:
    """Return places of taxels along a link and around it [m]; the seam is not closed.

    Around it they are as far apart, root mean square, as the taxels are across it.
    """
    along, angle = unroll_about_axis(positions, normals)
    # The seam lies in the widest gap between the angles.
    order = np.sort(angle)
    gaps = np.diff(order, append=order[0] + 2 * np.pi)
    seam = order[(gaps.argmax() + 1) % len(order)]
    around = (angle - seam) % (2 * np.pi)
    across = np.sqrt(max(positions.var(axis=0).sum() - along.var(), 0.0))
    scale = across / around.std() if around.std() > 0 else 0.0
    return np.stack([along, scale * around], axis=1)


def build_basis(places: Float[np.ndarray, "part"]) -> Float[np.ndarray, "part basis"]:
    """Return the B-splines at places along one axis [m]."""
    low = places.min()
    length = max(float(np.ptp(places)), 1e-6)
    spans = max(1, round(length / KNOT_DISTANCE))
    step = length / spans
    knots = low + step * np.arange(-DEGREE, spans + DEGREE + 1)
    inside = np.clip(places, low, low + length * (1 - 1e-9))
    return BSpline.design_matrix(inside, knots, DEGREE).toarray()


def penalise(count: int) -> Float[np.ndarray, "basis basis"]:
    """Return the penalty on second differences of coefficients."""
    differences = np.diff(np.eye(count), 2, axis=0)
    return differences.T @ differences


@final
class SplineBaseline(RowBaseline):
    """This baseline classifies moments of fitted surfaces.

    One surface a link is fitted to the mean pressure in each of ten parts of a window.
    Coefficients of the splines as features, alone or with moments, were less accurate
    on simulated clips of their own (`lab/notes/comparison.md`).
    """

    def __init__(
        self, mounted: MountedSkin, estimator: Callable[[int], Estimator]
    ) -> None:
        """Create an untrained baseline; arguments are as in `RowBaseline`."""
        super().__init__(mounted, estimator)
        self.surfaces = build_surfaces(mounted.skin)

    def compute_rows(self, clips: SkinWindows) -> Float[np.ndarray, "clip feature"]:
        """Return the features of each window."""
        parts = (TIME_BINS, READINGS // TIME_BINS)
        shape = (clips.count, *parts, self.mounted.skin.count)
        means = clips.pressure.reshape(shape).mean(axis=2, dtype=np.float32)
        means /= PRESSURE_UNIT
        moments = [
            compute_moments(means[..., each.taxels] @ each.smooth.T, each.places)
            for each in self.surfaces
        ]
        rows = np.concatenate(moments, axis=-1).reshape(clips.count, -1)
        return rows.astype(np.float32)


def compute_moments(
    heights: Float[np.ndarray, "*part taxel"], places: Float[np.ndarray, "taxel 2"]
) -> Float[np.ndarray, "*part 6"]:
    """Return the moments of surfaces; zeros where there is no pressure.

    They are sum and maximum, and centre and spread (root mean square) along both axes.
    """
    load = np.maximum(heights, 0.0)
    total = load.sum(axis=-1, keepdims=True)
    share = load / np.maximum(total, 1e-6)
    centre = share @ places
    spread = np.sqrt(np.maximum(share @ places**2 - centre**2, 0.0))
    largest = load.max(axis=-1, keepdims=True)
    return np.concatenate([total, largest, centre, spread], axis=-1)
