"""These tests check sets: who touches what, how often, and that no seeds are shared."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eskin.sim import load_constants
from eskin.sim.dataset import GenerationSettings
from eskin.sim.dataset.plan import plan_clips, plan_sessions
from eskin.sim.dataset.sets import (
    CLASSES,
    FAMILY_SETS,
    FINAL_SETS,
    NON_GESTURES,
    PAPER_GESTURES,
    SETS,
    load_set,
    resize_set,
)
from eskin.sim.people.perform import NONE_PROGRAMS
from eskin.sim.sensor import FAMILIES
from eskin.units import NS_PER_S

CONSTANTS = load_constants()


@cache
def plan_files(name, clips=None, subjects=None, seed=0, difficulty=1.5):
    """Return each session of a set with its clips, the lead-in first."""
    clip_set = resize_set(load_set(name, CONSTANTS), clips, subjects, CONSTANTS)
    return [
        (session, plan_clips(session, clip_set, seed, difficulty, CONSTANTS))
        for session in plan_sessions(clip_set, seed, CONSTANTS)
    ]


def plan_set(name, clips=None, subjects=None, **options):
    """Return all clips of a set without lead-ins."""
    files = plan_files(name, clips, subjects, **options)
    return [plan for _, plans in files for plan in plans[1:]]


FOUR = ("paper", "paper-places", "paper-person", "paper-folded")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "people", "builds", "kind", "groups", "count"),
    [
        ("train", 60, 6, "fresh", range(1, 9), 12000),
        ("val", 12, 6, "fresh", range(1, 9), 2000),
        ("test-s", 15, 6, "fresh", range(1, 9), 2000),
        ("test-p", 15, 6, "fresh", range(9, 13), 2000),
        ("test-x", 15, 3, "shifted", range(9, 13), 2000),
        ("test-m", 15, 3, "shifted", range(9, 13), 2000),
        ("paper", 6, 1, "fresh", range(1, 13), 676),
        ("paper-5", 6, 1, "fresh", range(1, 13), 676),
        ("paper-places", 6, 1, "fresh", range(1, 13), 676),
        ("paper-person", 1, 1, "fresh", range(1, 13), 676),
        ("paper-folded", 6, 1, "fresh", range(1, 13), 676),
        ("streams", 10, 3, "shifted", range(1, 13), 80),
        ("streams-fresh", 10, 6, "fresh", range(1, 13), 80),
        ("accidents", 10, 3, "shifted", range(1, 13), 40),
        ("quiet", 10, 3, "shifted", range(1, 13), 100),
    ],
)
def test_set_has_its_stated_people_builds_poses_and_clips(
    name, people, builds, kind, groups, count
):
    plans = plan_set(name)
    assert len(plans) == count
    assert len({plan.person for plan in plans}) == people
    assert len({plan.build for plan in plans}) == builds
    assert {plan.build.kind for plan in plans} == {kind}
    assert {plan.groups for plan in plans} == {tuple(groups)}
    assert {plan.set_name for plan in plans} == {name}


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_file_is_one_session_that_begins_without_touch(name):
    sessions, files = zip(*plan_files(name), strict=True)
    assert len({session.file for session in sessions}) == len(sessions)
    starts = [session.start for session in sessions]
    assert (np.diff(starts) >= 250 * 6 * NS_PER_S).all()
    for lead, *plans in files:
        assert (lead.gesture, lead.kind, lead.at) == ("none", "idle", 0.0)
        assert (lead.seconds, lead.moving, lead.concurrent) == (1.5, False, 0.0)
        assert 1 <= len(plans) <= 250
        assert len({(p.person, p.build, p.session) for p in plans}) == 1
        assert [p.at for p in plans] == [6.0 * i for i in range(1, 1 + len(plans))]


@pytest.mark.parametrize("name", [n for n in SETS if load_set(n, CONSTANTS).classes])
def test_every_part_of_a_set_has_each_class_equally_often(name):
    parts: dict[str, Counter] = {}
    for session, (_, *plans) in plan_files(name):
        folder = session.file.rpartition("/")[0]
        parts.setdefault(folder, Counter()).update(plan.gesture for plan in plans)
    assert set(parts) == ({"train", "test"} if name.startswith("paper") else {""})
    for counts in parts.values():
        assert set(counts) == set(PAPER_GESTURES if name in FOUR else CLASSES)
        assert max(counts.values()) - min(counts.values()) <= 1


def test_paper_set_is_recorded_on_two_days():
    train, test = (
        [
            plan
            for session, (_, *plans) in plan_files("paper")
            if session.file.startswith(day)
            for plan in plans
        ]
        for day in ("train", "test")
    )
    assert (len(train), len(test)) == (581, 95)
    assert {plan.person for plan in train} == {plan.person for plan in test}
    assert len({plan.pose for plan in train}) == 10
    assert {plan.pose for plan in test} <= {plan.pose for plan in train}
    assert not {plan.session for plan in train} & {plan.session for plan in test}
    assert not any(plan.moving for plan in train + test)


@pytest.mark.parametrize(
    ("name", "kind", "hours"),
    [("streams", None, 2.0), ("quiet", "quiet", 5.0), ("accidents", "accidents", 1.0)],
)
def test_streams_have_their_kind_and_length(name, kind, hours):
    plans = plan_set(name)
    assert {(plan.gesture, plan.kind) for plan in plans} == {(None, kind)}
    seconds = [plan.seconds for plan in plans]
    assert sum(seconds) >= hours * 3600.0 - 1.0
    if name == "streams":
        assert sum(seconds) == pytest.approx(7200.0, abs=1.0)
        assert 60 <= min(seconds) < 62 and 118 < max(seconds) <= 120


@pytest.mark.parametrize("name", FAMILY_SETS)
def test_every_session_of_a_family_set_has_a_build_of_its_own(name):
    settings = GenerationSettings(name, clips=200)
    builds = [session.build for session in settings.sessions]
    assert len(set(builds)) == len({build.seed for build in builds}) == len(builds) >= 8
    kinds = Counter(build.kind for build in builds)
    expected = {name.removeprefix("test-")} & set(FAMILIES) or set(FAMILIES)
    assert set(kinds) == expected
    assert max(kinds.values()) - min(kinds.values()) <= 1
    assert {
        session.person.name.rpartition("-")[0] for session in settings.sessions
    } == {"test-families" if name.startswith("test") else name}


@pytest.mark.parametrize("name", FINAL_SETS)
def test_final_sets_share_no_person_or_build_with_others(name):
    sessions = GenerationSettings(name).sessions
    others = GenerationSettings(FINAL_SETS[name]).sessions
    assert len({session.person for session in sessions}) == 40
    assert len({session.build for session in sessions}) >= 25
    assert {s.build.kind for s in sessions} == {s.build.kind for s in others}
    for part in ("person", "build"):
        assert not {getattr(s, part).seed for s in sessions} & {
            getattr(s, part).seed for s in others
        }


@pytest.mark.parametrize("name", ["train", "train-families", "pairs", "val"])
def test_nothing_is_trained_on_poses_of_the_tests(name):
    trained = set(load_set(name, CONSTANTS).groups)
    assert not trained & set(load_set("test-p", CONSTANTS).groups)


def test_any_set_can_be_made_of_chosen_families():
    usual = GenerationSettings("test-p", clips=200)
    chosen = GenerationSettings("test-p", clips=200, families=("linear", "divider"))
    assert {session.build.kind for session in chosen.sessions} == {"linear", "divider"}
    assert {session.build.kind for session in usual.sessions} == {"fresh"}
    assert {s.person for s in chosen.sessions} == {s.person for s in usual.sessions}
    assert chosen.to_json()["families"] == ["linear", "divider"]
    assert "families" not in usual.to_json()


def test_no_two_clips_people_or_builds_have_the_same_seed():
    seeds: dict[tuple, tuple] = {}
    for name in SETS:
        for seed in (0, 1):
            for session, plans in plan_files(name, 60, seed=seed):
                for number, plan in enumerate(plans):
                    own = (name, seed, session.number, number)
                    assert seeds.setdefault(plan.seed, own) == own
                    for origin in (plan.person, plan.build, plan.session):
                        of = (type(origin).__name__, origin.name, seed)
                        assert seeds.setdefault(origin.seed, of) == of
    states = [np.random.SeedSequence(s).generate_state(4).tobytes() for s in seeds]
    assert len(set(states)) == len(states)


def test_sets_share_people_and_builds_only_where_stated():
    people = {name: {p.person.name for p in plan_set(name, 200)} for name in SETS}
    builds = {name: {p.build.name for p in plan_set(name, 200)} for name in SETS}
    for one in SETS:
        for other in SETS:
            related = one == other or one.split("-")[0] == other.split("-")[0] != "test"
            assert bool(people[one] & people[other]) == related
    assert builds["train"] == builds["val"] == builds["test-s"] == builds["test-p"]
    assert builds["test-x"] == builds["test-m"] == builds["streams"]
    assert builds["test-x"] == builds["accidents"] == builds["quiet"]
    assert not builds["train"] & builds["test-x"]
    assert not builds["paper"] & (builds["train"] | builds["test-x"])


@pytest.mark.parametrize("name", SETS)
def test_small_set_has_fewer_people_and_the_same_structure(name):
    plans = plan_set(name, 20)
    classes = load_set(name, CONSTANTS).classes
    assert len(plans) == 20
    by_person = Counter(plan.person for plan in plans)
    assert min(by_person.values()) >= len(classes) - len(classes) // 3
    assert not classes or {plan.gesture for plan in plans} == set(classes)
    plans = plan_set(name, 60)
    people = {plan.person for plan in plans}
    for plan in plans:
        assert plan.company is None or plan.company in people - {plan.person}


def test_numbers_of_people_and_files_follow_from_the_clips_or_are_given():
    assert len({plan.person for plan in plan_set("train", 600)}) == 60
    assert len({plan.person for plan in plan_set("train", 20, 3)}) == 3
    assert {plan.company for plan in plan_set("train", 10, 1)} == {None}
    assert [len(plans) - 1 for _, plans in plan_files("train", 1000, 1)] == [250] * 4


def test_difficulty_changes_only_what_depends_on_it():
    easy, hard = (plan_set("train", 40, difficulty=level) for level in (0.0, 2.0))
    assert {plan.concurrent for plan in easy} == {0.0}
    assert {plan.concurrent for plan in hard} == {0.24}
    for one, other in zip(easy, hard, strict=True):
        assert replace(one, difficulty=2.0, concurrent=0.24) == other


def test_set_without_gestures_holds_every_kind_of_touch_that_is_none():
    clips = plan_set(NON_GESTURES, clips=1000)
    assert {plan.gesture for plan in clips} == {"none"}
    # Links that touch need a pose of their own; the others need no touch.
    left_out = {"idle", "electrical", "self_contact"}
    assert {plan.kind for plan in clips} == set(NONE_PROGRAMS) - left_out
