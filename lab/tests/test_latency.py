"""Tests of timing beside the engine: baselines, and skins of other sizes."""

import json

import numpy as np
import pytest

from helpers.live import mounted
from lab.latency import draw_random_clips, main
from lab.program import run_program
from lab.scaling import time_sizes

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def short_warm_up(monkeypatch):
    monkeypatch.setattr("eskin.sim.bench.latency.WARM_UP", 10)


def test_a_row_for_every_way_of_a_baseline(capsys):
    words = "--steps 12 --clips 20 --baselines knn-max cnn-lstm --json"
    assert run_program(main, words.split()) == 0
    rows = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert [(row["name"], row["active"]) for row in rows[7:]] == [
        ("knn-max", 60),
        ("cnn-lstm", 60),
        ("cnn-lstm, cached", 60),
    ]
    assert all(0 < row["p50_ms"] <= row["max_ms"] for row in rows)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--clips 3", "--clips is 3; allowed are 20 and above"),
        (
            "--baselines oracle --clips 20",
            "no baseline 'oracle'; allowed are svm-max, knn-max",
        ),
    ],
)
def test_what_cannot_be_timed_is_one_line(words, message, capsys):
    assert run_program(main, words.split()) == 2
    assert message in capsys.readouterr().err


def test_random_clips_have_every_class_and_the_same_seed_gives_the_same():
    (one, labels), (other, _) = (draw_random_clips(mounted("ur5"), 20) for _ in "ab")
    assert np.array_equal(one.pressure, other.pressure)
    assert sorted(set(labels.tolist())) == [0, 1, 2, 3, 4]
    assert (one.pressure.max(axis=(1, 2)) > 2).all()


def test_sizes_are_compared_with_the_first():
    rows = time_sizes([2112, 3000], [20, 20], 10)
    found = [(row.taxels, row.active, row.steps) for row in rows]
    assert found == [(2112, 20, 10), (3000, 20, 10)]
    assert rows[0].ratio == 1.0
