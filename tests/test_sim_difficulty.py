"""How hard simulated clips are, what bounds it, and what may not tell it."""

import numpy as np
from benchmarks.simulation.ceiling import wilson_interval
from benchmarks.simulation.clips import as_tap, pressure_of, sitting_of
from benchmarks.simulation.confusion import counted, pairs_check
from benchmarks.simulation.features import NAMES, clip_features
from benchmarks.simulation.forest import spread_of
from benchmarks.simulation.leakage import over_people
from benchmarks.simulation.remains import EDGES, histogram_of
from benchmarks.simulation.true_features import runs, true_features

from eskin.sim.dataset import GenerationSettings
from eskin.touch import Calibration


def touch(force):
    truth = np.zeros((100, 5))
    truth[:, 0], truth[:, 1] = force, np.asarray(force) / 10
    truth[:, 2:] = np.where(truth[:, :1] > 0, 1.0, np.nan)
    return truth


def test_counts_of_a_pressure_read_as_that_pressure():
    wanted = np.array([2.0, 10.0, 60.0])
    calibration = Calibration(np.full(3, 0.02), 4095, curve="divider", exponent=0.8)
    counts = np.array([calibration.compute_counts(kpa)[0] for kpa in wanted])
    read = pressure_of(
        np.round(counts[None] + 100).astype(np.int32),
        np.ones((1, 3), dtype=bool),
        np.full(3, 100.0),
        calibration,
    )
    np.testing.assert_allclose(read[0], wanted, rtol=0.02)


def test_what_was_not_received_reads_as_nothing():
    calibration = Calibration.uniform(2, 4095, 100.0)
    counts, received = np.full((3, 2), 2000), np.array([[True, False]] * 3)
    read = pressure_of(counts.astype(np.int32), received, np.zeros(2), calibration)
    assert (read[:, 0] > 40).all()
    assert (read[:, 1] == 0).all()


def test_features_of_an_untouched_skin_are_zero():
    positions = np.zeros((4, 3))
    found = clip_features(np.zeros((100, 4)), positions, np.full(4, 1e-4))
    assert found.tolist() == [0.0] * len(NAMES)


def test_two_pats_have_two_peaks_and_a_gap():
    pressure = np.zeros((100, 2))
    pressure[20:26, 0] = pressure[40:46, 0] = 20.0
    found = dict(
        zip(
            NAMES,
            clip_features(pressure, np.eye(2, 3), np.full(2, 1e-4)),
            strict=True,
        )
    )
    assert (found["peaks"], found["gaps"], found["union of taxels"]) == (2, 1, 1)
    assert np.isclose(found["peak force"], 2.0)
    assert np.isclose(found["seconds"], 0.52)


def test_histograms_do_not_depend_on_where_and_when():
    rng = np.random.default_rng(0)
    pressure = rng.exponential(10.0, (20, 30))
    shuffled = rng.permutation(pressure.ravel()).reshape(20, 30)
    assert (histogram_of(pressure) == histogram_of(shuffled)).all()
    assert histogram_of(pressure).sum() == np.sum(pressure >= EDGES[0])


def test_true_features_are_finite_and_as_many_for_every_touch():
    nothing, long = np.zeros(100), np.full(100, 5.0)
    short = np.zeros(100)
    short[50] = 3.0
    found = [true_features(touch(force)) for force in (nothing, long, short)]
    assert len({len(each) for each in found}) == 1
    assert all(np.isfinite(each).all() for each in found)


def test_true_features_do_not_depend_on_where_a_link_was_touched():
    force = np.sin(np.linspace(0, np.pi, 100)) * 5
    here, there = touch(force), touch(force)
    there[:, 2:] += [3.0, -2.0, 7.0]
    np.testing.assert_allclose(true_features(here), true_features(there), atol=1e-9)


def test_runs_are_the_stretches_that_are_true():
    assert runs(np.array([True, True, False, True])) == [2, 1]
    assert runs(np.zeros(3, dtype=bool)) == []


def test_people_who_differ_by_counting_alone_do_not_differ_beyond_it():
    rng = np.random.default_rng(0)
    people = np.repeat([f"p{i}" for i in range(200)], 50)
    alike = spread_of(rng.random(10_000) < 0.8, people)
    assert 0.04 < alike.deviation < 0.07
    assert alike.beyond < 0.02
    share = np.repeat(rng.uniform(0.6, 1.0, 200), 50)
    unlike = spread_of(rng.random(10_000) < share, people)
    assert 0.09 < unlike.beyond < 0.14


def test_an_interval_holds_its_share_and_shrinks():
    low, high = wilson_interval(90, 100)
    assert low < 0.9 < high
    narrow = wilson_interval(9_000, 10_000)
    assert narrow[1] - narrow[0] < (high - low) / 5


def test_guesses_by_chance_have_chance_in_their_interval():
    rng = np.random.default_rng(0)
    labels, guess = (rng.choice(list("abcde"), 2000) for _ in "lg")
    people = np.repeat([f"p{i}" for i in range(40)], 50)
    low, high = over_people(labels, guess, people, 0)
    assert low <= 0.2 <= high
    assert over_people(labels, labels, people, 0) == (1.0, 1.0)


def test_the_most_confused_pairs_are_counted_both_ways():
    said = [("grab", "squeeze", 2), ("squeeze", "grab", 1), ("stroke", "rub", 2)]
    said += [("double_pat", "tap", 1), ("tap", "tap", 5), ("rub", "rub", 5)]
    labels, guess = (
        np.repeat([each[i] for each in said], [each[2] for each in said])
        for i in range(2)
    )
    check = pairs_check(labels, guess)
    assert counted(labels, guess).sum() == len(labels)
    assert check.met
    assert check.measured.startswith("squeeze-grab 3, stroke-rub 2")
    others = np.where(labels == "grab", "rub", guess)
    assert not pairs_check(labels, others).met


def test_a_tap_is_a_pat_alone_that_keeps_its_plan():
    settings = GenerationSettings("train", clips=5, subjects=1)
    plan = settings.plan_clips(settings.sessions[0])[1]
    assert as_tap(plan) is plan


def test_what_is_kept_of_clips_is_finite_and_small():
    settings = GenerationSettings("train", clips=5, subjects=1)
    sitting = settings.sessions[0]
    made = sitting_of(sitting, settings.plan_clips(sitting), False)
    assert sorted(each.label for each in made) == sorted(
        ["poke", "double_pat", "grab", "stroke", "none"]
    )
    for each in made:
        assert np.isfinite(each.features).all()
        assert each.truth.shape == (100, 5)
        assert np.isfinite(each.truth[each.truth[:, 0] > 0]).all()
    felt = [each.truth[:, 0].max() for each in made if each.label != "none"]
    assert min(felt) > 0
