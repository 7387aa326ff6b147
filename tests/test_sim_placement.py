"""These tests check poses of the robot, and where people touch it in them."""

from functools import cache

import numpy as np
import pytest

from eskin.robot import load_robot
from eskin.sim.constants import MM, load_constants
from eskin.sim.scene import build_environment, compute_joint_limits
from eskin.sim.scene.environment import compute_surface_axes
from eskin.sim.scene.folds import find_fold_sites
from eskin.sim.scene.placement import (
    PLACEMENT_LAWS,
    build_view,
    choose_placement_law,
    draw_site,
    has_room_for_hand,
)
from eskin.sim.scene.poses import (
    build_pose_pool,
    compute_pose_group,
    compute_pose_groups,
    draw_pose,
    draw_touching_pose,
)
from eskin.sim.scene.targets import EDGE, INNER, REGIONS, SEAM, compute_edge_distance
from eskin.sim.scene.validity import are_poses_valid, find_self_contact_sites
from eskin.skin import MountedSkin, Tube, build_grid_skin
from helpers.worlds import EVERY, people, poses, world

pytestmark = pytest.mark.slow

COUNT = 80


def get_length(name):
    """Return a length among the constants, which are in mm [m]."""
    return world().constants.value(name) * MM


def test_every_pose_has_one_group_of_twelve():
    low, high = compute_joint_limits(world())
    q = np.random.default_rng(0).uniform(low, high, (5000, 6))
    groups = compute_pose_groups(world(), q, world().poses(q))
    assert set(groups.tolist()) == EVERY
    assert [compute_pose_group(world(), each) for each in q[:20]] == [*groups[:20]]
    pool = build_pose_pool(world())
    assert sum(pool.shares.values()) == pytest.approx(1.0)
    for group in EVERY:
        assert pool.shares[group] > 0.01
        assert len(pool.any[group]) > 10


def test_turning_base_or_wrist_keeps_the_group():
    rng = np.random.default_rng(1)
    for q in poses(50, seed=1):
        turned = q.copy()
        turned[[0, 3, 4, 5]] = rng.uniform(-np.pi, np.pi, 4)
        assert compute_pose_group(world(), turned) == compute_pose_group(world(), q)


@pytest.mark.parametrize("groups", [{1}, {9, 10, 11, 12}, {3, 8}])
def test_drawn_poses_are_valid_and_of_their_groups(groups):
    rng = np.random.default_rng(2)
    q = np.array([draw_pose(world(), groups, rng) for _ in range(40)])
    assert {compute_pose_group(world(), each) for each in q} <= groups
    assert are_poses_valid(world(), q).all()
    low, high = compute_joint_limits(world())
    assert np.all((q >= low) & (q <= high))


def test_groups_are_as_frequent_as_such_poses_and_the_base_points_anywhere():
    q = poses(1000, seed=3)
    groups = compute_pose_groups(world(), q, world().poses(q))
    for group, share in build_pose_pool(world()).shares.items():
        assert np.mean(groups == group) == pytest.approx(share, abs=0.035)
    quarters = np.histogram(q[:, 0], bins=4, range=(-np.pi, np.pi))[0]
    assert quarters.min() > 200


def test_folded_and_touching_poses_have_their_sites_and_others_no_self_contact():
    rng = np.random.default_rng(6)
    person = people(1)[0]
    for q in poses(20, seed=5, fold=True):
        assert find_fold_sites(world(), q, person)
    for _ in range(10):
        assert find_self_contact_sites(world(), draw_touching_pose(world(), EVERY, rng))
    for q in poses(20, seed=6):
        assert find_self_contact_sites(world(), q) == ()


@pytest.mark.parametrize("fold", [False, True])
def test_seed_decides_the_pose_in_a_new_environment_too(fold):
    again = build_environment(world().mounted, world().constants)
    one, other = (
        draw_pose(env, EVERY, np.random.default_rng(7), fold)
        for env in (world(), again)
    )
    assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("groups", [set(), {0}, {13}])
def test_unknown_pose_groups_are_refused(groups):
    with pytest.raises(ValueError, match="1 to 12"):
        draw_pose(world(), groups, np.random.default_rng(0))


@cache
def draw_sites(gesture, kind=None):
    """Draw poses, people and where they do a gesture."""
    rng = np.random.default_rng(11)
    return [
        (q, person, draw_site(world(), q, person, gesture, rng, kind))
        for q, person in zip(poses(COUNT, seed=1), people(COUNT), strict=True)
    ]


def compute_axes(q, site):
    """Return position, both tangents and normal of a site in the world."""
    T = world().poses(q)[world().links[site.chart]]
    chart = world().charts[site.chart]
    return [axis[0] for axis in compute_surface_axes(chart, np.array([site.centre]), T)]


def measure_edge_distance(site):
    chart = world().charts[site.chart]
    rim = world().targets.edges[site.chart]
    return compute_edge_distance(chart, rim, np.array([site.centre]))[0]


def find_regions(gesture, kind=None):
    """Return the regions in which a gesture is done."""
    targets = world().targets
    regions = dict(zip(targets.chart.tolist(), targets.region.tolist(), strict=True))
    sites = [site for _, _, site in draw_sites(gesture, kind)]
    return np.array([REGIONS[regions[site.chart]] for site in sites])


@pytest.mark.parametrize("gesture", PLACEMENT_LAWS)
def test_sites_face_the_person_within_reach_and_have_room(gesture):
    reached = []
    free = []
    for q, person, site in draw_sites(gesture):
        position, _, _, normal = compute_axes(q, site)
        view = build_view(world(), q, person)
        low, high = view.heights
        faces = normal @ (view.shoulder - position) > -1e-3
        reached.append(faces and low - 0.01 <= position[2] <= high + 0.01)
        free.append(has_room_for_hand(world(), site, gesture, world().poses(q)))
    # Where a pose has no such place with room, another is taken.
    assert np.mean(reached) >= 0.96 and np.mean(free) >= 0.97


@pytest.mark.parametrize("gesture", PLACEMENT_LAWS)
def test_sites_lie_on_a_taxel_or_between_two_edges(gesture):
    for _, _, site in draw_sites(gesture):
        chart = world().charts[site.chart]
        away = chart.unrolled - np.array(site.centre)
        away[:, 0] = chart.wrap_s(away[:, 0])
        # Half vectors of a cell are at right angles.
        shares = np.einsum("td,tad->ta", away, chart.cells)
        inside = np.abs(shares) <= np.sum(chart.cells**2, axis=2) * (1 + 1e-9)
        on_taxel = inside.all(axis=1).any()
        near = get_length("place.seam_gap") / 2 + 2e-3
        assert on_taxel or measure_edge_distance(site) <= near
        low, high = site.centre[1] + np.array(site.free_run)
        assert low >= chart.unrolled[:, 1].min() - 6e-3
        assert high <= chart.unrolled[:, 1].max() + 6e-3
        if gesture in ("grab", "stroke"):
            assert isinstance(chart.surface, Tube)
            assert np.ptp(chart.unrolled[:, 1]) > 0.2
            assert site.radius == chart.radius


@pytest.mark.parametrize(("rows", "columns", "pitch"), [(12, 16, 0.01), (1, 8, 0.02)])
def test_skin_too_small_for_a_gesture_is_touched_all_the_same(rows, columns, pitch):
    panel = MountedSkin(build_grid_skin(rows, columns, pitch), load_robot("table"))
    env = build_environment(panel, load_constants())
    rng = np.random.default_rng(1)
    for gesture in PLACEMENT_LAWS:
        site = draw_site(env, np.zeros(0), people(1)[0], gesture, rng)
        assert np.all(np.abs(site.centre) <= pitch * np.array([columns, rows]))


def test_regions_are_touched_as_often_as_stated():
    wanted = world().constants.weights("place.regions")
    for name in REGIONS:
        found = np.mean(find_regions("poke") == name)
        assert found == pytest.approx(wanted[name], abs=0.15)
    strokes = find_regions("stroke") == "forearm"
    assert np.mean(strokes) == pytest.approx(2 / 3, abs=0.15)


def test_sites_are_near_edges_and_on_seams_as_often_as_stated():
    rng = np.random.default_rng(3)
    value = world().constants.value
    q = poses(1, seed=4)[0]
    person = people(1)[0]
    sites = [draw_site(world(), q, person, "poke", rng) for _ in range(450)]
    within = get_length("place.edge_within")
    near = [measure_edge_distance(site) <= within for site in sites]
    chance = value("place.edge") + value("place.seam")
    assert np.mean(near) == pytest.approx(chance, abs=0.045)


def test_targets_cover_the_skin_once_and_seams_lie_between_patches():
    targets = world().targets
    covered = targets.areas[targets.kind != SEAM].sum()
    assert covered == pytest.approx(world().mounted.skin.areas.sum(), rel=1e-6)
    assert {INNER, EDGE, SEAM} == set(targets.kind.tolist())
    for chart in np.unique(targets.chart[targets.kind == SEAM]):
        seams = targets.unrolled[(targets.kind == SEAM) & (targets.chart == chart)]
        rim = targets.edges[chart]
        away = compute_edge_distance(world().charts[chart], rim, seams)
        assert away.max() <= get_length("place.seam_gap") / 2 + 1e-6


def test_contacts_without_a_law_of_places_take_those_of_the_gestures_evenly():
    rng = np.random.default_rng(0)
    for gesture, kind, law in (
        ("none", "guiding", "grab"),
        ("rub", "rub", "stroke"),
        ("poke", "two_tips", "poke"),
    ):
        assert choose_placement_law(gesture, kind, rng) == law
    kinds = ("bump", "lean", None) * 400
    laws = [choose_placement_law("none", kind, rng) for kind in kinds]
    for law in PLACEMENT_LAWS:
        assert laws.count(law) / len(laws) == pytest.approx(0.25, abs=0.04)
    together = np.concatenate([find_regions(law) for law in PLACEMENT_LAWS])
    none = find_regions("none", "resting_hand")
    for name in REGIONS:
        expected = np.mean(together == name)
        assert np.mean(none == name) == pytest.approx(expected, abs=0.13)
