"""Tests of virtual patches: they send what is played, byte for byte, on real ports."""

import itertools
import os
import select
import threading

import numpy as np
import pytest

from eskin.drivers import (
    Data,
    Deframer,
    Hello,
    HostClock,
    ManualClock,
    Status,
    decode_packet,
)
from eskin.errors import DeviceError
from eskin.sim.virtual import PtyPort, UdpPort, VirtualSkin, resample_scans
from eskin.skin import build_grid_skin, load_skin
from helpers.devices import (
    RATE,
    MemoryPort,
    open_line,
    read_packets,
    scans_of,
    send_scans,
    small_skin,
)

SECOND = 1_000_000_000
SKIN = small_skin()


def rebuild_counts(skin, packets):
    """Return the counts of each scan, put together from data packets."""
    taxels = {patch.address: skin.find_taxels(patch.id) for patch in skin.patches}
    rows = {address: {} for address in taxels}
    for packet in packets:
        if isinstance(packet, Data):
            scans = rows[packet.address]
            row = scans.setdefault(packet.scan, np.full(skin.count, -1))
            part = taxels[packet.address][packet.first :][: len(packet.counts)]
            row[part] = packet.counts
    scans = [list(scans.values()) for scans in rows.values()]
    return [np.max(each, axis=0) for each in zip(*scans, strict=True)]


def check_counts(skin, packets, count):
    """Check that packets hold exactly the counts of some scans."""
    wanted = [scan.counts for scan in scans_of(skin, count)]
    np.testing.assert_array_equal(rebuild_counts(skin, packets), wanted)


def mix_taxels(skin):
    """Return the same skin with its taxels in a random order."""
    order = np.random.default_rng(1).permutation(skin.count)
    names = "patch_index rows columns positions normals areas tangents".split()
    arrays = [getattr(skin, name)[order] for name in names]
    return skin.__class__(skin.name, skin.patches, *arrays)


@pytest.mark.parametrize(
    "skin", [SKIN, mix_taxels(SKIN), build_grid_skin(40, 50), load_skin("ur5")]
)
def test_packets_hold_the_counts_of_the_scan(skin):
    sent, device = send_scans(skin=skin, count=7)
    assert max(len(packet) for packet in sent) <= 1400
    check_counts(skin, map(decode_packet, sent), 7)
    assert device.counters()["packets"] == len(sent)
    assert device.counters()["bytes"] == sum(len(packet) for packet in sent)


def test_taxels_that_were_not_received_are_not_sent():
    received = np.ones(SKIN.count, dtype=bool)
    received[[2, 3, 7]] = False
    received[SKIN.find_taxels("right")] = False
    sent, _ = send_scans(scans=scans_of(SKIN, 4, received=received))
    found = np.zeros(SKIN.count, dtype=bool)
    for packet in map(decode_packet, sent):
        if isinstance(packet, Data):
            taxels = SKIN.find_taxels(SKIN.patches[packet.address - 1].id)
            found[taxels[packet.first :][: len(packet.counts)]] = True
    np.testing.assert_array_equal(found, received)


def test_every_patch_sends_hello_and_status_first_and_once_a_second():
    packets = [decode_packet(packet) for packet in send_scans(count=101)[0]]
    for patch in SKIN.patches:
        own = [packet for packet in packets if packet.address == patch.address]
        assert isinstance(own[0], Hello) and isinstance(own[1], Status)
        hellos = [packet for packet in own if isinstance(packet, Hello)]
        assert len(hellos) == 3
        assert len({hello.serial_number for hello in hellos}) == 1
        size = (hellos[0].rows, hellos[0].columns, hellos[0].taxels, hellos[0].rate)
        taxels = len(SKIN.find_taxels(patch.id))
        assert size == (patch.rows, patch.columns, taxels, RATE)


def test_scans_are_repeated_at_a_higher_rate_and_left_out_at_a_lower():
    scans = list(scans_of(SKIN, 50))
    stamps = [scan.stamp for scan in scans]
    for rate, expected in (
        (4 * RATE, [stamp for stamp in stamps[:-1] for _ in range(4)] + stamps[-1:]),
        (RATE, stamps),
        (RATE / 5, [*stamps[::5], stamps[-1]]),
    ):
        assert [scan.stamp for scan in resample_scans(scans, rate)] == expected
    assert list(resample_scans([], RATE)) == []


def test_scans_are_paced_by_the_clock():
    device = VirtualSkin(SKIN, [MemoryPort()], rate=200.0)
    clock = HostClock()
    start = clock.now()
    device.play(itertools.cycle(scans_of(SKIN, 5)), clock, seconds=0.2)
    assert device.scans == 40
    assert clock.now() - start >= 0.19 * SECOND
    clock = ManualClock()
    device.play(scans_of(SKIN, 20), clock)
    assert clock.now() >= 95_000_000


def test_packets_to_a_closed_port_are_counted_as_undelivered():
    with VirtualSkin(SKIN, [PtyPort()], RATE) as device:
        device.play(scans_of(SKIN, 50), ManualClock())
    counters = device.counters()
    assert (counters["unheard"], counters["bytes"]) == (counters["packets"], 0)


@pytest.mark.slow
def test_line_that_is_not_read_loses_whole_packets_only():
    device = VirtualSkin(SKIN, [PtyPort(timeout=0.0)], RATE)
    with device, open_line(device.ports[0]) as line:
        device.play(scans_of(SKIN, 500), ManualClock())
        lost = device.counters()["unheard"]
        assert lost > 0
        line.timeout = 0.2
        data = b"".join(iter(lambda: line.read(65536), b""))
        # What had begun is finished once there is room.
        device.send(next(iter(scans_of(SKIN, 1))))
        data += b"".join(iter(lambda: line.read(65536), b""))
    deframer = Deframer()
    packets = [decode_packet(packet) for packet in deframer.push_chunk(data)]
    assert deframer.broken == 0
    assert len(packets) == device.packets - lost
    counters = device.counters()
    assert (counters["unheard"], counters["bytes"]) == (lost, len(data))
    assert [packet.address for packet in packets[-3:]] == [3, 3, 3]


def test_port_is_raw_to_whoever_opens_it():
    with PtyPort() as port:
        line = os.open(port.uri.removeprefix("serial:"), os.O_RDONLY | os.O_NOCTTY)
        try:
            port.send([bytes(range(256))])
            assert select.select([line], [], [], 1.0)[0]
            assert os.read(line, 1000) == bytes(range(256))
        finally:
            os.close(line)


def test_late_reader_gets_the_end_of_what_was_sent():
    device = VirtualSkin(SKIN, [PtyPort()], RATE)

    def play():
        with device:
            device.play(scans_of(SKIN, 3), ManualClock())

    with open_line(device.ports[0]) as line:
        thread = threading.Thread(target=play)
        thread.start()
        # It does not close the port before all was read.
        thread.join(0.1)
        assert thread.is_alive()
        check_counts(SKIN, read_packets(line, 3 * (3 + 2)), 3)
        thread.join()


def test_port_keeps_its_name_while_it_is_plugged_in(tmp_path):
    link = tmp_path / "port"
    port = PtyPort(link)
    assert port.uri == f"serial:{link}"
    port.unplug()
    assert not link.is_symlink()
    port.plug()
    with open_line(port) as line:
        port.send([b"abc\0"])
        assert line.read(4) == b"abc\0"
    port.close()
    port.close()
    assert not link.is_symlink()


def test_name_of_a_port_that_cannot_be_made_is_refused(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    for path in (taken, tmp_path / "nowhere" / "port"):
        with pytest.raises(DeviceError, match=path.name):
            PtyPort(path)
    assert taken.read_text() == "mine"


def test_udp_port_names_its_ipv6_address():
    with UdpPort("::1", 9750) as port:
        assert port.uri == "udp://[::1]:9750"
