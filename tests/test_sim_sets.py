"""Sets of clips: who touches what, how often, and that no two sets share a seed."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.dataset.session_plan import plan_clips, plan_sessions
from eskin.sim.dataset.sets import CLASSES, PAPER_GESTURES, SETS, load_set, resize_set

CONSTANTS = load_constants()
DIFFICULTY = 1.5


def small(name, clips=None, subjects=None):
    return resize_set(load_set(name, CONSTANTS), clips, subjects, CONSTANTS)


def sittings(chosen, seed=0):
    return plan_sessions(chosen, seed, CONSTANTS)


def plans(chosen, seed=0, difficulty=DIFFICULTY):
    """All clips of a set without its lead-ins, by file."""
    return {
        sitting.file: plan_clips(sitting, chosen, seed, difficulty, CONSTANTS)[1:]
        for sitting in sittings(chosen, seed)
    }


def clips(chosen, seed=0):
    return [plan for file in plans(chosen, seed).values() for plan in file]


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
        ("streams", 10, 3, "shifted", range(1, 13), 80),
        ("streams-fresh", 10, 6, "fresh", range(1, 13), 80),
        ("accidents", 10, 3, "shifted", range(1, 13), 40),
        ("quiet", 10, 3, "shifted", range(1, 13), 100),
    ],
)
def test_a_set_has_the_people_builds_poses_and_clips_that_are_specified(
    name, people, builds, kind, groups, count
):
    found = clips(load_set(name, CONSTANTS))
    assert len(found) == count
    assert len({plan.person for plan in found}) == people
    assert len({plan.build for plan in found}) == builds
    assert {plan.build.kind for plan in found} == {kind}
    assert {plan.groups for plan in found} == {tuple(groups)}
    assert {plan.set_name for plan in found} == {name}


@pytest.mark.parametrize("name", [n for n in SETS if load_set(n, CONSTANTS).classes])
def test_every_part_of_a_set_does_everything_equally_often(name):
    chosen = load_set(name, CONSTANTS)
    assert chosen.classes == (PAPER_GESTURES if name == "paper" else CLASSES)
    by_part: dict[str, Counter] = {}
    for file, found in plans(chosen).items():
        folder = file.rpartition("/")[0]
        by_part.setdefault(folder, Counter()).update(plan.gesture for plan in found)
    assert len(by_part) == len(chosen.parts)
    for counts in by_part.values():
        assert set(counts) == set(chosen.classes)
        assert max(counts.values()) - min(counts.values()) <= 1


def test_the_paper_set_is_recorded_on_two_days():
    found = plans(load_set("paper", CONSTANTS))
    days = {
        day: [p for file, made in found.items() if file.startswith(day) for p in made]
        for day in ("train", "test")
    }
    assert [len(day) for day in days.values()] == [581, 95]
    train, test = days["train"], days["test"]
    assert {plan.person for plan in train} == {plan.person for plan in test}
    assert len({plan.pose for plan in train}) == 10
    assert {plan.pose for plan in test} <= {plan.pose for plan in train}
    assert not {plan.session for plan in train} & {plan.session for plan in test}
    assert not any(plan.moving for plan in train + test)


def test_the_robot_moves_in_a_fifth_of_the_clips_and_always_in_test_m():
    moving = [plan.moving for plan in clips(load_set("train", CONSTANTS))]
    assert np.mean(moving) == pytest.approx(0.2, abs=0.02)
    assert all(plan.moving for plan in clips(load_set("test-m", CONSTANTS)))


def test_streams_are_a_minute_or_two_and_two_hours_together():
    seconds = [plan.seconds for plan in clips(load_set("streams", CONSTANTS))]
    assert sum(seconds) == pytest.approx(7200.0, abs=1.0)
    assert 60 <= min(seconds) < 62 and 118 < max(seconds) <= 120
    assert {plan.gesture for plan in clips(load_set("streams", CONSTANTS))} == {None}


def test_streams_without_gestures_last_long_and_move_in_half_of_them():
    for name, hours in (("quiet", 5.0), ("accidents", 1.0)):
        found = clips(load_set(name, CONSTANTS))
        assert {(plan.gesture, plan.kind) for plan in found} == {(None, name)}
        assert sum(plan.seconds for plan in found) >= hours * 3600.0 - 1.0
        assert np.mean([plan.moving for plan in found]) == pytest.approx(0.5, abs=0.15)
    assert {plan.kind for plan in clips(load_set("streams", CONSTANTS))} == {None}


def test_a_file_is_one_sitting_of_at_most_250_clips_one_every_six_seconds():
    for name in SETS:
        chosen = load_set(name, CONSTANTS)
        names = [sitting.file for sitting in sittings(chosen)]
        assert len(set(names)) == len(names)
        for found in plans(chosen).values():
            assert 1 <= len(found) <= 250
            assert len({(p.person, p.build, p.session) for p in found}) == 1
            assert [plan.at for plan in found] == [
                6.0 * i for i in range(1, 1 + len(found))
            ]
    one = small("train", 1000, 1)
    assert [len(found) for found in plans(one).values()] == [250] * 4


def test_files_of_a_set_do_not_overlap_in_time():
    for name in SETS:
        starts = [sitting.start for sitting in sittings(load_set(name, CONSTANTS))]
        assert (np.diff(starts) >= 250 * 6 * 1_000_000_000).all()


def test_a_file_begins_without_touch():
    for name in SETS:
        chosen = small(name, 10)
        lead = plan_clips(sittings(chosen)[0], chosen, 0, DIFFICULTY, CONSTANTS)[0]
        assert (lead.gesture, lead.kind, lead.at, lead.seconds) == (
            "none",
            "idle",
            0.0,
            1.5,
        )
        assert (lead.moving, lead.concurrent) == (False, 0.0)


def test_no_two_clips_people_or_builds_have_the_same_seed():
    seeds: dict[tuple, tuple] = {}
    for name in SETS:
        for seed in (0, 1):
            chosen = small(name, 60)
            for sitting in sittings(chosen, seed):
                made = plan_clips(sitting, chosen, seed, DIFFICULTY, CONSTANTS)
                for number, plan in enumerate(made):
                    own = (name, seed, sitting.number, number)
                    assert seeds.setdefault(plan.seed, own) == own
                    for origin in (plan.person, plan.build, plan.session):
                        of = (type(origin).__name__, origin.name, seed)
                        assert seeds.setdefault(origin.seed, of) == of
    states = [np.random.SeedSequence(s).generate_state(4).tobytes() for s in seeds]
    assert len(set(states)) == len(states)


def test_sets_share_people_and_builds_only_where_they_are_meant_to():
    people, builds = {}, {}
    for name in SETS:
        found = clips(small(name, 200))
        people[name] = {plan.person.name for plan in found}
        builds[name] = {plan.build.name for plan in found}
    for one in SETS:
        for other in SETS:
            related = one == other or one.split("-")[0] == other.split("-")[0] != "test"
            assert bool(people[one] & people[other]) == related
    assert builds["train"] == builds["val"] == builds["test-s"] == builds["test-p"]
    assert builds["test-x"] == builds["test-m"] == builds["streams"]
    assert builds["test-x"] == builds["accidents"] == builds["quiet"]
    assert not builds["train"] & builds["test-x"]
    assert not builds["paper"] & (builds["train"] | builds["test-x"])


def test_company_is_somebody_else_of_the_same_set():
    for name in SETS:
        found = clips(small(name, 60))
        people = {plan.person for plan in found}
        for plan in found:
            assert plan.company is None or plan.company in people - {plan.person}
    assert all(plan.company is None for plan in clips(small("train", 10, 1)))


def test_a_small_set_has_fewer_people_and_the_same_structure():
    for name in SETS:
        found = clips(small(name, 20))
        assert len(found) == 20
        by_person = Counter(plan.person for plan in found)
        classes = load_set(name, CONSTANTS).classes
        assert min(by_person.values()) >= len(classes) - len(classes) // 3
        if classes:
            assert {plan.gesture for plan in found} == set(classes)
    assert len({plan.person for plan in clips(small("train", 600))}) == 60
    assert len({plan.person for plan in clips(small("train", 20, 3))}) == 3


def test_difficulty_only_changes_what_depends_on_it():
    chosen = small("train", 40)
    easy, hard = (
        [p for file in plans(chosen, 0, each).values() for p in file]
        for each in (0.0, 2.0)
    )
    assert {plan.concurrent for plan in easy} == {0.0}
    assert {plan.concurrent for plan in hard} == {0.24}
    for one, other in zip(easy, hard, strict=True):
        assert replace(one, difficulty=2.0, concurrent=0.24) == other


@pytest.mark.parametrize(
    ("name", "clips", "subjects", "message"),
    [
        ("train", 0, None, "0 clips asked of set 'train'; allowed are at least 1"),
        ("paper", 1, None, "1 clips asked of set 'paper'; allowed are at least 2"),
        ("train", 10, 11, "11 people asked of set 'train' of 10 clips"),
        ("train", 10, 0, "0 people asked of set 'train'"),
        ("test", None, None, "no set 'test'; allowed are train, val"),
    ],
)
def test_what_cannot_be_made_is_refused_in_one_line(name, clips, subjects, message):
    with pytest.raises(ValueError, match=message) as caught:
        small(name, clips, subjects)
    assert "\n" not in str(caught.value)
