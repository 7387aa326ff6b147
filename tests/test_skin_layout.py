"""Tests of surfaces and grids: surfaces keep lengths and areas, and can be fitted."""

import numpy as np
import pytest

from eskin.skin import (
    Dome,
    Patch,
    Plane,
    TaxelGrid,
    Tube,
    build_skin,
    cut_corners,
    fit_surface,
)
from eskin.transforms import apply, make_transform, random_rotation, rotate
from helpers.surfaces import surface_distances

RNG = np.random.default_rng(3)
T_LINK_SURFACE = make_transform(random_rotation(RNG), RNG.standard_normal(3))
FLAT = [Plane(T_LINK_SURFACE), Tube(0.05, T_LINK_SURFACE)]
SURFACES = pytest.mark.parametrize(
    "surface", [*FLAT, Dome(0.06, T_LINK_SURFACE)], ids=lambda s: type(s).__name__
)
STEP = 1e-6


def random_unrolled(seed=0, reach=0.05):
    """Return random points (s, t) of an unrolled surface [m]."""
    return np.random.default_rng(seed).uniform(-reach, reach, (40, 2))


def differentiate(surface, unrolled, step):
    """Return the derivative of positions in the direction of a step."""
    ahead = surface.wrap(unrolled + step)
    behind = surface.wrap(unrolled - step)
    return (ahead.positions - behind.positions) / (2 * STEP)


def straight_distances(points):
    """Return the distance of each pair of points in space."""
    return np.linalg.norm(points[:, None] - points, axis=-1)


@SURFACES
def test_unrolling_undoes_wrapping(surface):
    unrolled = random_unrolled()
    np.testing.assert_allclose(
        surface.unroll(surface.wrap(unrolled).positions), unrolled, atol=1e-12
    )


@SURFACES
def test_normals_tangents_and_areas_agree_with_finite_differences(surface):
    unrolled = random_unrolled()
    wrapped = surface.wrap(unrolled)
    along_s, along_t = (
        differentiate(surface, unrolled, step) for step in STEP * np.eye(2)
    )
    for directions in (wrapped.normals, wrapped.tangents):
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(
        np.cross(along_s, along_t),
        wrapped.area_scale[:, None] * wrapped.normals,
        atol=1e-7,
    )
    across = np.sum(wrapped.normals * wrapped.tangents, axis=1)
    np.testing.assert_allclose(across, 0, atol=1e-12)
    if surface in FLAT:
        np.testing.assert_allclose(along_s, wrapped.tangents, atol=1e-7)


@SURFACES
def test_surface_distances_are_a_metric_no_shorter_than_straight_lines(surface):
    points = surface.wrap(random_unrolled()).positions
    far = surface_distances(surface, points, points)
    np.testing.assert_allclose(far, far.T)
    np.testing.assert_allclose(np.diag(far), 0, atol=1e-8)
    assert np.all(far >= straight_distances(points) - 1e-12)
    assert np.all(far[:, :, None] + far[None] >= far[:, None] - 1e-9)
    points = surface.wrap(random_unrolled(reach=1e-5)).positions
    near = surface_distances(surface, points, points)
    np.testing.assert_allclose(near, straight_distances(points), rtol=1e-5, atol=1e-8)


def test_distance_around_a_tube_is_that_of_the_shorter_way():
    tube = Tube(0.05, np.eye(4))
    around = 2 * np.pi * 0.05
    ends = tube.wrap(np.array([[-0.49 * around, 0.0], [0.49 * around, 0.03]]))
    far = surface_distances(tube, ends.positions[:1], ends.positions[1:])
    np.testing.assert_allclose(far, np.hypot(0.02 * around, 0.03))


@SURFACES
def test_surface_is_fitted_to_its_taxels_in_any_pose(surface):
    wrapped = surface.wrap(random_unrolled())
    other = surface.wrap(random_unrolled(seed=1))
    T = make_transform(random_rotation(np.random.default_rng(5)), np.ones(3))
    expected = surface_distances(surface, wrapped.positions, other.positions)
    for pose in (np.eye(4), T):
        points = apply(pose, wrapped.positions)
        others = apply(pose, other.positions)
        fitted = fit_surface(points, rotate(pose, wrapped.normals))
        assert type(fitted) is type(surface)
        if not isinstance(fitted, Plane):
            assert fitted.radius == pytest.approx(surface.radius)
        assert fitted.fit_errors(others, rotate(pose, other.normals)).max() < 1e-9
        np.testing.assert_allclose(surface_distances(fitted, points, others), expected)


def test_no_surface_is_fitted_to_other_points():
    dome = Dome(0.06, np.eye(4))
    tube = Tube(0.05, np.eye(4))
    on_dome, on_tube = (surface.wrap(random_unrolled()) for surface in (dome, tube))
    squeezed = on_dome.positions * [1.0, 0.8, 1.0]
    assert fit_surface(squeezed, on_dome.normals) is None
    assert fit_surface(np.zeros((0, 3)), np.zeros((0, 3))) is None
    assert fit_surface(on_tube.positions, -on_tube.normals) is None


def test_taxels_on_a_dome_cover_the_area_of_the_dome():
    # A square drawn flat, its side 2a, as a fine sum over the sphere (r sin u = rho).
    radius = 0.06
    pitch = 0.005
    count = 12
    patch = Patch("cap", "arm", 1, count, count)
    grid = TaxelGrid(count, count, pitch, pitch)
    skin = build_skin("cap", [(patch, grid, Dome(radius, np.eye(4)))])
    angle = (np.arange(20000) + 0.5) * np.pi / 2 / 20000
    edge = pitch * count / 2 / np.maximum(np.cos(angle), np.sin(angle))
    exact = 4 * radius**2 * np.mean(1 - np.cos(edge / radius)) * np.pi / 2
    assert skin.areas.sum() == pytest.approx(exact, rel=1e-3)


def test_grid_is_centred_and_its_taper_narrows_the_last_row():
    grid = TaxelGrid(3, 5, 0.01, 0.01, taper=0.5)
    s, t = grid.unrolled().T
    widths = [np.ptp(s[t == level]) for level in np.unique(t)]
    assert widths == pytest.approx([0.04, 0.03, 0.02])
    assert (s.mean(), t.mean()) == pytest.approx((0, 0))
    assert grid.areas()[[0, 5, 10]] == pytest.approx([1e-4, 0.75e-4, 0.5e-4])


def test_cut_corners_are_staircases():
    rows = ["-###--", "#####-", "-#####", "--####", "---###"]
    expected = [[cell == "#" for cell in row] for row in rows]
    np.testing.assert_array_equal(cut_corners(5, 6, (1, 2, 3, 0)), expected)
