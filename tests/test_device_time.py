import numpy as np
import pytest

from eskin.drivers.clock_sync import ClockOffsetEstimator, DeviceClock, ScanNumberWindow
from helpers.modules import MS
from helpers.touch import SECOND, START


def heard(true, delays=0.001, start=0, drift=0.0, clock=None, first=0):
    """Moments of scans truly taken at some times [s], heard after delays [s]."""
    clock = clock or DeviceClock()
    true = np.asarray(true)
    arrived = START + np.rint((true + delays) * SECOND).astype(np.int64)
    moments = [
        clock.push(
            (start + round(t * (1 + drift) * 1e6)) % 2**32,
            (first + n) % 2**16,
            int(arrived[n]),
        )
        for n, t in enumerate(true)
    ]
    return clock, moments


def errors(moments, true):
    """How far believed stamps are from the truth [s], and which there are."""
    known = [n for n, moment in enumerate(moments) if moment is not None]
    stamps = np.array([moments[n].stamp for n in known]) - START
    return stamps / SECOND - np.asarray(true)[known], known


def test_a_clock_is_believed_when_it_was_heard_for_a_tenth_of_a_second():
    _, moments = heard(np.arange(50) / 50)
    assert [moment is None for moment in moments] == [True] * 6 + [False] * 44


def test_stamps_go_on_through_the_wraps_of_clock_and_scan_number():
    true = np.arange(7_000) / 1000
    clock, moments = heard(true, start=2**32 - 5_000_000, first=2**16 - 3000)
    off, known = errors(moments, true)
    assert clock.reboots == 0 and len(known) == len(true) - 101
    np.testing.assert_allclose(off, 0.001, atol=1e-6)
    assert (np.diff([moments[n].number for n in known]) == 1).all()


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_the_drift_of_a_crystal_is_followed(drift):
    rng = np.random.default_rng(0)
    true = np.arange(0, 300, 0.05)
    delays = 0.001 + rng.exponential(0.003, len(true))
    clock, moments = heard(true, delays, drift=drift)
    off, _ = errors(moments, true)
    assert off.min() > 0 and off[2000:].max() < 0.003
    assert clock.drift == pytest.approx(-drift, abs=5e-5)


def test_a_clock_without_a_crystal_is_followed():
    true = np.arange(0, 120, 0.02)
    _, moments = heard(true, drift=-0.005)
    off, _ = errors(moments, true)
    assert np.abs(off[2000:]).max() < 0.005


@pytest.mark.parametrize("stall", [0.3, 5.0, 30.0])
def test_a_burst_after_a_stall_keeps_its_true_spacing(stall):
    true = np.arange(0, 60, 0.02)
    delays = np.where((true > 20) & (true < 20 + stall), 20 + stall - true, 0) + 0.001
    _, moments = heard(true, delays)
    off, _ = errors(moments, true)
    np.testing.assert_allclose(off, 0.001, atol=0.0005)


def test_stamps_are_never_later_than_arrivals():
    rng = np.random.default_rng(1)
    true = np.arange(0, 100, 0.01)
    delays = rng.exponential(0.02, len(true))
    line = ClockOffsetEstimator(0, START)
    for t, delay in zip(true, delays, strict=True):
        arrived = START + round((t + delay) * SECOND)
        assert line.push(round(t * 1e6), arrived) <= arrived


def test_what_lay_in_a_buffer_before_the_first_packet_is_not_taken_for_new():
    true = np.arange(0, 10, 0.02)
    delays = np.where(true < 2, 2 - true, 0) + 0.001
    _, moments = heard(true, delays)
    off, _ = errors(moments, true)
    assert off[150:].max() < 0.0015


def test_a_reboot_is_believed_when_the_new_clock_was_heard_for_a_while():
    clock, _ = heard(np.arange(0, 10, 0.02))
    epoch = clock.epoch
    _, moments = heard_later(clock, 10.0)
    assert clock.reboots == 1 and clock.epoch is not epoch
    known = [moment for moment in moments if moment is not None]
    assert len(moments) - len(known) == 6
    assert known[0].number == 500
    assert known[0].stamp == pytest.approx(START + 10.12 * SECOND, abs=2 * MS)


def heard_later(clock, at, scan=0, device=0):
    """A second of scans of a clock that begins at some time [s]."""
    arrived = [START + round((at + n / 50) * SECOND) + MS for n in range(50)]
    moments = [
        clock.push(device + n * 20_000, scan + n, when)
        for n, when in enumerate(arrived)
    ]
    return clock, moments


def test_scan_numbers_that_begin_anew_are_a_reboot():
    clock, _ = heard(np.arange(0, 10, 0.02), first=1000)
    heard_later(clock, 10.0, scan=0, device=10_000_000)
    assert clock.reboots == 1


def test_a_packet_that_was_delayed_for_long_is_no_reboot_and_never_new():
    true = np.arange(0, 10, 0.02)
    clock, _ = heard(true)
    for n in range(100):
        when = START + 10 * SECOND + n * 20 * MS
        old = clock.push(5_000_000 + n * 20_000, 250 + n, when)
        new = clock.push(10_000_000 + n * 20_000, 500 + n, when + MS)
        assert old is None and new is not None
    assert clock.reboots == 0


def test_reordered_packets_keep_their_own_times():
    true = np.arange(0, 5, 0.01)
    order = np.arange(len(true)).reshape(-1, 2)[:, ::-1].ravel()
    clock = DeviceClock()
    for place, n in enumerate(order):
        arrived = START + round(true[place] * SECOND) + 30 * MS
        moment = clock.push(round(true[n] * 1e6), int(n), arrived)
        if moment is not None and place > 200:
            expected = START + round(true[n] * SECOND) + 20 * MS
            assert abs(moment.stamp - expected) < 2 * MS
    assert clock.reboots == 0


@pytest.mark.parametrize("hours", [0.5, 1.2, 3.0])
def test_after_any_silence_time_is_right_again(hours):
    clock, _ = heard(np.arange(0, 10, 0.02))
    at = hours * 3600
    device = round(at * 1e6) % 2**32
    _, moments = heard_later(clock, at, scan=7, device=device)
    last = moments[-1]
    assert last is not None
    assert last.stamp == pytest.approx(START + (at + 0.98) * SECOND, abs=3 * MS)


def test_a_silence_in_which_scan_numbers_go_more_than_half_round_is_no_step_back():
    clock, moments = heard(np.arange(0, 1, 0.001))
    later = clock.push(41_000_000, 41_000, START + 41 * SECOND)
    assert later.number == 41_000 and later.number > moments[-1].number


def test_scan_numbers_are_new_once_and_lost_when_never_heard():
    rng = np.random.default_rng(2)
    sent = np.arange(5000)
    kept = sent[rng.random(5000) > 0.1]
    kept[0], kept[-1] = 0, 4999
    heard_order = kept[np.argsort(kept + rng.uniform(0, 8, len(kept)))]
    numbers = ScanNumberWindow()
    first = numbers.add(int(heard_order[0]))
    novelties = [first] + [numbers.add(int(n)) for n in heard_order[1:]]
    early = int(sum(heard_order < heard_order[0]))
    assert novelties.count("new") == len(kept) - early
    lowest, highest = int(heard_order[0]), int(kept.max())
    distinct = len([n for n in kept if n >= lowest])
    assert numbers.lost == highest - lowest + 1 - distinct
    assert numbers.add(int(kept.max())) == "again"
    assert numbers.add(3) == "old"


@pytest.mark.parametrize("gap", [1, 2, 63, 64, 65, 1000])
def test_a_gap_of_any_length_is_lost_exactly(gap):
    numbers = ScanNumberWindow()
    for n in range(100):
        numbers.add(n)
    numbers.add(99 + gap)
    assert numbers.lost == gap - 1
