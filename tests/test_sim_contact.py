from dataclasses import replace

import numpy as np
import pytest
from benchmarks.skin_distance import surface_distances
from scipy.spatial import cKDTree

from eskin.robot import load_robot
from eskin.sim import build_charts, load_constants
from eskin.sim.contact.pressure import (
    build_taxel_geometry,
    compute_contact_ellipses,
    compute_leak_share,
    compute_pad_gaps,
    compute_pad_offsets,
    compute_pressure_field,
    compute_relative_curvatures,
    find_grid_neighbours,
    find_reachable_pairs,
    share_load,
    spread_through_film,
)
from eskin.skin import MountedSkin, Plane, Tube
from eskin.skin.presets import build_ur5_skin
from helpers.contacts import (
    DOME,
    FINGERS,
    FLAT,
    TIP,
    TUBE,
    WIDE_TUBE,
    chart_of,
    field,
    force_on,
    press,
    stamps,
)

CONSTANTS = load_constants()
CHARTS = {"flat": FLAT, "tube": TUBE, "wide tube": WIDE_TUBE, "dome": DOME}
each_chart = pytest.mark.parametrize("name", CHARTS)


@pytest.fixture(scope="module")
def ur5():
    return MountedSkin(build_ur5_skin(), load_robot("ur5"))


def felt_field(touch, chart):
    return field(compute_pressure_field(touch, chart, CONSTANTS), chart)


@pytest.mark.parametrize(
    ("name", "body"),
    [(name, TIP) for name in CHARTS] + [(name, FINGERS) for name in list(CHARTS)[:3]],
)
@pytest.mark.parametrize("force", [1.0, 4.0, 20.0])
def test_taxels_carry_the_force_that_lies_on_them(name, body, force):
    felt = compute_pressure_field(press(body, force), CHARTS[name], CONSTANTS)
    assert force_on(felt, CHARTS[name])[0] == pytest.approx(force, rel=0.05)


def test_force_that_misses_the_patch_is_lost():
    inside = compute_pressure_field(press(TIP, 4.0, centre=(0.0, 0.0)), FLAT, CONSTANTS)
    on_edge = compute_pressure_field(
        press(TIP, 4.0, centre=(-0.102, 0.0)), FLAT, CONSTANTS
    )
    beyond = compute_pressure_field(
        press(TIP, 4.0, centre=(-0.2, 0.0)), FLAT, CONSTANTS
    )
    half = force_on(on_edge, FLAT)[0] / force_on(inside, FLAT)[0]
    assert half == pytest.approx(0.5, abs=0.05)
    assert len(beyond.taxels) == 0
    assert beyond.force[0] == 4.0
    assert beyond.area[0] == pytest.approx(inside.area[0])


@pytest.mark.parametrize("conformity", [0.0, 0.75, 1.0])
def test_parts_share_the_load_and_none_is_lost(conformity):
    touch = press(FINGERS, [0.0, 0.01, 1.0, 60.0, 500.0], conformity=conformity)
    far = compute_pad_gaps(touch.tissue, TUBE, compute_pad_offsets(touch))
    loads = share_load(touch, far, CONSTANTS)
    assert loads.sum(axis=1) == pytest.approx(touch.force)
    assert np.all(loads >= 0.0)


def test_parts_on_a_flat_share_by_stiffness_alone():
    touch = press(FINGERS, 10.0)
    loads = share_load(
        touch,
        compute_pad_gaps(touch.tissue, FLAT, compute_pad_offsets(touch)),
        CONSTANTS,
    )
    share = FINGERS.stiffness / FINGERS.stiffness.sum()
    assert loads[0] == pytest.approx(10.0 * share)


def test_parts_with_gaps_sink_by_one_depth():
    touch = press(FINGERS, 8.0, conformity=0.9, angle=1.2)
    far = compute_pad_gaps(touch.tissue, TUBE, compute_pad_offsets(touch))
    loads = share_load(touch, far, CONSTANTS)[0]
    b, m = touch.tissue.b, touch.tissue.m
    depth = np.linspace(0.0, 0.004, 400_001)
    law = b / m * (np.expm1(m * depth) - m * depth)
    sunk = np.interp(loads / FINGERS.stiffness, law, depth) + far[0]
    assert np.ptp(sunk[loads > 0.01]) < 2e-6
    assert np.all(far[0][loads == 0.0] >= sunk.min() - 1e-6)


@pytest.mark.parametrize(("force", "area"), [(0.5, 67), (1, 90), (2, 120), (5, 177)])
def test_a_fingertip_on_a_flat_has_the_area_of_its_force(force, area):
    felt = compute_pressure_field(press(TIP, force), FLAT, CONSTANTS)
    assert felt.area[0] * 1e6 == pytest.approx(area, rel=0.25)


def test_area_grows_with_force_no_faster_than_a_sphere_would():
    felt = compute_pressure_field(press(TIP, [0.5, 1.0, 2.0, 5.0]), FLAT, CONSTANTS)
    slopes = np.diff(np.log(felt.area)) / np.diff(np.log([0.5, 1.0, 2.0, 5.0]))
    assert np.all((slopes > 0.25) & (slopes < 2 / 3))


def test_area_ends_at_the_largest_that_a_part_has():
    felt = compute_pressure_field(press(TIP, [50.0, 100.0]), FLAT, CONSTANTS)
    assert felt.area == pytest.approx(220e-6, rel=0.01)


def test_pressure_under_a_fingertip_peaks_at_twice_its_mean():
    fine = chart_of(Plane(np.eye(4)), pitch=0.0005, s=0.015, t=0.015)
    felt = compute_pressure_field(press(TIP, 2.0), fine, CONSTANTS)
    pressed = felt.pressure[0][felt.pressure[0] > CONSTANTS.value("contact.touched")]
    assert pressed.max() / pressed.mean() == pytest.approx(2.0, abs=0.3)


def test_a_fingertip_touches_less_of_a_tube_than_of_a_flat():
    around = felt_area(press(TIP, 1.0, angle=np.pi / 2), TUBE)
    along = felt_area(press(TIP, 1.0, angle=0.0), TUBE)
    flat = felt_area(press(TIP, 1.0), FLAT)
    assert around < flat
    assert along < flat
    assert around < along


def felt_area(touch, chart):
    return compute_pressure_field(touch, chart, CONSTANTS).area[0]


def test_curvatures_add_where_the_part_crosses_the_tube():
    for angle, added in ((0.0, [1.0, 0.0]), (np.pi / 2, [0.0, 1.0])):
        touch = press(TIP, 1.0, angle=angle)
        dents, _, _ = compute_contact_ellipses(touch, TUBE, CONSTANTS)
        total = compute_relative_curvatures(TIP, TUBE, dents.long_axes)[0, 0]
        assert total == pytest.approx(1 / TIP.radii[0] + np.array(added) / 0.0375)


def test_an_ellipse_is_longer_where_the_body_is_flatter():
    dents, _, _ = compute_contact_ellipses(press(TIP, 1.0), FLAT, CONSTANTS)
    across, along = dents.semi_axes[0, 0]
    assert along / across == pytest.approx(np.sqrt(20 / 8))


def test_parts_point_where_the_body_does():
    row = stamps((0, -20, 8, 20, 90, 220, 1), (0, 20, 8, 20, 90, 220, 1))
    dents, _, _ = compute_contact_ellipses(press(row, 1.0, angle=0.7), FLAT, CONSTANTS)
    step = dents.centres[0, 1] - dents.centres[0, 0]
    assert step / 0.04 == pytest.approx([-np.sin(0.7), np.cos(0.7)])
    assert dents.long_axes[0] == pytest.approx(np.tile(step / 0.04, (2, 1)))


def test_the_nearest_part_carries_all_where_none_is_near():
    row = stamps(*((x, 0, 8, 20, 90, 220, 1) for x in (-60, -20, 80)))
    touch = press(row, 4.0, angle=0.0, conformity=0.0)
    loads = share_load(
        touch,
        compute_pad_gaps(touch.tissue, TUBE, compute_pad_offsets(touch)),
        CONSTANTS,
    )
    assert loads[0] == pytest.approx([0.0, 4.0, 0.0])


def test_a_part_smaller_than_the_taxel_is_not_missed_in_its_middle():
    coarse = chart_of(Plane(np.eye(4)), pitch=0.008)
    pin = stamps((0, 0, 5, 5, 10, 20, 1))
    felt = compute_pressure_field(
        press(pin, 1.0, coarse.unrolled[40]), coarse, CONSTANTS
    )
    assert felt.taxels.tolist() == [40]
    assert force_on(felt, coarse)[0] > 0.5


def test_a_stiff_hand_touches_less_of_a_tube_than_one_that_wraps_it():
    areas = [
        felt_area(press(FINGERS, 30.0, angle=np.pi / 2, conformity=kappa), TUBE)
        for kappa in (0.0, 0.5, 0.9, 1.0)
    ]
    assert np.all(np.diff(areas) > 0)
    assert areas[0] < 0.7 * areas[-1]


@each_chart
def test_more_force_presses_every_part_harder(name):
    series = np.linspace(0.0, 30.0, 31)
    felt = compute_pressure_field(press(FINGERS, series), CHARTS[name], CONSTANTS)
    assert np.all(np.diff(force_on(felt, CHARTS[name])) > 0)
    assert np.all(np.diff(felt.area) >= -1e-9)
    assert np.all(np.diff(felt.pressure.max(axis=1)) > 0)


def test_no_force_presses_nothing():
    felt = compute_pressure_field(press(TIP, [0.0, 1.0, 0.0]), FLAT, CONSTANTS)
    assert np.all(felt.pressure[[0, 2]] == 0.0)
    assert felt.area[0] == felt.area[2] == 0.0
    assert (
        len(compute_pressure_field(press(FINGERS, [0.0, 0.0]), TUBE, CONSTANTS).taxels)
        == 0
    )


def test_a_whole_turn_of_a_tube_changes_nothing():
    here = compute_pressure_field(
        press(FINGERS, 30.0, centre=(0.11, 0.0)), TUBE, CONSTANTS
    )
    whole = TUBE.circumference
    for turns in (-2, -1, 1):
        there = compute_pressure_field(
            press(FINGERS, 30.0, centre=(0.11 + turns * whole, 0.0)), TUBE, CONSTANTS
        )
        assert np.array_equal(there.taxels, here.taxels)
        assert there.pressure == pytest.approx(here.pressure, abs=1e-9)
        moved = there.centroid - here.centroid
        assert moved[0] == pytest.approx([turns * whole, 0.0])


@pytest.mark.parametrize("turn", [np.pi / 2, np.pi])
def test_a_turned_press_gives_a_turned_field(turn):
    # The grid of FLAT has a taxel for each of its own, turned about its middle.
    chart = replace(FLAT, unrolled=FLAT.unrolled - FLAT.unrolled.mean(axis=0))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    before = felt_field(press(FINGERS, 20.0, (0.004, 0.001), 0.2), chart)
    after = felt_field(
        press(FINGERS, 20.0, rotation @ [0.004, 0.001], 0.2 + turn), chart
    )
    partner = nearest(chart.unrolled @ rotation.T, chart.unrolled)
    assert after[partner] == pytest.approx(before, abs=1e-9)


def test_the_other_hand_gives_the_mirrored_field():
    chart = replace(TUBE, unrolled=TUBE.unrolled - TUBE.unrolled.mean(axis=0))
    turned = replace(FINGERS, angles=np.linspace(-0.4, 0.4, FINGERS.count))
    other = replace(turned, centres=turned.centres * [-1.0, 1.0], angles=-turned.angles)
    before = felt_field(press(turned, 20.0, (0.01, 0.003), 0.5), chart)
    after = felt_field(press(other, 20.0, (-0.01, 0.003), -0.5), chart)
    partner = nearest(chart.unrolled * [-1.0, 1.0], chart.unrolled)
    assert after[partner] == pytest.approx(before, abs=1e-9)


def nearest(points, targets):
    return cKDTree(targets).query(points)[1]


def test_a_dome_looks_alike_from_everywhere():
    felt = [
        compute_pressure_field(press(TIP, 2.0, centre, angle=0.4), DOME, CONSTANTS)
        for centre in ((0.0, 0.0), (0.03, 0.02), (-0.01, 0.035))
    ]
    forces = [force_on(each, DOME)[0] for each in felt]
    assert forces == pytest.approx([2.0] * 3, rel=0.05)
    assert np.ptp([each.area[0] for each in felt]) == pytest.approx(0.0, abs=1e-12)


@each_chart
def test_parts_keep_their_distances_on_every_surface(name):
    pair = stamps((-12, 0, 8, 20, 90, 220, 1), (12, 0, 8, 20, 90, 220, 1))
    touch = press(pair, 2.0, centre=(-0.015, 0.02))
    dents, _, _ = compute_contact_ellipses(touch, CHARTS[name], CONSTANTS)
    surface = CHARTS[name].surface
    places = surface.wrap(dents.centres[0]).positions
    assert surface_distances(surface, places[:1], places[1:])[0, 0] == pytest.approx(
        0.024, abs=2e-4
    )


def test_nothing_is_felt_where_no_part_reaches():
    for chart in (FLAT, TUBE, DOME):
        touch = press(FINGERS, 30.0)
        dents, _, _ = compute_contact_ellipses(touch, chart, CONSTANTS)
        reached = find_reachable_pairs(
            dents, build_taxel_geometry(chart, CONSTANTS)
        ).any(axis=0)
        all_taxels = np.ones((FINGERS.count, len(chart.taxels)), dtype=bool)
        felt = compute_pressure_field(touch, chart, CONSTANTS)
        assert set(felt.taxels) <= set(chart.taxels[reached])
        whole = felt_without_culling(touch, chart, all_taxels)
        assert np.array_equal(whole, field(felt, chart))


def felt_without_culling(touch, chart, pairs):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "eskin.sim.contact.pressure.find_reachable_pairs", lambda *_: pairs
        )
        return felt_field(touch, chart)


def test_a_moving_press_is_felt_as_at_each_of_its_places():
    places = np.column_stack([np.linspace(-0.03, 0.2, 12), np.linspace(0, 0.05, 12)])
    moving = replace(press(TIP, np.full(12, 2.0)), centre=places)
    felt = compute_pressure_field(moving, TUBE, CONSTANTS)
    for step, place in enumerate(places):
        still = felt_field(press(TIP, 2.0, place), TUBE)
        there = np.zeros(len(TUBE.taxels))
        there[felt.taxels] = felt.pressure[step]
        assert there == pytest.approx(still, abs=1e-12)


def test_the_centroid_is_where_the_taxels_feel_the_force():
    felt = compute_pressure_field(press(FINGERS, 20.0, conformity=0.5), FLAT, CONSTANTS)
    weights = felt.pressure[0] / felt.pressure[0].sum()
    seen = weights @ FLAT.unrolled[felt.taxels]
    assert np.linalg.norm(seen - felt.centroid[0]) < 5e-4


def test_parts_that_overlap_cover_their_place_once():
    apart = stamps((-20, 0, 9, 20, 200, 300, 1), (20, 0, 9, 20, 200, 300, 1))
    together = replace(apart, centres=np.zeros((2, 2)))
    one = press(stamps((0, 0, 9, 20, 200, 300, 1)), 5.0)
    assert felt_area(press(together, 10.0), FLAT) == pytest.approx(felt_area(one, FLAT))
    assert felt_area(press(apart, 10.0), FLAT) == pytest.approx(
        2 * felt_area(one, FLAT)
    )


def test_two_patches_of_a_tube_feel_one_grab(ur5):
    chart = build_charts(ur5)[2]
    grab = press(FINGERS, 40.0, centre=(0.055, 0.0), angle=np.pi / 2, conformity=0.98)
    felt = compute_pressure_field(grab, chart, CONSTANTS)
    patches = np.unique(ur5.skin.patch_index[felt.taxels])
    assert len(patches) == 2
    on_taxels = 1e3 * felt.pressure[0] @ ur5.skin.areas[felt.taxels]
    assert 0.7 * 40.0 < on_taxels < 1.02 * 40.0


def test_a_hand_longer_than_the_tube_is_round_meets_itself():
    thin = chart_of(Tube(0.01, np.eye(4)), pitch=0.002)
    row = stamps(*((0, y, 8, 20, 90, 220, 1) for y in (-31.416, 31.416)))
    felt = compute_pressure_field(
        press(row, 4.0, angle=np.pi / 2, conformity=1.0), thin, CONSTANTS
    )
    single = compute_pressure_field(
        press(TIP, 2.0, centre=(0.001 + 0.031416, 0.002), angle=np.pi / 2),
        thin,
        CONSTANTS,
    )
    assert field(felt, thin) == pytest.approx(
        2 * field(single, thin), rel=0.01, abs=0.1
    )


def test_neighbours_lie_beside_each_other_and_know_it(ur5):
    skin, neighbours = ur5.skin, find_grid_neighbours(ur5.skin)
    for side, (row, column) in enumerate(((0, -1), (0, 1), (-1, 0), (1, 0))):
        has = neighbours[:, side] >= 0
        other = neighbours[has, side]
        assert np.array_equal(skin.rows[other], skin.rows[has] + row)
        assert np.array_equal(skin.columns[other], skin.columns[has] + column)
        assert np.array_equal(skin.patch_index[other], skin.patch_index[has])
        assert np.array_equal(neighbours[other, side ^ 1], np.flatnonzero(has))
    assert np.all(neighbours[:8, 2] == -1)
    assert np.all(neighbours[1:8, 0] == np.arange(7))


def test_the_film_hands_a_share_to_each_side_and_loses_none_inside(ur5):
    neighbours = find_grid_neighbours(ur5.skin)
    middle = int(np.flatnonzero(np.all(neighbours >= 0, axis=1))[100])
    pressure, taxels = spread_through_film(
        np.array([[10.0], [0.0]]), np.array([middle]), neighbours, 0.075
    )
    found = dict(zip(taxels.tolist(), pressure[0], strict=True))
    assert found[middle] == pytest.approx(7.0)
    assert [found[n] for n in neighbours[middle]] == pytest.approx([0.75] * 4)
    assert pressure[0].sum() == pytest.approx(10.0)
    assert np.all(pressure[1] == 0.0)
    assert np.all(np.diff(taxels) > 0)


def test_the_film_loses_what_goes_over_the_edge(ur5):
    neighbours = find_grid_neighbours(ur5.skin)
    missing = np.sum(neighbours < 0, axis=1)
    corner = np.flatnonzero(missing == 2)[:1]
    pressure, _ = spread_through_film(np.ones((1, 1)), corner, neighbours, 0.05)
    assert pressure.sum() == pytest.approx(0.9)


def test_each_taxel_may_have_a_share_of_its_own(ur5):
    neighbours = find_grid_neighbours(ur5.skin)
    shares = compute_leak_share(1.5e-3, ur5.skin.areas)
    assert 0.05 < shares.min() < shares.max() < 0.12
    everything = np.arange(ur5.skin.count)
    even, taxels = spread_through_film(
        np.ones((1, len(everything))), everything, neighbours, shares
    )
    assert np.array_equal(taxels, everything)
    inside = np.all(neighbours >= 0, axis=1)
    assert even[0][inside] == pytest.approx(1.0, abs=0.02)


def test_no_share_leaves_pressures_as_they_are(ur5):
    neighbours = find_grid_neighbours(ur5.skin)
    taxels = np.array([5, 40, 77])
    before = np.array([[1.0, 2.0, 3.0]])
    after, reached = spread_through_film(before, taxels, neighbours, 0.0)
    assert after[0][np.isin(reached, taxels)] == pytest.approx(before[0])
    assert after.sum() == before.sum()
