"""Tests of the faults of a virtual skin: each does what it says and counts it."""

import time

import numpy as np
import pytest
import serial

from eskin.drivers import Deframer, Hello, HostClock, decode_packet
from eskin.sim.virtual import FAULT_KINDS, PtyPort, VirtualSkin, parse_fault
from helpers.devices import (
    PATIENCE,
    RATE,
    open_line,
    playing,
    scans_of,
    select_data,
    send_scans,
    small_skin,
)

COUNT = 100


@pytest.fixture(scope="module")
def intact():
    """Return the packets of a skin without faults."""
    return send_scans()[0]


def send(*faults, count=COUNT):
    """Return what a skin with faults sends, as bytes and decoded, and its faults."""
    sent, device = send_scans(*faults, count=count)
    return sent, [decode_packet(packet) for packet in sent], device.faults


def get_times(packets, address=1):
    """Return the device times of one patch's data [us]."""
    return np.array([p.device_time for p in select_data(packets, address)])


def get_numbers(packets, address=1):
    return np.array([packet.scan for packet in select_data(packets, address)])


def get_serials(packets, address):
    hellos = [packet for packet in packets if isinstance(packet, Hello)]
    return {hello.serial_number for hello in hellos if hello.address == address}


@pytest.mark.parametrize("kind", sorted(FAULT_KINDS))
def test_fault_is_the_same_every_time_and_starts_in_time(kind):
    text = kind + (":left,right" if FAULT_KINDS[kind].needs_pair else "")
    options = {"framed": True, "count": 60}
    (sent, device), again = (send_scans(text, **options) for _ in range(2))
    assert sent == again[0] and device.counters() == again[1].counters()
    assert device.faults[0].count > 0
    later, device = send_scans(f"{text}@1000", **options)
    assert later == send_scans(**options)[0]
    assert device.faults[0].count == 0


def test_reordered_packets_come_after_the_next_of_their_patch(intact):
    sent, packets, [fault] = send("reorder=0.3")
    assert sorted(sent) == sorted(intact)
    late = 0
    for address in (1, 2, 3):
        own = [a for a, p in zip(sent, packets, strict=True) if p.address == address]
        wanted = [packet for packet in intact if packet in set(own)]
        places = [wanted.index(packet) for packet in own]
        late += sum(a > b for a, b in zip(places, places[1:], strict=False))
        assert max(abs(a - b) for a, b in enumerate(places)) == 1
    assert fault.count - 3 <= late <= fault.count


def test_packets_held_back_are_sent_at_the_end(intact):
    assert sorted(send("reorder=1", count=101)[0]) == sorted(send_scans(count=101)[0])
    sent, packets, [fault] = send("delay:left=0.1")
    assert sorted(sent) == sorted(intact)
    assert (fault.count, fault.data) == (104, 100)
    # Before the first come five scans of the two others, with hellos and statuses.
    assert [packet.address for packet in packets].index(1) == 2 * (2 + 5)
    assert (np.diff(get_numbers(packets)) == 1).all()


def test_clocks_and_numbers_go_on_during_a_stall():
    _, packets, [fault] = send("stall@0.5-1.5")
    assert fault.data == 150
    assert set(np.diff(get_numbers(packets))) == {1, 51}
    steps = np.diff(get_times(packets))
    assert steps.max() == pytest.approx(1_020_000, abs=200)


@pytest.mark.parametrize(
    ("fault", "sent", "modules"),
    [
        ("unplug:middle@0.5-1.5", 50, 1),
        ("reboot:middle@0.5", 90, 1),
        ("replace:middle@0.5=0.3", 85, 2),
    ],
)
def test_module_that_comes_back_begins_anew(fault, sent, modules):
    _, packets, [found] = send(fault)
    times = get_times(packets, 2)
    numbers = get_numbers(packets, 2)
    assert (found.count, len(times)) == (1, sent)
    assert times[25] == numbers[25] == 0
    assert len(get_times(packets)) == COUNT
    assert (len(get_serials(packets, 2)), len(get_serials(packets, 1))) == (modules, 1)


@pytest.mark.parametrize("seconds", [5.0, -5.0])
def test_clock_jumps_once(seconds):
    _, packets, [fault] = send(f"clock_jump:left@1={seconds}")
    assert fault.count == 1
    # Modulo 2**32: a young clock that is set back wraps.
    times = get_times(packets).astype(np.uint32)
    steps = np.diff(times).astype(np.int32) - 20_000
    assert np.flatnonzero(np.abs(steps) > 10).tolist() == [49]
    assert steps[49] == pytest.approx(1e6 * seconds, abs=10)
    assert (np.diff(get_numbers(packets)) == 1).all()


@pytest.mark.parametrize(("text", "at"), [("wrap:left=1", 49), ("wrap:left@0.5=1", 74)])
def test_clocks_and_numbers_wrap_in_time(text, at):
    _, packets, _ = send(text)
    # The crystal decides whether the clock is a scan late.
    assert np.flatnonzero(np.diff(get_times(packets)) < 0)[-1] in (at, at + 1)
    assert np.flatnonzero(np.diff(get_numbers(packets)) < 0)[-1] == at


def test_swapped_patches_have_each_others_address(intact):
    before = list(map(decode_packet, intact))
    after = send("swap:left,right")[1]
    for old, new in ((1, 3), (2, 2), (3, 1)):
        counts = [
            [packet.counts for packet in select_data(packets, address)]
            for packets, address in ((before, old), (after, new))
        ]
        np.testing.assert_array_equal(*counts)


@pytest.mark.parametrize(
    ("where", "places"),
    [("middle/r1c0", [2]), ("middle/r1", [2, 3]), ("middle/c1", [1, 3, 5, 7, 9])],
)
@pytest.mark.parametrize(
    ("kind", "amount"), [("noisy", ""), ("stuck", "=1234"), ("dead", "")]
)
def test_taxels_measure_wrong_where_and_while_asked(kind, amount, where, places):
    scans = list(scans_of(small_skin(), COUNT))
    true = np.array([scan.counts[12:22] for scan in scans])
    sent, device = send_scans(f"{kind}:{where}@0.5-1.5{amount}", scans=scans)
    found = [p.counts for p in select_data(map(decode_packet, sent), 2)]
    wrong = np.array(found, int) - true
    assert np.flatnonzero(wrong.any(axis=0)).tolist() == places
    assert np.flatnonzero(wrong.any(axis=1)).tolist() == list(range(25, 75))
    assert device.faults[0].count == 50 * len(places)
    spoiled = (wrong + true)[25:75][:, places]
    if kind == "noisy":
        assert 100 < wrong[25:75][:, places].std() < 300
    else:
        assert (spoiled == (1234 if kind == "stuck" else 0)).all()
    # What was played is not changed.
    np.testing.assert_array_equal([scan.counts[12:22] for scan in scans], true)


@pytest.mark.slow
def test_port_vanishes_with_its_last_patch_and_comes_back(tmp_path):
    skin = small_skin()
    port = PtyPort(tmp_path / "port")
    faults = [parse_fault("unplug@0.3-0.5", skin)]
    device = VirtualSkin(skin, [port], RATE, faults)
    endless = (scan for _ in iter(int, 1) for scan in scans_of(skin, 50))
    with playing(device, endless, HostClock()):
        with pytest.raises(serial.SerialException), open_line(port) as line:
            for _ in range(20_000):
                line.read(1)
        found = []
        until = time.monotonic() + PATIENCE
        while not found and time.monotonic() < until:
            try:
                with open_line(port) as line:
                    found = Deframer().push_chunk(line.read(2000))
            except serial.SerialException:
                continue
    assert {decode_packet(packet).address for packet in found} == {1, 2, 3}
