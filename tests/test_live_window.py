"""The ring of slots that the head looks back on."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eskin.live import Window
from eskin.model import SLOT_NS


def naive(stamps, rows, slots):
    """Slots by their definition."""
    now = stamps[-1] // SLOT_NS
    e, present = np.zeros((slots, 2), np.float32), np.zeros(slots, np.float32)
    for slot in range(slots):
        number = now - slots + 1 + slot
        inside = [
            r for s, r in zip(stamps, rows, strict=True) if s // SLOT_NS == number
        ]
        if inside:
            e[slot], present[slot] = np.max(inside, axis=0), 1.0
    return e, present


@given(
    st.lists(st.integers(1, 9 * SLOT_NS), min_size=1, max_size=40),
    st.integers(0, 10**18),
)
def test_a_window_holds_the_maximum_of_each_slot_and_nothing_older(steps, start):
    stamps = [start + int(step) for step in np.cumsum(steps)]
    rows = np.random.default_rng(len(steps)).normal(size=(len(steps), 2))
    rows = rows.astype(np.float32)
    window = Window(6, 2)
    for n, stamp in enumerate(stamps):
        window.push(stamp, rows[n])
        e, present = window.view()
        wanted, there = naive(stamps[: n + 1], rows[: n + 1], 6)
        assert np.array_equal(e, wanted)
        assert np.array_equal(present, there)


def test_an_old_slot_is_not_mistaken_for_a_new_one_after_a_pause():
    window = Window(5, 1)
    window.push(0, np.ones(1, np.float32))
    window.push(5 * SLOT_NS, 2 * np.ones(1, np.float32))
    e, present = window.view()
    assert e[:, 0].tolist() == [0, 0, 0, 0, 2]
    assert present.tolist() == [0, 0, 0, 0, 1]
