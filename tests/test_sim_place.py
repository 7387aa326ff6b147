"""Where people touch: within reach, facing them, with the room a gesture needs."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from eskin.sim.constants import MM
from eskin.sim.scene.environment import compute_surface_axes
from eskin.sim.scene.placement import (
    PLACEMENT_LAWS,
    build_view,
    choose_placement_law,
    draw_site,
    draw_target,
    has_room_for_hand,
)
from eskin.sim.scene.targets import EDGE, INNER, REGIONS, SEAM, compute_edge_distance
from eskin.skin import Tube
from helpers.worlds import people, poses, world

COUNT = 120


@lru_cache
def drawn(gesture, kind=None):
    """Poses, people and where these do a gesture."""
    rng = np.random.default_rng(11)
    return [
        (q, person, draw_site(world(), q, person, gesture, rng, kind))
        for q, person in zip(poses(COUNT, seed=1), people(COUNT), strict=True)
    ]


def axes(q, site):
    T = world().poses(q)[world().links[site.chart]]
    chart = world().charts[site.chart]
    return [axis[0] for axis in compute_surface_axes(chart, np.array([site.centre]), T)]


def region_names(sites):
    region_of = {
        int(chart): REGIONS[region]
        for chart, region in zip(
            world().targets.chart, world().targets.region, strict=True
        )
    }
    return np.array([region_of[site.chart] for site in sites])


@pytest.mark.parametrize("gesture", PLACEMENT_LAWS)
def test_sites_face_the_person_at_a_height_they_reach(gesture):
    kept = 0
    for q, person, site in drawn(gesture):
        position, _, _, normal = axes(q, site)
        view = build_view(world(), q, person)
        low, high = view.heights
        faces = normal @ (view.shoulder - position) > -1e-3
        kept += faces and low - 0.01 <= position[2] <= high + 0.01
    # Where a pose has no such place with room, another is taken.
    assert kept >= 0.96 * COUNT


@pytest.mark.parametrize("gesture", PLACEMENT_LAWS)
def test_sites_have_the_room_that_the_gesture_needs(gesture):
    free = [
        has_room_for_hand(world(), site, gesture, world().poses(q))
        for q, _, site in drawn(gesture)
    ]
    assert np.mean(free) >= 0.97


@pytest.mark.parametrize("gesture", PLACEMENT_LAWS)
def test_targets_lie_on_a_taxel_or_between_two_edges(gesture):
    gap = world().constants.value("place.seam_gap") * MM
    for _, _, site in drawn(gesture):
        chart = world().charts[site.chart]
        away = chart.unrolled - np.array(site.centre)
        away[:, 0] = chart.wrap_s(away[:, 0])
        # Half vectors of a cell are at right angles.
        shares = np.einsum("td,tad->ta", away, chart.cells)
        inside = np.abs(shares) <= np.sum(chart.cells**2, axis=2) * (1 + 1e-9)
        on_taxel = inside.all(axis=1).any()
        rim = world().targets.edges[site.chart]
        near = compute_edge_distance(chart, rim, np.array([site.centre]))[0]
        assert on_taxel or near <= gap / 2 + 2e-3


def test_grabs_and_strokes_take_place_on_the_two_long_tubes():
    for gesture in ("grab", "stroke"):
        for _, _, site in drawn(gesture):
            chart = world().charts[site.chart]
            assert isinstance(chart.surface, Tube)
            assert np.ptp(chart.unrolled[:, 1]) > 0.2
            assert site.radius == chart.radius


def test_strokes_have_their_run():
    need = world().constants.value("place.stroke_run") * MM
    runs = [site.free_run[1] - site.free_run[0] for _, _, site in drawn("stroke")]
    assert np.mean(np.array(runs) >= need) >= 0.98


def test_a_run_shorter_than_that_is_no_room_for_a_stroke():
    short = world().constants.value("place.stroke_run") * MM * 0.9
    for q, _, site in drawn("stroke")[:20]:
        cut = replace(site, free_run=(-short, 0.0))
        T = world().poses(q)
        assert not has_room_for_hand(world(), cut, "stroke", T)
        assert has_room_for_hand(world(), cut, "poke", T) == has_room_for_hand(
            world(), site, "poke", T
        )


def test_only_grabs_and_strokes_are_kept_off_short_surfaces():
    spots = world().targets
    for law in PLACEMENT_LAWS:
        rng = np.random.default_rng(2)
        views = [build_view(world(), q, person) for q, person, _ in drawn(law)[:60]]
        found = [draw_target(world(), view, law, rng, strict=False) for view in views]
        tubes = [spots.tubes[spots.chart[spot]] for spot in found]
        assert all(tubes) == (law in ("grab", "stroke"))


def test_the_free_run_ends_on_skin():
    for gesture in PLACEMENT_LAWS:
        for _, _, site in drawn(gesture)[:60]:
            along = world().charts[site.chart].unrolled[:, 1]
            low, high = site.free_run
            assert site.centre[1] + low >= along.min() - 6e-3
            assert site.centre[1] + high <= along.max() + 6e-3


def test_regions_are_touched_as_often_as_wanted():
    wanted = world().constants.weights("place.regions")
    names = region_names([site for _, _, site in drawn("poke")])
    for name in REGIONS:
        assert np.mean(names == name) == pytest.approx(wanted[name], abs=0.15)
    names = region_names([site for _, _, site in drawn("stroke")])
    assert np.mean(names == "forearm") == pytest.approx(2 / 3, abs=0.15)


def test_targets_come_near_edges_and_on_seams_as_often_as_wanted():
    rng = np.random.default_rng(3)
    q, person = poses(1, seed=4)[0], people(1)[0]
    sites = [draw_site(world(), q, person, "poke", rng) for _ in range(450)]
    edges = np.array([near_edge(site) for site in sites])
    chance = world().constants.value("place.edge") + world().constants.value(
        "place.seam"
    )
    assert edges.mean() == pytest.approx(chance, abs=0.045)


def near_edge(site):
    chart, rim = world().charts[site.chart], world().targets.edges[site.chart]
    within = world().constants.value("place.edge_within") * MM
    return compute_edge_distance(chart, rim, np.array([site.centre]))[0] <= within


def test_spots_cover_the_whole_skin_once():
    spots = world().targets
    covered = spots.areas[spots.kind != SEAM].sum()
    assert covered == pytest.approx(world().mounted.skin.areas.sum(), rel=1e-6)
    assert {INNER, EDGE, SEAM} == set(spots.kind.tolist())


def test_seams_lie_between_edges_of_patches():
    spots = world().targets
    for chart in np.unique(spots.chart[spots.kind == SEAM]):
        chosen = (spots.kind == SEAM) & (spots.chart == chart)
        here = world().charts[chart]
        away = compute_edge_distance(here, spots.edges[chart], spots.unrolled[chosen])
        widest = world().constants.value("place.seam_gap") * MM
        assert away.max() <= widest / 2 + 1e-6


def test_what_has_no_law_takes_those_of_the_gestures_evenly():
    rng = np.random.default_rng(0)
    laws = [
        choose_placement_law("none", kind, rng) for kind in ("bump", "lean", None) * 400
    ]
    for law in PLACEMENT_LAWS:
        assert np.mean(np.array(laws) == law) == pytest.approx(0.25, abs=0.04)
    assert choose_placement_law("none", "guiding", rng) == "grab"
    assert choose_placement_law("rub", "rub", rng) == "stroke"
    assert choose_placement_law("poke", "two_tips", rng) == "poke"


def test_the_place_of_no_gesture_is_that_of_the_gestures_together():
    none = region_names([site for _, _, site in drawn("none", "resting_hand")])
    each = [region_names([site for _, _, site in drawn(law)]) for law in PLACEMENT_LAWS]
    together = np.concatenate(each)
    for name in REGIONS:
        assert np.mean(none == name) == pytest.approx(
            np.mean(together == name), abs=0.13
        )


def test_the_hand_points_away_from_the_person_or_up():
    for q, person, site in drawn("poke")[:80]:
        position, s_axis, t_axis, normal = axes(q, site)
        ahead = -np.sin(site.angle) * s_axis + np.cos(site.angle) * t_axis
        reach = position - build_view(world(), q, person).shoulder
        reach = reach / np.linalg.norm(reach)
        wish = reach + world().constants.value("place.upward") * np.eye(3)[2]
        flat = wish - (wish @ normal) * normal
        assert ahead @ flat == pytest.approx(np.linalg.norm(flat), abs=1e-9)


def test_tall_people_reach_higher():
    q = poses(1)[0]
    views = [build_view(world(), q, person) for person in people(20)]
    heights = [person.acromion_height for person in people(20)]
    tops = [view.heights[1] for view in views]
    assert np.array_equal(np.argsort(heights), np.argsort(tops))


def test_the_same_seed_finds_the_same_place():
    q, person = poses(1)[0], people(1)[0]
    sites = [
        draw_site(world(), q, person, "none", np.random.default_rng(5))
        for _ in range(2)
    ]
    assert sites[0] == sites[1]
