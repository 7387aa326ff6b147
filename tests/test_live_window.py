"""The heads on rings, a reading at a time, against those of torch on whole windows."""

import numpy as np
import pytest
import torch
from benchmarks.live_parts import SequenceWindow
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.live import Network
from eskin.model import SLOT_NS
from eskin.nn import SlotIndex
from helpers.live import model_of, network

SLOTS = (25, 26, 30, 41)
NETS = {slots: network(slots=slots, channels=6, width=4) for slots in SLOTS}


def of_torch(net, numbers, rows):
    """Logits of the window that ends with the last reading."""
    slot = np.array(numbers) - numbers[-1] + net.config.slots - 1
    inside = np.flatnonzero(slot >= 0)
    window = torch.zeros(len(inside), dtype=torch.long)
    places = SlotIndex(window, torch.tensor(slot[inside]), 1)
    with torch.no_grad():
        return net.classify(torch.tensor(rows[inside]), places).mean(dim=0)[0].numpy()


def check(net, stamps, seed):
    """Hold the logits at every stamp to those of torch."""
    live = Network(model_of(net))
    window = SequenceWindow(live.heads, live.slots)
    rows = np.random.default_rng(seed).normal(size=(len(stamps), live.channels))
    rows = 2 * rows.astype(np.float32)
    numbers = [stamp // SLOT_NS for stamp in stamps]
    for n, stamp in enumerate(stamps):
        found = window.push(stamp, rows[n])
        want = of_torch(net, numbers[: n + 1], rows[: n + 1])
        np.testing.assert_allclose(found, want, atol=1e-4)


@settings(deadline=None)
@given(
    slots=st.sampled_from(SLOTS),
    steps=st.lists(
        st.one_of(
            st.integers(1, SLOT_NS // 3),
            st.just(SLOT_NS),
            st.integers(SLOT_NS, 9 * SLOT_NS),
            st.integers(20 * SLOT_NS, 100 * SLOT_NS),
        ),
        min_size=1,
        max_size=60,
    ),
    start=st.integers(0, 10**18),
)
def test_after_any_stamps_the_logits_are_those_of_the_whole_window(slots, steps, start):
    stamps = [start + int(step) for step in np.cumsum(steps)]
    check(NETS[slots], stamps, len(steps))


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("gap", [-1, 0, 1])
def test_an_old_slot_is_not_mistaken_for_a_new_one_after_a_pause(slots, gap):
    pause = slots + gap
    numbers = [*range(40), *range(40 + pause, 60 + pause)]
    check(NETS[slots], [n * SLOT_NS for n in numbers], slots)


def test_logits_given_away_are_not_written_to_again():
    live = Network(model_of(NETS[25]))
    window = SequenceWindow(live.heads, live.slots)
    rows = np.random.default_rng(0).normal(size=(2, live.channels)).astype(np.float32)
    first = window.push(0, rows[0])
    kept = first.copy()
    window.push(SLOT_NS, rows[1])
    assert np.array_equal(first, kept)
