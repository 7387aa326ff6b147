"""Surfaces keep lengths and areas, and are found again from the taxels on them."""

import numpy as np
import pytest
from benchmarks.skin_distance import surface_distances

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


def surfaces():
    rng = np.random.default_rng(3)
    T_link_surface = make_transform(random_rotation(rng), rng.standard_normal(3))
    return [
        Plane(T_link_surface),
        Tube(0.05, T_link_surface),
        Dome(0.06, T_link_surface),
    ]


KINDS = pytest.mark.parametrize("surface", surfaces(), ids=lambda s: type(s).__name__)


def drawing(seed=0, count=40, reach=0.05):
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 2))


@KINDS
def test_unrolling_undoes_wrapping(surface):
    unrolled = drawing()
    assert np.allclose(surface.unroll(surface.wrap(unrolled).positions), unrolled)


@KINDS
def test_directions_are_unit_and_at_right_angles(surface):
    wrapped = surface.wrap(drawing())
    for directions in (wrapped.normals, wrapped.tangents):
        assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.allclose(np.sum(wrapped.normals * wrapped.tangents, axis=1), 0)


@KINDS
def test_normal_and_stretch_are_those_of_finite_differences(surface):
    unrolled, h = drawing(), 1e-6
    by_s, by_t = (
        (
            surface.wrap(unrolled + step).positions
            - surface.wrap(unrolled - step).positions
        )
        / (2 * h)
        for step in h * np.eye(2)
    )
    wrapped = surface.wrap(unrolled)
    area = np.cross(by_s, by_t)
    assert np.allclose(area, wrapped.area_scale[:, None] * wrapped.normals, atol=1e-7)


@pytest.mark.parametrize("surface", surfaces()[:2], ids=["Plane", "Tube"])
def test_the_tangent_is_the_way_in_which_s_grows(surface):
    unrolled, h = drawing(), 1e-6
    ahead = surface.wrap(unrolled + [h, 0]).positions
    behind = surface.wrap(unrolled - [h, 0]).positions
    assert np.allclose((ahead - behind) / (2 * h), surface.wrap(unrolled).tangents)


@KINDS
def test_distances_are_a_metric_no_shorter_than_straight_lines(surface):
    points = surface.wrap(drawing()).positions
    far = surface_distances(surface, points, points)
    straight = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert np.allclose(far, far.T) and np.allclose(np.diag(far), 0, atol=1e-8)
    assert np.all(far >= straight - 1e-12)
    assert np.all(far[:, :, None] + far[None] >= far[:, None] - 1e-9)


@KINDS
def test_small_distances_are_straight(surface):
    unrolled = drawing(reach=1e-5)
    points = surface.wrap(unrolled).positions
    straight = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert np.allclose(surface_distances(surface, points, points), straight, rtol=1e-5)


def test_the_way_round_a_tube_is_the_shorter_one():
    tube = Tube(0.05, np.eye(4))
    whole = 2 * np.pi * 0.05
    ends = tube.wrap(np.array([[-0.49 * whole, 0.0], [0.49 * whole, 0.03]]))
    far = surface_distances(tube, ends.positions[:1], ends.positions[1:])
    assert np.allclose(far, np.hypot(0.02 * whole, 0.03))


@KINDS
def test_the_surface_is_found_again_from_its_taxels(surface):
    wrapped = surface.wrap(drawing())
    found = fit_surface(wrapped.positions, wrapped.normals)
    assert type(found) is type(surface)
    assert getattr(found, "radius", None) == pytest.approx(
        getattr(surface, "radius", None)
    )
    other = surface.wrap(drawing(seed=1))
    assert np.max(found.fit_errors(other.positions, other.normals)) < 1e-9
    assert np.allclose(
        surface_distances(found, wrapped.positions, other.positions),
        surface_distances(surface, wrapped.positions, other.positions),
    )


def test_no_surface_is_found_where_there_is_none():
    wrapped = Dome(0.06, np.eye(4)).wrap(drawing())
    squeezed = wrapped.positions * [1.0, 0.8, 1.0]
    assert fit_surface(squeezed, wrapped.normals) is None
    assert fit_surface(np.zeros((0, 3)), np.zeros((0, 3))) is None
    inward = Tube(0.05, np.eye(4)).wrap(drawing())
    assert fit_surface(inward.positions, -inward.normals) is None


def test_the_found_surface_moves_with_the_link():
    T = make_transform(random_rotation(np.random.default_rng(5)), np.ones(3))
    for surface in surfaces():
        wrapped = surface.wrap(drawing())
        moved = fit_surface(apply(T, wrapped.positions), rotate(T, wrapped.normals))
        assert np.allclose(
            surface_distances(moved, *2 * (apply(T, wrapped.positions),)),
            surface_distances(surface, *2 * (wrapped.positions,)),
        )


def test_a_grid_of_a_tube_covers_the_area_that_it_unrolls_to():
    grid = TaxelGrid(6, 10, 0.004, 0.005)
    assert grid.areas().sum() == pytest.approx(60 * 0.004 * 0.005)
    assert np.allclose(grid.unrolled().mean(axis=0), 0)


def test_taxels_on_a_dome_cover_the_area_of_the_dome_below_them():
    # A square drawn flat, its side 2a, as a fine sum over the sphere (r sin u = rho).
    radius, pitch, count = 0.06, 0.005, 12
    patch = Patch("cap", "arm", 1, count, count)
    grid = TaxelGrid(count, count, pitch, pitch)
    skin = build_skin("cap", [(patch, grid, Dome(radius, np.eye(4)))])
    angle = (np.arange(20000) + 0.5) * np.pi / 2 / 20000
    edge = pitch * count / 2 / np.maximum(np.cos(angle), np.sin(angle))
    exact = 4 * radius**2 * np.mean(1 - np.cos(edge / radius)) * np.pi / 2
    assert skin.areas.sum() == pytest.approx(exact, rel=1e-3)


def test_a_taper_draws_the_last_row_together():
    grid = TaxelGrid(3, 5, 0.01, 0.01, taper=0.5)
    s, t = grid.unrolled().T
    assert [np.ptp(s[t == level]) for level in np.unique(t)] == pytest.approx(
        [0.04, 0.03, 0.02]
    )
    assert grid.areas()[[0, 5, 10]] == pytest.approx([1e-4, 0.75e-4, 0.5e-4])


def test_cut_corners_are_staircases():
    present = cut_corners(5, 6, (1, 2, 3, 0))
    assert (~present).sum() == 1 + 3 + 6
    assert not present[0, 0] and not present[0, 4] and not present[1, 5]
    assert not present[2, 0] and not present[4, 2] and present[4, 5]
