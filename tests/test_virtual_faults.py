"""Every fault does what it says, counts what it did, and is the same every time."""

import time
from collections import Counter

import numpy as np
import pytest
import serial

from eskin.drivers import Data, Deframer, Hello, HostClock, ManualClock, decode_packet
from eskin.drivers.virtual import FAULT_KINDS, PtyPort, VirtualSkin, parse_fault
from eskin.errors import PacketError
from helpers.devices import (
    PATIENCE,
    RATE,
    Listener,
    heard_with,
    opened,
    playing,
    scans_of,
    small_skin,
)


def counts_of(packets, address):
    """Rows of counts that one patch sent."""
    data = (decode_packet(packet) for packet in packets)
    own = [p.counts for p in data if isinstance(p, Data) and p.address == address]
    return np.array(own, dtype=np.int64)


def times_of(packets, address=1):
    """Device times of data packets of one patch [us]."""
    data = (decode_packet(packet) for packet in packets)
    own = [p for p in data if isinstance(p, Data) and p.address == address]
    return np.array([packet.device_time for packet in own])


def numbers_of(packets, address=1):
    """Scan numbers of data packets of one patch."""
    data = (decode_packet(packet) for packet in packets)
    own = [p for p in data if isinstance(p, Data) and p.address == address]
    return np.array([packet.scan for packet in own])


def struck(device):
    """How often the only fault has struck, and how many data packets."""
    [found] = device.counters()["faults"]
    return found["count"], found.get("data")


@pytest.mark.parametrize("kind", sorted(FAULT_KINDS))
def test_a_fault_is_the_same_every_time_and_another_for_another_seed(kind):
    where = ":left,right" if FAULT_KINDS[kind].needs_pair else ""
    once, first = heard_with(kind + where, framed=True)
    again, second = heard_with(kind + where, framed=True)
    assert once == again
    assert first.counters() == second.counters()
    assert struck(first)[0] > 0


@pytest.mark.parametrize("kind", sorted(FAULT_KINDS))
def test_a_fault_that_is_yet_to_come_changes_nothing(kind):
    where = ":left,right" if FAULT_KINDS[kind].needs_pair else ""
    without, _ = heard_with(framed=True)
    heard, device = heard_with(f"{kind}{where}@1000", framed=True)
    assert heard == without
    assert struck(device)[0] == 0


def test_lost_packets_are_missing_and_the_others_are_whole():
    whole, _ = heard_with()
    heard, device = heard_with("lose=0.3")
    count, data = struck(device)
    assert len(heard) == len(whole) - count
    assert set(heard) <= set(whole)
    kinds = Counter(type(decode_packet(packet)) for packet in heard)
    assert kinds[Data] == 300 - data


def test_corrupt_packets_fail_their_crc_and_no_others():
    whole, _ = heard_with()
    heard, device = heard_with("corrupt=0.3")
    assert len(heard) == len(whole)
    wrong = 0
    for packet, true in zip(heard, whole, strict=True):
        if packet != true:
            wrong += 1
            with pytest.raises(PacketError):
                decode_packet(packet)
    assert wrong == struck(device)[0] > 50


def test_truncated_packets_are_beginnings_that_are_refused():
    whole, _ = heard_with()
    heard, device = heard_with("truncate=0.3")
    cut = [(p, w) for p, w in zip(heard, whole, strict=True) if p != w]
    assert len(cut) == struck(device)[0] > 50
    for packet, true in cut:
        assert true.startswith(packet)
        with pytest.raises(PacketError):
            decode_packet(packet)


def test_doubled_packets_come_twice():
    whole, _ = heard_with()
    heard, device = heard_with("duplicate=0.3")
    times = Counter(Counter(heard).values())
    assert times == {1: len(whole) - struck(device)[0], 2: struck(device)[0]}


def test_packets_out_of_order_are_all_there_and_late_by_one_of_their_patch():
    whole, _ = heard_with()
    heard, device = heard_with("reorder=0.3")
    assert sorted(heard) == sorted(whole)
    late = 0
    for address in (1, 2, 3):
        order = [p for p in heard if decode_packet(p).address == address]
        wanted = [p for p in whole if decode_packet(p).address == address]
        places = [wanted.index(packet) for packet in order]
        late += sum(a > b for a, b in zip(places, places[1:], strict=False))
        assert max(abs(a - b) for a, b in enumerate(places)) == 1
    count, _ = struck(device)
    assert count - 3 <= late <= count


def test_what_is_held_back_is_let_go_at_the_end():
    whole, _ = heard_with(count=101)
    heard, _ = heard_with("reorder=1", count=101)
    assert sorted(heard) == sorted(whole)


def test_delayed_packets_keep_their_order_and_none_is_kept_at_the_end():
    whole, _ = heard_with()
    heard, device = heard_with("delay:left=0.1")
    assert sorted(heard) == sorted(whole)
    assert struck(device) == (104, 100)
    first = next(i for i, p in enumerate(heard) if decode_packet(p).address == 1)
    # Five scans of the two others, with hello and status in the first.
    assert first == 2 * (2 + 5)
    left = [p for p in heard if decode_packet(p).address == 1]
    assert left == [p for p in whole if decode_packet(p).address == 1]


def test_a_stall_loses_all_while_clocks_and_numbers_go_on():
    heard, device = heard_with("stall@0.5-1.5")
    assert struck(device)[1] == 150
    numbers = np.diff(numbers_of(heard))
    assert sorted(set(numbers.tolist())) == [1, 51]
    assert np.diff(times_of(heard)).max() == pytest.approx(1_020_000, abs=200)


def test_an_unplugged_patch_is_silent_and_then_begins_anew():
    heard, device = heard_with("unplug:middle@0.5-1.5")
    assert struck(device)[0] == 1
    times = times_of(heard, 2)
    assert len(times) == 50
    assert times[25] == 0
    assert numbers_of(heard, 2)[25] == 0
    assert len(times_of(heard, 1)) == 100
    packets = [p for p in map(decode_packet, heard) if p.address == 2]
    hellos = [p for p in packets if isinstance(p, Hello)]
    assert [hello.device_time for hello in hellos][1] == 0
    assert len({hello.serial_number for hello in hellos}) == 1


def test_a_replaced_patch_has_another_serial_number_and_the_rest_does_not():
    heard, device = heard_with("replace:middle@0.5=0.3", count=120)
    assert struck(device)[0] == 1
    hellos = [p for p in map(decode_packet, heard) if isinstance(p, Hello)]
    serials = {a: {h.serial_number for h in hellos if h.address == a} for a in (1, 2)}
    assert len(serials[1]) == 1
    assert len(serials[2]) == 2
    assert len(times_of(heard, 2)) == 120 - 15


def test_the_first_patch_is_replaced_by_another_whatever_the_seed():
    for seed in range(3):
        fault = parse_fault("replace:left@0.1=0.1", small_skin(), seed)
        device = VirtualSkin(small_skin(), [Listener()], RATE, [fault], seed)
        before = device.patches[0].serial_number
        device.play(scans_of(small_skin(), 20), ManualClock())
        assert device.patches[0].serial_number != before


def test_a_reboot_begins_clock_and_numbers_anew_in_the_same_module():
    heard, device = heard_with("reboot:left@1")
    assert struck(device)[0] == 1
    times, numbers = times_of(heard), numbers_of(heard)
    assert len(times) == 100 - 10
    assert (times[50], numbers[50]) == (0, 0)
    hellos = [p for p in map(decode_packet, heard) if isinstance(p, Hello)]
    assert len({hello.serial_number for hello in hellos}) == 3


@pytest.mark.parametrize("seconds", [5.0, -5.0])
def test_a_clock_jumps_once_by_as_much_as_was_asked(seconds):
    heard, device = heard_with(f"clock_jump:left@1={seconds}")
    assert struck(device)[0] == 1
    # Modulo 2**32: a young clock that is set back wraps.
    steps = np.diff(times_of(heard).astype(np.uint32)).astype(np.int32) - 20_000
    assert np.flatnonzero(np.abs(steps) > 10).tolist() == [49]
    assert steps[49] == pytest.approx(1e6 * seconds, abs=10)
    assert (np.diff(numbers_of(heard)) == 1).all()


def test_clocks_and_numbers_wrap_when_asked():
    heard, _ = heard_with("wrap:left=1")
    # The crystal decides whether the clock is a scan late.
    assert np.flatnonzero(np.diff(times_of(heard)) < 0) in (49, 50)
    assert np.flatnonzero(np.diff(numbers_of(heard)) < 0).tolist() == [49]
    heard, _ = heard_with("wrap:left@0.5=1")
    assert np.flatnonzero(np.diff(times_of(heard)) < 0)[-1] in (74, 75)


def test_strange_packets_are_whole_and_of_no_patch():
    whole, _ = heard_with()
    heard, device = heard_with("wrong_patch=0.3")
    strange = [p for p in map(decode_packet, heard) if p.address not in (1, 2, 3)]
    assert len(strange) == struck(device)[0] == len(heard) - len(whole) > 50


def test_two_modules_at_one_address_both_speak_under_it():
    heard, device = heard_with("same_address:left,right")
    assert struck(device)[0] == 2
    packets = list(map(decode_packet, heard))
    assert {packet.address for packet in packets} == {1, 2}
    hellos = [p for p in packets if isinstance(p, Hello) and p.address == 1]
    assert len({hello.serial_number for hello in hellos}) == 2
    assert len(times_of(heard, 1)) == 200


def test_swapped_patches_answer_for_each_other():
    whole, _ = heard_with()
    heard, _ = heard_with("swap:left,right")
    np.testing.assert_array_equal(counts_of(heard, 1), counts_of(whole, 3))
    np.testing.assert_array_equal(counts_of(heard, 3), counts_of(whole, 1))
    np.testing.assert_array_equal(counts_of(heard, 2), counts_of(whole, 2))


@pytest.mark.parametrize(
    ("where", "places"),
    [("middle/r1c0", [2]), ("middle/r1", [2, 3]), ("middle/c1", [1, 3, 5, 7, 9])],
)
@pytest.mark.parametrize("kind", ["noisy", "stuck=1234", "dead"])
def test_taxels_measure_wrong_where_and_while_asked(kind, where, places):
    name, _, amount = kind.partition("=")
    text = f"{name}:{where}@0.5-1.5" + (f"={amount}" if amount else "")
    whole = counts_of(heard_with()[0], 2)
    heard, device = heard_with(text)
    found = counts_of(heard, 2)
    wrong = np.flatnonzero((found != whole).any(axis=0)).tolist()
    assert wrong == places
    assert np.flatnonzero((found != whole).any(axis=1)).tolist() == list(range(25, 75))
    assert struck(device)[0] == 50 * len(places)
    spoiled = found[25:75][:, places]
    if name == "stuck":
        assert (spoiled == 1234).all()
    elif name == "dead":
        assert (spoiled == 0).all()
    else:
        assert 100 < (spoiled - whole[25:75][:, places]).std() < 300


def test_what_was_felt_stays_as_it_was_though_taxels_are_dead():
    felt = list(scans_of(small_skin(), 3))
    heard_with("dead", scans=felt)
    for scan, true in zip(felt, scans_of(small_skin(), 3), strict=True):
        np.testing.assert_array_equal(scan.counts, true.counts)


def test_garbage_comes_between_packets_that_stay_whole():
    whole, _ = heard_with(framed=True)
    heard, device = heard_with("garbage=20000", framed=True)
    assert set(whole) <= set(heard)
    extra = len(b"".join(heard)) - len(b"".join(whole))
    assert extra == struck(device)[0]
    assert extra == pytest.approx(20_000 * 99 / RATE, rel=0.05)


def test_flipped_bits_are_as_many_as_are_counted():
    whole, _ = heard_with(framed=True)
    heard, device = heard_with("flip=0.01", framed=True)
    one, other = (np.frombuffer(b"".join(x), np.uint8) for x in (whole, heard))
    wrong = int(np.unpackbits(one ^ other).sum())
    assert wrong == struck(device)[0]
    assert wrong == pytest.approx(0.01 * 8 * len(one), rel=0.2)


def test_faults_pile_up_and_each_counts_its_own():
    whole, _ = heard_with()
    heard, device = heard_with("lose=0.2", "duplicate=0.2", "corrupt=0.2")
    lost, doubled, broken = (fault.count for fault in device.faults)
    assert len(heard) == len(whole) - lost + doubled
    assert sum(packet not in set(whole) for packet in heard) == broken


def test_a_port_vanishes_with_its_last_patch_and_comes_back_under_its_name(tmp_path):
    skin = small_skin()
    port = PtyPort(tmp_path / "port")
    faults = [parse_fault("unplug@0.3-0.5", skin)]
    device = VirtualSkin(skin, [port], RATE, faults)
    endless = (scan for _ in iter(int, 1) for scan in scans_of(skin, 50))
    with playing(device, endless, HostClock()):
        with pytest.raises(serial.SerialException), opened(port) as line:
            for _ in range(20_000):
                line.read(1)
        deframer, found = Deframer(), []
        until = time.monotonic() + PATIENCE
        while not found and time.monotonic() < until:
            try:
                with opened(port) as line:
                    found = deframer.push(line.read(2000))
            except serial.SerialException:
                continue
    assert {decode_packet(packet).address for packet in found} == {1, 2, 3}


def test_unplugging_fifty_times_brings_fifty_beginnings():
    faults = [f"unplug:left@{0.1 * i:.1f}-{0.1 * i + 0.06:.2f}" for i in range(1, 51)]
    heard, device = heard_with(*faults, count=300)
    assert [fault.count for fault in device.faults] == [1] * 50
    assert (times_of(heard) == 0).sum() == 50


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "cannot be read"),
        ("lose=", "cannot be read"),
        ("lose@-1", "cannot be read"),
        ("lose=nan", "cannot be read"),
        ("explode", "is of no known kind; allowed are unplug, replace"),
        ("lose:nose", "allowed are PATCH, .* with a patch of left, middle, right"),
        ("dead:left/x", "allowed are PATCH"),
        ("dead:left/r7", "has no taxel; allowed are rows 0 to 2 and columns 0 to 3"),
        ("lose:left,right", "names 2 patches; allowed is 1"),
        ("swap", "names 0 patches; allowed are 2"),
        ("swap:left", "names 1 patches; allowed are 2"),
        ("swap:left,left", "names one patch twice"),
        ("reboot@1-2", "happens at an instant"),
        ("unplug@5-3", "ends at 3 s, not after its start"),
        ("stall=3", "takes no amount"),
        ("lose=1.5", "has the amount 1.5; allowed are 0 to 1"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_in_one_line(text, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        parse_fault(text, small_skin())
    assert "\n" not in str(caught.value)


def test_a_manual_clock_needs_no_time():
    clock = ManualClock()
    device = VirtualSkin(small_skin(), [PtyPort()], RATE)
    with device:
        device.play(scans_of(small_skin(), 100), clock)
    assert clock.now() >= 1_980_000_000
