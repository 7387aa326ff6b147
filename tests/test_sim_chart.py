import numpy as np
import pytest

from eskin.robot import load_robot
from eskin.sim.contact.chart import build_charts
from eskin.skin import (
    Dome,
    MountedSkin,
    Patch,
    Plane,
    Surface,
    SurfacePoints,
    TaxelGrid,
    Tube,
    build_skin,
)
from eskin.skin.presets import build_ur5_skin
from eskin.transforms import make_transform

LINK = "forearm_link"


class Turned(Surface):
    """A surface on which a grid's columns run along t."""

    def __init__(self, surface, shift):
        self.surface = surface
        self.shift = shift

    def wrap(self, unrolled):
        at = unrolled[:, ::-1] * [-1.0, 1.0] + self.shift
        wrapped = self.surface.wrap(at)
        t_axis = np.cross(wrapped.normals, wrapped.tangents)
        return SurfacePoints(
            wrapped.positions, wrapped.normals, t_axis, wrapped.area_scale
        )

    def unroll(self, positions):
        raise NotImplementedError

    def fit_errors(self, positions, normals):
        raise NotImplementedError


def mounted(*laid):
    pieces = [
        (Patch(f"p{i}", LINK, i + 1, grid.rows, grid.columns), grid, surface)
        for i, (grid, surface) in enumerate(laid)
    ]
    return MountedSkin(build_skin("made", pieces), load_robot("ur5"))


@pytest.fixture(scope="module")
def ur5():
    return MountedSkin(build_ur5_skin(), load_robot("ur5"))


def test_every_taxel_lies_on_one_chart(ur5):
    taxels = np.concatenate([chart.taxels for chart in build_charts(ur5)])
    assert np.array_equal(np.sort(taxels), np.arange(ur5.skin.count))


def test_both_shells_of_a_tube_share_a_chart(ur5):
    charts = build_charts(ur5)
    patches = [set(ur5.skin.patch_index[c.taxels].tolist()) for c in charts]
    assert patches[0] == {0, 1}
    assert {3, 4} in patches
    assert len(charts) == 7


def test_a_chart_lays_its_taxels_where_the_skin_has_them(ur5):
    for chart in build_charts(ur5):
        wrapped = chart.surface.wrap(chart.unrolled)
        assert np.allclose(wrapped.positions, ur5.skin.positions[chart.taxels])


def test_cells_have_the_taxels_areas(ur5):
    for chart in build_charts(ur5):
        areas = 4 * np.abs(np.linalg.det(chart.cells))
        assert np.allclose(areas, ur5.skin.areas[chart.taxels])


def test_cells_of_a_grid_meet_without_gap(ur5):
    for chart in build_charts(ur5):
        key = {
            (p, r, c): i
            for i, (p, r, c) in enumerate(
                zip(
                    ur5.skin.patch_index[chart.taxels],
                    ur5.skin.rows[chart.taxels],
                    ur5.skin.columns[chart.taxels],
                    strict=True,
                )
            )
        }
        for (p, r, c), i in key.items():
            if (j := key.get((p, r, c + 1))) is not None:
                step = chart.unrolled[j] - chart.unrolled[i]
                step[:1] = chart.wrap_s(step[:1])
                assert np.allclose(step, chart.cells[i, 0] + chart.cells[j, 0])


def test_cells_lie_right_where_rows_run_across_the_seam_of_a_tube():
    grid = TaxelGrid(2, 6, row_pitch=0.007, column_pitch=0.008)
    seam = np.array([np.pi * 0.04, 0.0])
    tube = Tube(0.04, np.eye(4))
    world = mounted((grid, tube), (grid, Turned(tube, seam)))
    (chart,) = build_charts(world)
    turned = world.skin.patch_index[chart.taxels] == 1
    assert np.allclose(np.abs(chart.cells[turned, 0, 1]), 0.004)
    assert np.allclose(np.abs(chart.cells[turned, 1, 0]), 0.0035)


def test_a_dome_draws_its_cells_flat():
    world = mounted((TaxelGrid(7, 7, 0.008, 0.008), Dome(0.06, np.eye(4))))
    (chart,) = build_charts(world)
    assert np.allclose(np.abs(np.linalg.det(chart.cells)), 0.004**2, rtol=1e-6)


def test_only_a_tube_comes_round():
    def lift(z):
        return make_transform(np.eye(3), np.array([0.0, 0.0, z]))

    grid = TaxelGrid(3, 3, 0.008, 0.008)
    laid = [(grid, Plane(lift(1.0))), (grid, Tube(0.05, lift(0.0)))]
    plane, tube = build_charts(mounted(*laid))
    whole = 2 * np.pi * 0.05
    assert tube.wrap_s(np.array([0.6, -0.6]) * whole) == pytest.approx(
        np.array([-0.4, 0.4]) * whole
    )
    assert plane.wrap_s(np.array([3.0])) == pytest.approx([3.0])
    assert np.isinf(plane.radius)


def test_a_patch_on_no_known_surface_is_refused():
    world = mounted((TaxelGrid(4, 4, 0.008, 0.008), Plane(np.eye(4))))
    skin = world.skin
    skin.positions[:, 2] = 0.01 * np.sin(500 * skin.positions[:, 0])
    with pytest.raises(ValueError, match="'p0' lies on no plane, tube or dome"):
        build_charts(world)


def test_a_surface_ends_a_rim_beyond_its_taxels_but_not_round_a_tube(ur5):
    for chart in build_charts(ur5, 0.01):
        low, high = chart.unrolled.min(axis=0), chart.unrolled.max(axis=0)
        s, t = (low + high) / 2
        ends = [high[1] + 0.009, low[1] - 0.009, high[1] + 0.011, low[1] - 0.011]
        places = np.array([[s, end] for end in ends])
        assert chart.is_beyond(places).tolist() == [False, False, True, True]
        (aside,) = chart.is_beyond(np.array([[high[0] + 0.011, t]]))
        assert aside != isinstance(chart.surface, Tube)
    far = np.array([[9.0, 9.0]])
    assert not any(chart.is_beyond(far).any() for chart in build_charts(ur5))
