"""Validation by clips: no touch of a held-out clip is trained on."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="no torch; pip install '.[train]'")

from eskin.live import GraphConfig
from helpers.clips import generated
from lab.clip_split import choose, split_clips
from lab.comparison import find_examples

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Ten clips."""
    folder = tmp_path_factory.mktemp("set")
    generated(folder / "a", clips=10)
    return find_examples([folder / "a"], folder / "pack")


def find_starts(examples):
    dataset = examples.dataset(GraphConfig())
    return {int(dataset.stamps[segment.first]) for segment in dataset.segments}


def test_clips_are_trained_on_or_held_out(examples):
    train, held = split_clips(examples)
    assert len(train.clips) == 8 and len(held.clips) == 2
    assert {*train.clips} | {*held.clips} == {*examples.clips}
    assert find_starts(train) | find_starts(held) == find_starts(examples)
    assert not find_starts(train) & find_starts(held)


def test_windows_and_segments_are_those_of_the_chosen_clips(examples):
    kept = np.arange(len(examples.clips)) % 3 == 1
    chosen = choose(examples, kept)
    whole = examples.windows
    np.testing.assert_array_equal(chosen.windows.pressure, whole.pressure[kept])
    np.testing.assert_array_equal(chosen.windows.q, whole.q[kept])
    spans = [(clip.start, clip.end + 4_000_000_000) for _, clip in chosen.clips]
    for start in find_starts(chosen):
        assert any(low <= start < high for low, high in spans)
    assert len(chosen.people) == kept.sum()
