"""Corruptions of the robustness benchmark: their effect, amount and limits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from eskin.live import GraphConfig
from eskin.recording import Metadata, RecordingWriter, read_recording, write_all
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from helpers.baselines import SMALL, UR5, toy
from helpers.clips import generated
from lab import robustness
from lab.baselines import BASELINES, FitConfig, build_baseline
from lab.baselines.estimators import RandomForest
from lab.baselines.flat import FlatBaseline
from lab.baselines.hand import HandBaseline
from lab.comparison import (
    METHODS,
    AnsweredClips,
    MethodResult,
    TrainingTask,
    find_examples,
)
from lab.corruption import DRIFT_SECONDS, DRIFT_START, KINDS, Corruption

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PERIOD = SECOND // 50
REST, HIGH, FULL_SCALE = 300, 900, 4095
SCANS = 160
AMOUNTS = {
    "dead": 0.1,
    "patches": 2.0,
    "noise": 0.01,
    "drift": 2.0,
    "lost": 0.2,
    "rate": 200.0,
    "pose-mm": 20.0,
    "pose-deg": 10.0,
}
OF_SCANS = [kind for kind in KINDS if not kind.startswith("pose")]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A moving arm: all taxels pressed after 2 s, later a pause of 4 s."""
    skin, rng = UR5.skin, np.random.default_rng(0)
    scans = []
    for n in range(SCANS):
        pause = 4 * SECOND if n >= 130 else 0
        counts = REST + rng.integers(-2, 3, skin.count)
        counts[rng.random(skin.count) < 0.5] += HIGH * (100 <= n < 120)
        received = rng.random(skin.count) < 0.98
        q = np.sin(0.01 * n + np.arange(6))
        stamp = START + n * PERIOD + pause
        scans.append(Scan(stamp, counts.astype(np.int32), received, q))
    path = tmp_path_factory.mktemp("corruption") / "a.mcap"
    calibration = Calibration.uniform(skin.count, FULL_SCALE, 100.0)
    with RecordingWriter(path, "ur5", skin, calibration, Metadata("scene")) as writer:
        write_all(writer, scans, [])
    return read_recording(path)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Two clips."""
    folder = tmp_path_factory.mktemp("set")
    generated(folder / "a", clips=2)
    return find_examples([folder / "a"], folder / "pack")


def stacked(scans):
    """Stamps, counts, `received` and joint positions of scans, as arrays."""
    rows = [(scan.stamp, scan.counts, scan.received, scan.q) for scan in scans]
    return tuple(map(np.array, zip(*rows, strict=True)))


def same(one, other):
    return all(map(np.array_equal, one, other))


def same_graphs(one, other):
    return same(one.graphs, other.graphs) and np.array_equal(one.stamps, other.stamps)


@pytest.mark.parametrize("kind", KINDS)
def test_amount_zero_changes_nothing(kind, recording, examples):
    none = Corruption(kind, 0.0)
    assert same(stacked(none.transform_scans(recording)), stacked(recording.scans()))
    skin = none.transform_skin(recording.skin, recording.start)
    for name in ("positions", "normals", "tangents"):
        assert np.array_equal(getattr(skin, name), getattr(recording.skin, name))
    changed = replace(examples, transform=none)
    assert np.array_equal(changed.windows.pressure, examples.windows.pressure)
    assert np.array_equal(changed.windows.q, examples.windows.q)
    graph = GraphConfig()
    assert same_graphs(changed.dataset(graph), examples.dataset(graph))


@pytest.mark.parametrize("kind", KINDS)
def test_the_seed_alone_decides_what_is_drawn(kind, recording):
    def drawn(seed):
        corruption = Corruption(kind, AMOUNTS[kind], seed)
        skin = corruption.transform_skin(recording.skin, recording.start)
        return (*stacked(corruption.transform_scans(recording)), skin.positions)

    assert same(drawn(0), drawn(0))
    assert same(drawn(0), drawn(1)) == (kind == "rate")


@pytest.mark.parametrize("kind", OF_SCANS)
def test_corruptions_of_scans_leave_the_skin_alone(kind, recording):
    corruption = Corruption(kind, AMOUNTS[kind])
    assert corruption.transform_skin(recording.skin, recording.start) is recording.skin


@pytest.mark.parametrize("kind", ["dead", "patches", "noise", "drift", "lost"])
def test_each_corruption_changes_one_field(kind, recording):
    was, now = (
        stacked(recording.scans()),
        stacked(Corruption(kind, AMOUNTS[kind]).transform_scans(recording)),
    )
    kept = np.isin(was[0], now[0])
    assert kept.all() == (kind != "lost")
    for name, before, after in zip(
        ("stamp", "counts", "received", "q"), was, now, strict=True
    ):
        touched = {"patches": "received", "lost": ""}.get(kind, "counts")
        assert np.array_equal(before[kept], after) == (name != touched), name
    assert now[1].min() >= 0 and now[1].max() <= FULL_SCALE


@pytest.mark.parametrize("kind", ["dead", "lost", "patches"])
def test_a_larger_amount_contains_the_smaller(kind, recording):
    def missing(amount):
        stamps, counts, received, _ = stacked(
            Corruption(kind, amount).transform_scans(recording)
        )
        all_stamps = stacked(recording.scans())[0]
        return {
            "dead": set(np.flatnonzero(np.ptp(counts, axis=0) == 0)),
            "lost": set(all_stamps) - set(stamps),
            "patches": set(np.flatnonzero(~received.any(axis=0))),
        }[kind]

    little, much = (1.0, 2.0) if kind == "patches" else (0.05, 0.1)
    assert missing(little) < missing(much)


def test_dead_taxels_have_the_given_share_and_never_rise(recording):
    was = stacked(recording.scans())
    _, counts, received, _ = stacked(Corruption("dead", 0.1).transform_scans(recording))
    dead = np.where(received, counts, REST).max(axis=0) < REST + 10
    assert (was[1].max(axis=0) > REST + HIGH - 10).all()
    assert dead.sum() == round(0.1 * recording.skin.count)
    assert np.array_equal(counts[:, ~dead], was[1][:, ~dead])


def test_missing_patches_are_never_received_and_others_unchanged(recording):
    was, now = (
        stacked(each)[2]
        for each in (
            recording.scans(),
            Corruption("patches", 2.0).transform_scans(recording),
        )
    )
    patch = recording.skin.patch_index
    silent = {int(n) for n in np.unique(patch) if not now[:, patch == n].any()}
    assert len(silent) == 2
    others = ~np.isin(patch, list(silent))
    assert np.array_equal(was[:, others], now[:, others])


def test_noise_has_the_given_standard_deviation(recording):
    _, was, received, _ = stacked(recording.scans())
    _, now, _, _ = stacked(Corruption("noise", 0.01).transform_scans(recording))
    noise = (now - was)[received]
    assert noise.std() == pytest.approx(0.01 * FULL_SCALE, rel=0.01)
    assert abs(noise.mean()) < 0.5
    assert np.array_equal(now[~received], was[~received])


def test_drift_begins_after_the_tare_and_goes_there_and_back(recording):
    stamps, was, received, _ = stacked(recording.scans())
    _, now, _, _ = stacked(Corruption("drift", 2.0).transform_scans(recording))
    kpa = (now - was) * 100 / FULL_SCALE
    seconds = (stamps - stamps[0]) / SECOND
    assert (
        np.abs(kpa)[seconds <= DRIFT_START][received[seconds <= DRIFT_START]] == 0
    ).all()
    moved = seconds - np.where(seconds > 4, 4.02, 0.0) - DRIFT_START
    wanted = 2.0 * (DRIFT_SECONDS - np.abs(np.maximum(moved, 0) - DRIFT_SECONDS))
    apart = np.abs(np.abs(kpa) - wanted[:, None])
    assert apart[received].max() < 100 / FULL_SCALE
    signs = np.sign(kpa[100][received[100]])
    assert set(signs) == {-1.0, 1.0} and abs(signs.mean()) < 0.1


def test_lost_scans_have_the_given_share(recording):
    was, now = (
        stacked(recording.scans()),
        stacked(Corruption("lost", 0.2).transform_scans(recording)),
    )
    assert len(now[0]) == SCANS - round(0.2 * SCANS)
    assert set(now[0]) < set(was[0])


def test_25_hz_keeps_every_other_scan(recording):
    was, now = (
        stacked(recording.scans()),
        stacked(Corruption("rate", 25.0).transform_scans(recording)),
    )
    assert same([each[::2] for each in was], now)


@pytest.mark.parametrize("times", [2, 4])
def test_higher_rates_interpolate_between_scans(recording, times):
    was = stacked(recording.scans())
    now = stacked(Corruption("rate", 50.0 * times).transform_scans(recording))
    assert len(now[0]) == times * SCANS
    assert same([each[::times] for each in now], was)
    assert (np.diff(now[0]) > 0).all()
    half = slice(times // 2, 129 * times, times)
    mean = (was[1][:129] + was[1][1:130]) / 2
    assert np.abs(now[1][half] - mean).max() <= 0.5
    assert np.array_equal(now[2][half], was[2][:129] & was[2][1:130])
    np.testing.assert_allclose(now[3][half], (was[3][:129] + was[3][1:130]) / 2)


def test_nothing_is_interpolated_over_a_pause(recording):
    stamps, counts, _, _ = stacked(Corruption("rate", 100.0).transform_scans(recording))
    assert stamps[259] - stamps[258] == PERIOD // 2
    assert np.array_equal(counts[259], counts[258])
    assert stamps[260] - stamps[259] > 4 * SECOND


@pytest.mark.parametrize("kind", ["pose-mm", "pose-deg"])
def test_links_move_rigidly_by_the_amount_and_no_scan_changes(kind, recording):
    corruption, skin = Corruption(kind, AMOUNTS[kind]), recording.skin
    scans = stacked(corruption.transform_scans(recording))
    assert same(scans, stacked(recording.scans()))
    moved = corruption.transform_skin(skin, recording.start)
    links, shifts = np.array(skin.link_names)[skin.patch_index], []
    for link in set(skin.link_names):
        on = links == link
        p, now = skin.positions[on], moved.positions[on]
        np.testing.assert_allclose(distances(now), distances(p), atol=1e-12)
        shift = now.mean(axis=0) - p.mean(axis=0)
        length = 0.02 if kind == "pose-mm" else 0.0
        assert np.linalg.norm(shift) == pytest.approx(length, abs=1e-12)
        rotation = find_rotation(p, now)
        angle = 10.0 if kind == "pose-deg" else 0.0
        cosine = (np.trace(rotation) - 1) / 2
        assert cosine == pytest.approx(np.cos(np.radians(angle)), abs=1e-9)
        for name in ("normals", "tangents"):
            turned = getattr(skin, name)[on] @ rotation.T
            np.testing.assert_allclose(getattr(moved, name)[on], turned, atol=1e-9)
        shifts.append(tuple((now - p)[0]))
    assert len(set(shifts)) == len(shifts) > 1


def distances(points):
    return np.linalg.norm(points[:40, None] - points[None], axis=-1)


def find_rotation(one, other):
    """Rotation about the centroid that maps points to others (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((one - one.mean(0)).T @ (other - other.mean(0)))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    return vt.T @ sign @ u.T


def test_misplaced_links_change_graphs_and_no_window(examples):
    wrong = replace(examples, transform=Corruption("pose-deg", 10.0))
    was, now = (each.dataset(GraphConfig()).graphs for each in (examples, wrong))
    assert np.array_equal(was.pressure, now.pressure)
    between = (was.normals * now.normals).sum(axis=1)
    assert 0.98 < between.min() <= between.max() < 1.0
    assert np.array_equal(examples.windows.pressure, wrong.windows.pressure)
    mounted = examples.mounted
    [(found, windows)] = wrong.find_windows_on(mounted)
    assert windows.count == len(examples.clips)
    skin = wrong.transform.transform_skin(
        mounted.skin, read_recording(examples.paths[0]).start
    )
    assert np.array_equal(found.skin.positions, skin.positions)
    assert not np.allclose(skin.positions, mounted.skin.positions, atol=1e-4)


def test_a_baseline_is_tested_on_the_misplaced_skin(examples, monkeypatch):
    positions = []

    def move_to(baseline, mounted):
        positions.append(mounted.skin.positions)
        return baseline

    monkeypatch.setattr(FlatBaseline, "move_to", move_to)
    wrong = replace(examples, transform=Corruption("pose-mm", 20.0))
    METHODS["knn-max"].fit(examples, 0)(wrong)
    start = read_recording(examples.paths[0]).start
    skin = wrong.transform.transform_skin(examples.mounted.skin, start)
    np.testing.assert_array_equal(positions, [skin.positions])


@pytest.mark.parametrize(
    ("name", "uses_positions"),
    [("random-forest", True), ("paper", True), ("knn-max", False), ("cnn-lstm", False)],
)
def test_only_methods_that_use_positions_depend_on_them(
    name, uses_positions, monkeypatch
):
    few_trees = partial(HandBaseline, estimator=RandomForest(trees=30))
    monkeypatch.setitem(BASELINES, "random-forest", few_trees)
    clips, labels = toy(2)
    fitted = build_baseline(name, SMALL, FitConfig(epochs=1)).fit(clips, labels)
    answers = fitted.predict_probabilities(clips)
    again = fitted.move_to(MountedSkin(SMALL.skin, SMALL.robot)).predict_probabilities(
        clips
    )
    np.testing.assert_allclose(again, answers, atol=1e-6)
    skin = replace(SMALL.skin, positions=3.0 * SMALL.skin.positions)
    other = fitted.move_to(MountedSkin(skin, SMALL.robot)).predict_probabilities(clips)
    assert np.allclose(other, answers, atol=1e-6) == (not uses_positions)
    assert np.array_equal(fitted.predict_probabilities(clips), answers)


def test_every_corruption_has_its_own_digest(examples):
    corruptions = [
        None,
        Corruption("dead", 0.1),
        Corruption("dead", 0.2),
        Corruption("dead", 0.1, 1),
    ]
    tests = [replace(examples, transform=each) for each in corruptions]
    assert len({each.digest for each in tests}) == len(corruptions)
    digests = {
        TrainingTask("a", METHODS["eskin"], examples, {"test": each}, 0).digest
        for each in tests
    }
    assert len(digests) == len(corruptions)
    assert tests[1].select([0]).transform == corruptions[1]


def test_every_corruption_has_its_own_windows(examples):
    """One taxel is pressed; noise changes its pressure, and those at rest read zero."""
    corruptions = [None, Corruption("noise", 0.01), Corruption("noise", 0.02)]
    tests = [replace(examples, transform=each) for each in corruptions]
    pressures = [each.windows.pressure.tobytes() for each in tests]
    assert len(set(pressures)) == 3


@pytest.mark.parametrize(
    ("kind", "amount", "message"),
    [
        ("dead", 1.5, "amount is 1.5; allowed is 0 to 1"),
        ("noise", -1.0, "amount is -1.0; allowed is"),
        ("patches", 1.5, "amount of patches is 1.5; allowed are whole numbers"),
    ],
)
def test_impossible_amounts_are_refused(kind, amount, message):
    with pytest.raises(ValueError, match=message):
        Corruption(kind, amount)


def test_amounts_that_the_recording_does_not_allow_are_refused(recording):
    with pytest.raises(ValueError, match="10 patches are to be missing of 9"):
        next(Corruption("patches", 10.0).transform_scans(recording))
    with pytest.raises(ValueError, match=r"rate is 30 Hz of scans that came at 50\.0"):
        next(iter(Corruption("rate", 30.0).transform_scans(recording)))


def test_the_lead_stands_beside_every_corrupted_accuracy():
    def one(name, right):
        answers = ("poke" if each else "grab" for each in right)
        people = tuple(f"p{n % 5}" for n in range(len(right)))
        clips = AnsweredClips(("poke",) * len(right), tuple(answers), people)
        return MethodResult(name, 0, 1.0, {"as recorded": clips})

    good, bad = [True] * 40, [n % 5 < 3 for n in range(40)]
    found = {"ours": {(0, 0): one("ours", good)}, "other": {(0, 0): one("other", bad)}}
    assert robustness.table(found).splitlines() == [
        "| accuracy [%] | ours | other (ours ahead) |",
        "|---|---|---|",
        "| as recorded | 100.0 | 60.0 (+40.0 [+0.0, +80.0]) |",
    ]


def test_each_draw_is_corrupted_with_its_own_seed(tmp_path):
    generated(tmp_path / "a", clips=1)
    sets = (tmp_path / "a",) * 3
    command = robustness.Command(sets, sets, kinds=("dead",), seed=5)
    tasks = robustness.build_tasks(command, "eskin", METHODS)
    assert [task.seed for task in tasks] == [5, 6, 7]
    for task in tasks:
        used = [each.transform for each in task.tests.values() if each.transform]
        assert len(used) == len(robustness.AMOUNTS["dead"])
        assert {each.seed for each in used} == {task.seed}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"methods": ("magic",)}, "--methods names magic; allowed are eskin, "),
        ({"train": ()}, "--train names 0 and --test 1; allowed are as many"),
    ],
)
def test_robustness_refuses_bad_arguments(changed, message):
    with pytest.raises(ValueError, match=message):
        robustness.Command(**{"train": ("a",), "test": ("a",), **changed})
