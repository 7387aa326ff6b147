"""These tests check the laws of contact: load, area, pressure and the film."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from eskin.sim import load_constants
from eskin.sim.contact.pressure import (
    compute_contact_ellipses,
    compute_leak_share,
    compute_pressure_field,
    find_grid_neighbours,
    spread_through_film,
)
from eskin.sim.people.person import mirror_pads
from eskin.skin import Plane
from eskin.skin.presets import build_ur5_skin
from helpers.contacts import (
    CHARTS,
    FINGERS,
    FLAT,
    TIP,
    TUBE,
    build_full_chart,
    build_pads,
    field,
    force_on,
    press,
)

CONSTANTS = load_constants()
ACROSS = np.pi / 2
TIP_ROW = (8, 20, 90, 220, 1)
each_chart = pytest.mark.parametrize("name", CHARTS)


@pytest.fixture(scope="module")
def skin():
    return build_ur5_skin()


def feel(touch, chart):
    return compute_pressure_field(touch, chart, CONSTANTS)


def feel_area(touch, chart):
    return feel(touch, chart).area[0]


def compute_ellipses(touch, chart):
    return compute_contact_ellipses(touch, chart, CONSTANTS)[0]


@pytest.mark.parametrize(
    ("name", "pads"),
    [(name, TIP) for name in CHARTS] + [(name, FINGERS) for name in list(CHARTS)[:3]],
)
def test_taxels_bear_the_force_of_the_press(name, pads):
    forces = [1.0, 4.0, 20.0]
    contact = feel(press(pads, forces), CHARTS[name])
    assert force_on(contact, CHARTS[name]) == pytest.approx(forces, rel=0.05)


def test_force_beside_the_patch_reaches_no_taxel():
    inside, on_edge, beyond = (
        feel(press(TIP, 4.0, (s, 0.0)), FLAT) for s in (0.0, -0.102, -0.2)
    )
    half = force_on(on_edge, FLAT)[0] / force_on(inside, FLAT)[0]
    assert half == pytest.approx(0.5, abs=0.05)
    assert len(beyond.taxels) == 0
    assert beyond.force[0] == 4.0
    assert beyond.area[0] == pytest.approx(inside.area[0])


@each_chart
def test_pressure_and_area_grow_with_force_from_nothing(name):
    contact = feel(press(FINGERS, np.linspace(0.0, 30.0, 16)), CHARTS[name])
    assert np.all(np.diff(force_on(contact, CHARTS[name])) > 0)
    assert np.all(np.diff(contact.area) >= -1e-9)
    assert np.all(np.diff(contact.pressure.max(axis=1)) > 0)
    assert contact.area[0] == contact.pressure[0].max() == 0.0
    assert len(feel(press(FINGERS, [0.0, 0.0]), CHARTS[name]).taxels) == 0


def test_fingertip_area_is_smaller_on_a_tube_and_least_across_it():
    across, along = (
        feel_area(press(TIP, 1.0, angle=angle), TUBE) for angle in (ACROSS, 0.0)
    )
    assert across < along < feel_area(press(TIP, 1.0), FLAT)


@pytest.mark.parametrize(
    ("name", "angle", "added"),
    [
        ("flat", 0.3, (0, 0)),
        ("tube", 0.0, (1 / 0.0375, 0)),
        ("tube", ACROSS, (0, 1 / 0.0375)),
        ("dome", 0.3, (1 / 0.0575, 1 / 0.0575)),
    ],
)
def test_ellipse_axes_follow_the_sum_of_curvatures(name, angle, added):
    ellipses = compute_ellipses(press(TIP, 1.0, angle=angle), CHARTS[name])
    across, along = ellipses.semi_axes[0, 0]
    k_across, k_along = 1 / TIP.radii[0] + np.array(added)
    assert along / across == pytest.approx(np.sqrt(k_across / k_along))


def test_conforming_hand_touches_more_of_a_tube():
    areas = [
        feel_area(press(FINGERS, 30.0, angle=ACROSS, conformity=each), TUBE)
        for each in (0.0, 0.5, 0.9, 1.0)
    ]
    assert np.all(np.diff(areas) > 0)
    assert areas[0] < 0.7 * areas[-1]


def test_overlapping_pads_cover_their_area_once():
    pad = (9, 20, 200, 300, 1)
    apart = build_pads((-20, 0, *pad), (20, 0, *pad))
    together = replace(apart, centres=np.zeros((2, 2)))
    single = feel_area(press(build_pads((0, 0, *pad)), 5.0), FLAT)
    assert feel_area(press(together, 10.0), FLAT) == pytest.approx(single)
    assert feel_area(press(apart, 10.0), FLAT) == pytest.approx(2 * single)


def test_taxel_feels_a_pad_smaller_than_itself():
    coarse = build_full_chart(Plane(np.eye(4)), pitch=0.008)
    pin = build_pads((0, 0, 5, 5, 10, 20, 1))
    contact = feel(press(pin, 1.0, coarse.unrolled[40]), coarse)
    assert contact.taxels.tolist() == [40]
    assert force_on(contact, coarse)[0] > 0.5


@pytest.mark.parametrize("turns", [-2, 1])
def test_full_turns_around_a_tube_change_no_pressure(turns):
    moved = turns * TUBE.circumference
    here, there = (
        feel(press(FINGERS, 30.0, (0.11 + s, 0.0)), TUBE) for s in (0.0, moved)
    )
    assert np.array_equal(there.taxels, here.taxels)
    assert there.pressure == pytest.approx(here.pressure, abs=1e-9)
    assert (there.centroid - here.centroid)[0] == pytest.approx([moved, 0.0])


@pytest.mark.parametrize("turn", [np.pi / 2, np.pi])
def test_pressure_turns_with_the_press(turn):
    chart = replace(FLAT, unrolled=FLAT.unrolled - FLAT.unrolled.mean(axis=0))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    before = press(FINGERS, 20.0, (0.004, 0.001), 0.2)
    after = press(FINGERS, 20.0, rotation @ [0.004, 0.001], 0.2 + turn)
    check_symmetry(before, after, chart, rotation)


def test_pressure_of_the_other_hand_is_mirrored():
    chart = replace(TUBE, unrolled=TUBE.unrolled - TUBE.unrolled.mean(axis=0))
    hand = replace(FINGERS, angles=np.linspace(-0.4, 0.4, FINGERS.count))
    before = press(hand, 20.0, (0.01, 0.003), 0.5)
    after = press(mirror_pads(hand), 20.0, (-0.01, 0.003), -0.5)
    check_symmetry(before, after, chart, np.diag([-1.0, 1.0]))


def check_symmetry(before, after, chart, motion):
    partner = KDTree(chart.unrolled).query(chart.unrolled @ motion.T)[1]
    one, other = (field(feel(each, chart), chart) for each in (before, after))
    assert other[partner] == pytest.approx(one, abs=1e-9)


@each_chart
def test_pads_keep_their_distance_on_every_surface(name):
    pair = build_pads((-12, 0, *TIP_ROW), (12, 0, *TIP_ROW))
    ellipses = compute_ellipses(press(pair, 2.0, (-0.015, 0.02)), CHARTS[name])
    # The straight line on the chart between them is a shortest path but on a dome,
    # where it is longer by less than the tolerance.
    path = np.linspace(*ellipses.centres[0], 200)
    steps = np.diff(CHARTS[name].surface.wrap(path).positions, axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(0.024, abs=2e-4)


def test_moving_press_is_felt_as_a_still_one_at_each_place():
    places = np.column_stack([np.linspace(-0.03, 0.2, 12), np.linspace(0, 0.05, 12)])
    moving = replace(press(TIP, np.full(12, 2.0)), centre=places)
    contact = feel(moving, TUBE)
    for step, place in enumerate(places):
        still = field(feel(press(TIP, 2.0, place), TUBE), TUBE)
        assert field(contact, TUBE, step) == pytest.approx(still, abs=1e-12)


def test_centroid_is_that_of_the_pressure():
    contact = feel(press(FINGERS, 20.0, conformity=0.5), FLAT)
    weights = contact.pressure[0] / contact.pressure[0].sum()
    centre = weights @ FLAT.unrolled[contact.taxels]
    assert np.linalg.norm(centre - contact.centroid[0]) < 5e-4


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_film_gives_a_share_to_each_side_and_loses_it_beyond_edges(skin, missing):
    neighbours = find_grid_neighbours(skin)
    taxel = np.flatnonzero(np.sum(neighbours < 0, axis=1) == missing)[-1]
    away = sum(np.abs(each - each[taxel]) for each in (skin.rows, skin.columns))
    beside = (away == 1) & (skin.patch_index == skin.patch_index[taxel])
    expected = 0.75 * beside
    expected[taxel] = 7.0
    pressure, taxels = spread_through_film(
        np.array([[10.0], [0.0]]), np.array([taxel]), neighbours, 0.075
    )
    assert taxels.tolist() == np.flatnonzero(expected).tolist()
    assert pressure[0] == pytest.approx(expected[taxels])
    assert np.all(pressure[1] == 0.0)


def test_film_with_a_share_for_each_taxel_keeps_even_pressure(skin):
    neighbours = find_grid_neighbours(skin)
    everything = np.arange(skin.count)
    shares = compute_leak_share(1.5e-3, skin.areas)
    assert 0.05 < shares.min() < shares.max() < 0.12
    even, _ = spread_through_film(
        np.ones((1, skin.count)), everything, neighbours, shares
    )
    assert even[0][np.all(neighbours >= 0, axis=1)] == pytest.approx(1.0, abs=0.02)
