"""`eskin bench latency` on a few steps: what it says, not how fast it was."""

import json
import os

import numpy as np
import pytest

from eskin.live import Recognizer, load_model
from eskin.sim.bench import BenchScene, large_skin
from eskin.sim.bench.latency import TimedMethod, pin_to_one_core, time_in_turn
from eskin.sim.bench.scene import find_forearm_band, find_forearm_taxels
from eskin.skin import MountedSkin, check_skin
from helpers.cli import call
from helpers.live import mounted

pytestmark = pytest.mark.slow

UR5 = mounted("ur5")
KEYS = {"name", "p50_ms", "p99_ms", "max_ms", "taxels", "active", "steps", "ratio"}


@pytest.mark.parametrize("taxels", [2112, 4000])
def test_a_row_for_every_scene(taxels, monkeypatch, capsys):
    monkeypatch.setattr("eskin.sim.bench.latency.WARM_UP", 10)
    asked = "--steps", 10, "--active", 60, "--taxels", taxels, "--json"
    code, out, err = call(capsys, "bench", "latency", *asked)
    assert (code, err) == (0, "")
    rows = json.loads(out.splitlines()[-1])["rows"]
    assert [(row["name"], row["active"]) for row in rows] == [
        ("eskin", 60),
        ("eskin", 0),
        ("eskin", 20),
        ("eskin, grab", 83),
        ("eskin, two touches", 120),
        ("eskin, from counts", 60),
        ("eskin, from counts", 0),
    ]
    for row in rows:
        assert set(row) == KEYS and row["name"] in out
        assert (row["taxels"], row["steps"]) == (taxels, 10)
        assert 0 < row["p50_ms"] <= row["p99_ms"] <= row["max_ms"]
        want = row["p50_ms"] / rows[0]["p50_ms"]
        assert row["ratio"] == pytest.approx(want, rel=0.05)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("--steps", 9), "--steps is 9; allowed are 10 and above"),
        (("--active", 0), "--active is 0; allowed are 1 to 326"),
        (("--active", 400), "--active is 400; allowed are 1 to 326"),
        (("--taxels", 100), "--taxels is 100; allowed are 2112, which is the ur5"),
    ],
)
def test_what_cannot_be_timed_is_one_line(argv, message, capsys):
    code, out, err = call(capsys, "bench", "latency", *argv)
    assert (code, out) == (2, "")
    assert message in err and len(err.splitlines()) == 1


def test_a_larger_skin_is_the_arm_as_it_is_with_panels_out_of_its_way():
    small = UR5.skin
    large = large_skin(7001)
    assert large.count == 7001 and large_skin(2112).count == 2112
    for name in ("positions", "normals", "areas", "rows", "patch_index"):
        assert np.array_equal(getattr(large, name)[:2112], getattr(small, name))
    problems = check_skin(large, UR5.robot)
    assert all("off the surface of link 'base_link'" in p.text for p in problems)
    p_world, _ = MountedSkin(large, UR5.robot).place_taxels(np.zeros(6))
    assert p_world[2112:, 0].max() < p_world[:2112, 0].min() - 1


def engine(mounted):
    return Recognizer(load_model("ur5"), mounted, None)


@pytest.mark.parametrize("active", [20, 60])
def test_exactly_the_taxels_asked_for_are_active_on_every_skin(active):
    for skin in (UR5.skin, large_skin(4000)):
        on = MountedSkin(skin, UR5.robot)
        scene = BenchScene(on, find_forearm_taxels(skin, active))
        recognizer = engine(on)
        for instant in scene.next_readings(106):
            recognizer.push(instant.reading)
            found = [contact.taxels for contact in recognizer.state.contacts]
            assert sum(map(len, found)) == active * instant.touched
            assert len(found) == instant.touched


def test_a_grab_goes_round_the_forearm_and_an_idle_skin_is_never_touched():
    taxels = find_forearm_band(UR5.skin, 83)
    normals = UR5.skin.normals[taxels]
    assert len(taxels) == 83 and normals.min() < -0.9 and normals.max() > 0.9
    recognizer = engine(UR5)
    for instant in BenchScene(UR5, taxels[:0]).next_readings(76):
        assert not instant.touched
        assert recognizer.push(instant.reading) == []
        assert recognizer.state.contacts == ()


def test_a_scene_moves_all_joints_and_its_touches_come_and_go():
    scene = BenchScene(UR5, find_forearm_taxels(UR5.skin, 5), rate=100.0)
    instants = scene.next_readings(430)
    stamps = np.array([instant.reading.stamp for instant in instants])
    assert (np.diff(stamps) == 10_000_000).all()
    touched = [instant.touched for instant in instants]
    assert touched == [n % 210 < 150 for n in range(430)]
    q = np.array([instant.reading.q for instant in instants])
    assert (np.ptp(q, axis=0) > 0.1).all()


class Counted(TimedMethod):
    """Says how often it ran, and what came before it."""

    def __init__(self, name, order) -> None:
        super().__init__(name, UR5, BenchScene(UR5, np.arange(1)))
        self.order = order

    def run(self, count):
        self.order.append((self.name, count))
        return [0.001] * count

    def steps(self, wanted):
        return wanted if self.name == "a" else 13


def test_subjects_take_turns_and_each_takes_all_its_steps():
    order = []
    times = time_in_turn([Counted("a", order), Counted("b", order)], 50)
    assert [name for name, _ in order] == ["a", "b"] * 10
    assert [len(found) for found in times] == [50, 13]
    assert times[0].tolist() == [1.0] * 50


def test_pinned_is_one_core_and_only_for_so_long():
    before = os.sched_getaffinity(0)
    with pin_to_one_core():
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before
