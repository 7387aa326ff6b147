"""Tests of the queues of listeners, and of the histogram of durations."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from eskin.drivers import Event
from eskin.stream import BoundedQueue, DurationHistogram, RecognitionState
from eskin.touch import (
    NO_TOUCHES,
    Reading,
    TouchRecord,
    TouchState,
)
from helpers.commands import MOUNTED
from helpers.streams import START, make_scans, same_scans

SCANS = make_scans(200)
READING = Reading(START, np.zeros(1, np.float32), np.ones(1, bool), np.zeros(0))
STATE = RecognitionState(
    TouchState(
        READING,
        (),
        np.zeros(1, bool),
        NO_TOUCHES,
        MOUNTED,
    ),
    {},
    (),
)
EVENT = Event(START, "appeared", "patch 'a' is there")


def adds_up(count):
    return count.given == count.taken + count.dropped + count.waiting


def fill_queue(drop, items):
    """Return what a queue of three keeps of some messages."""
    queue = BoundedQueue(3, drop)
    for item in items:
        queue.put(item)
    assert adds_up(queue.count()) and queue.count().given == len(items)
    queue.end()
    return list(iter(queue.take, None))


@pytest.mark.parametrize("drop", ["oldest", "newest"])
def test_full_queue_drops_scans_before_events(drop):
    a, b, c, d = (Event(START + n, "lost", str(n)) for n in range(4))
    kept = SCANS[7:10] if drop == "oldest" else SCANS[:3]
    assert same_scans(fill_queue(drop, SCANS[:10]), kept)
    assert fill_queue(drop, [*SCANS[:3], a])[-1] == a
    assert fill_queue(drop, [a, *SCANS[:5], b, *SCANS[5:9], c]) == [a, b, c]
    assert fill_queue(drop, [a, b, c, SCANS[0]]) == [a, b, c]
    kept = [b, c, d] if drop == "oldest" else [a, b, c]
    assert fill_queue(drop, [a, b, c, d]) == kept


@pytest.mark.parametrize("size", [1, 3, 7])
@pytest.mark.parametrize("drop", ["oldest", "newest"])
def test_every_closing_is_told_once_and_in_order_whatever_is_dropped(drop, size):
    queue = BoundedQueue(size, drop)
    taken = []
    for number in range(1, 100):
        status = TouchRecord(number, START, START, 0, closed=True)
        closed = (status,) if number % 3 else ()
        tracking = NO_TOUCHES._replace(closed=closed)
        state = replace(STATE, state=replace(STATE.state, tracking=tracking))
        for item in (state, *[EVENT] * (number % 4 == 1)):
            queue.put(item)
        if number % 20 == 0:
            taken += [queue.take() for _ in range(queue.count().waiting)]
    taken += [queue.take() for _ in range(queue.count().waiting)]
    queue.put(STATE)
    taken.append(queue.take())
    states = [item for item in taken if isinstance(item, RecognitionState)]
    told = [status.id for one in states for status in one.state.tracking.closed]
    assert told == [number for number in range(1, 100) if number % 3]
    assert queue.count().dropped > 20 and adds_up(queue.count())


def test_queue_that_never_drops_waits_for_room_until_it_is_closed():
    queue = BoundedQueue(2, "never")
    writer = threading.Thread(target=lambda: [queue.put(s) for s in SCANS])
    writer.start()
    taken = [queue.take() for _ in SCANS[:-3]]
    assert same_scans(taken, SCANS[:-3])
    while queue.count().given < len(SCANS):
        time.sleep(0.001)
    queue.close()
    writer.join(20)
    assert not writer.is_alive() and queue.take() is None
    count = queue.count()
    assert (count.dropped, count.longest, adds_up(count)) == (3, 2, True)


@pytest.mark.parametrize("drop", ["oldest", "newest"])
def test_counts_of_a_queue_add_up_between_threads(drop):
    queue = BoundedQueue(7, drop)
    wrong = []
    items = [*SCANS, EVENT] * 2

    def take():
        while queue.take() is not None:
            if not adds_up(queue.count()):
                wrong.append(queue.count())

    writers = [
        threading.Thread(target=lambda: [queue.put(item) for item in items])
        for _ in range(3)
    ]
    reader = threading.Thread(target=take)
    for thread in (*writers, reader):
        thread.start()
    for thread in writers:
        thread.join()
    queue.end()
    reader.join()
    queue.put(EVENT)
    count = queue.count()
    assert not wrong and adds_up(count)
    assert (count.given, count.waiting) == (3 * len(items) + 1, 0)
    assert count.longest <= 7


def test_queue_without_room_is_refused():
    with pytest.raises(ValueError, match="size 0"):
        BoundedQueue(0, "oldest")


def test_quantiles_of_durations_are_at_most_two_percent_off():
    values = np.exp(np.random.default_rng(5).normal(-7, 2, 20_000))
    durations = DurationHistogram()
    assert durations.quantile(0.5) == 0.0
    for value in values:
        durations.add_duration(float(value))
    for share in (0.01, 0.5, 0.9, 0.99, 1.0):
        true = max(np.quantile(values, share, method="inverted_cdf"), 1e-6)
        assert true * 0.999999 <= durations.quantile(share) <= true * 1.0201
    assert durations.longest == values.max()
    assert durations.count == len(values)


def test_durations_of_any_size_are_counted():
    durations = DurationHistogram()
    for value in (-1.0, 0.0, 1e9):
        durations.add_duration(value)
    assert (durations.count, durations.longest) == (3, 1e9)
    assert durations.quantile(0.5) == 1e-6
