"""These tests check charts: surfaces unrolled, with the cells of their taxels."""

import numpy as np
import pytest

from eskin.robot import load_robot
from eskin.sim import build_charts
from eskin.skin import Dome, MountedSkin, Patch, Plane, TaxelGrid, Tube, build_skin
from eskin.skin.presets import build_ur5_skin


def mount(*pairs):
    """Mount a skin with a patch of each pair of grid and surface on a UR5's forearm."""
    patches = [
        (Patch(f"p{i}", "forearm_link", i + 1, grid.rows, grid.columns), grid, surface)
        for i, (grid, surface) in enumerate(pairs)
    ]
    return MountedSkin(build_skin("made", patches), load_robot("ur5"))


@pytest.fixture(scope="module")
def ur5():
    return MountedSkin(build_ur5_skin(), load_robot("ur5"))


@pytest.fixture(scope="module")
def charts(ur5):
    return build_charts(ur5)


def test_charts_hold_every_taxel_once_with_its_position_and_area(ur5, charts):
    taxels = np.concatenate([chart.taxels for chart in charts])
    assert np.array_equal(np.sort(taxels), np.arange(ur5.skin.count))
    for chart in charts:
        wrapped = chart.surface.wrap(chart.unrolled)
        assert np.allclose(wrapped.positions, ur5.skin.positions[chart.taxels])
        areas = 4 * np.abs(np.linalg.det(chart.cells))
        assert np.allclose(areas, ur5.skin.areas[chart.taxels])


def test_both_half_shells_of_a_tube_share_a_chart(ur5, charts):
    patches = [set(ur5.skin.patch_index[chart.taxels].tolist()) for chart in charts]
    assert patches[0] == {0, 1}
    assert {3, 4} in patches
    assert len(charts) == 7


def test_neighbouring_cells_of_a_row_touch(ur5, charts):
    skin = ur5.skin
    for chart in charts:
        grid = [each[chart.taxels] for each in (skin.patch_index, skin.rows)]
        # Taxels follow each other along the rows of their patch.
        same_row = np.all([each[1:] == each[:-1] for each in grid], axis=0)
        assert same_row.any()
        step = np.diff(chart.unrolled, axis=0)
        step[:, 0] = chart.wrap_s(step[:, 0])
        reach = chart.cells[:-1, 0] + chart.cells[1:, 0]
        assert np.allclose(step[same_row], reach[same_row])


def test_cells_on_a_dome_have_their_area_unrolled():
    (chart,) = build_charts(
        mount((TaxelGrid(7, 7, 0.008, 0.008), Dome(0.06, np.eye(4))))
    )
    assert np.allclose(np.abs(np.linalg.det(chart.cells)), 0.004**2, rtol=1e-6)


def test_skin_with_a_patch_on_no_known_surface_has_a_chart_of_each_patch():
    flat = TaxelGrid(4, 4, 0.008, 0.008), Plane(np.eye(4))
    assert len(build_charts(mount(flat, flat))) == 1
    mounted = mount(flat, flat)
    positions = mounted.skin.positions
    positions[:16, 2] = 0.01 * np.sin(500 * positions[:16, 0])
    charts = build_charts(mounted)
    assert [set(mounted.skin.patch_index[c.taxels[c.own]]) for c in charts] == [
        {0},
        {1},
    ]


def test_surface_ends_at_its_rim_but_not_around_a_tube(ur5, charts):
    for chart in build_charts(ur5, 0.01):
        low, high = chart.unrolled.min(axis=0), chart.unrolled.max(axis=0)
        s, t = (low + high) / 2
        ends = [high[1] + 0.009, low[1] - 0.009, high[1] + 0.011, low[1] - 0.011]
        places = np.array([[s, end] for end in ends])
        assert chart.is_beyond(places).tolist() == [False, False, True, True]
        (aside,) = chart.is_beyond(np.array([[high[0] + 0.011, t]]))
        assert aside != isinstance(chart.surface, Tube)
    far = np.array([[9.0, 9.0]])
    assert not any(chart.is_beyond(far).any() for chart in charts)
