"""Virtual patches say what was felt, byte for byte, on real transports."""

import itertools
import os
import select
import threading
import time

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
from eskin.drivers.packet import MAX_PACKET_BYTES
from eskin.drivers.virtual import (
    PtyPort,
    UdpPort,
    VirtualPatch,
    VirtualSkin,
    resample_scans,
)
from eskin.errors import DeviceError
from eskin.skin import build_grid_skin, load_skin
from eskin.touch import Scan
from helpers.devices import (
    RATE,
    Listener,
    heard_with,
    listening,
    opened,
    playing,
    pty_skin,
    read_packets,
    scans_of,
    small_skin,
    udp_skin,
)

SECOND = 1_000_000_000


def rebuilt(skin, packets):
    """Counts of each scan, put together from data packets by address."""
    taxels = {patch.address: skin.find_taxels(patch.id) for patch in skin.patches}
    numbers = {address: [] for address in taxels}
    rows = {address: [] for address in taxels}
    for packet in packets:
        if isinstance(packet, Data):
            if packet.scan not in numbers[packet.address][-1:]:
                numbers[packet.address].append(packet.scan)
                rows[packet.address].append(np.full(skin.count, -1))
            part = taxels[packet.address][packet.first :][: len(packet.counts)]
            rows[packet.address][-1][part] = packet.counts
    return [np.max(each, axis=0) for each in zip(*rows.values(), strict=True)]


@pytest.mark.parametrize(
    "skin", [small_skin(), build_grid_skin(40, 50), load_skin("ur5")]
)
def test_packets_decode_to_exactly_the_counts_of_the_scan(skin):
    packets, device = heard_with(skin=skin, count=7)
    assert max(len(packet) for packet in packets) <= MAX_PACKET_BYTES
    found = rebuilt(skin, [decode_packet(packet) for packet in packets])
    wanted = [scan.counts for scan in scans_of(skin, 7)]
    np.testing.assert_array_equal(found, wanted)
    assert device.counters()["packets"] == len(packets)
    assert device.counters()["bytes"] == sum(len(packet) for packet in packets)


def test_taxels_that_lie_apart_are_sent_all_the_same():
    skin = small_skin()
    order = np.random.default_rng(1).permutation(skin.count)
    mixed = skin.__class__(
        skin.name,
        skin.patches,
        *(getattr(skin, name)[order] for name in ("patch_index", "rows", "columns")),
        *(getattr(skin, name)[order] for name in ("positions", "normals", "areas")),
        skin.tangents[order],
    )
    packets, _ = heard_with(skin=mixed, count=3)
    found = rebuilt(mixed, [decode_packet(packet) for packet in packets])
    np.testing.assert_array_equal(found, [s.counts for s in scans_of(mixed, 3)])


def test_what_was_not_received_is_not_sent():
    skin = small_skin()
    received = np.ones(skin.count, dtype=bool)
    received[[2, 3, 7]] = False
    received[skin.find_taxels("right")] = False
    scans = scans_of(skin, 4, received=received)
    packets = [decode_packet(packet) for packet in heard_with(scans=scans)[0]]
    data = [packet for packet in packets if isinstance(packet, Data)]
    assert {packet.address for packet in data} == {1, 2}
    sent = np.zeros(skin.count, dtype=bool)
    for packet in data:
        first = int(skin.find_taxels(skin.patches[packet.address - 1].id)[0])
        sent[first + packet.first :][: len(packet.counts)] = True
    np.testing.assert_array_equal(sent, received)


def test_every_patch_introduces_itself_first_and_once_a_second():
    skin = small_skin()
    packets = [decode_packet(packet) for packet in heard_with(count=101)[0]]
    for patch in skin.patches:
        own = [packet for packet in packets if packet.address == patch.address]
        assert isinstance(own[0], Hello)
        assert isinstance(own[1], Status)
        hellos = [packet for packet in own if isinstance(packet, Hello)]
        assert len(hellos) == 3
        assert len({hello.serial_number for hello in hellos}) == 1
        size = (hellos[0].rows, hellos[0].columns, hellos[0].taxels, hellos[0].rate)
        taxels = len(skin.find_taxels(patch.id))
        assert size == (patch.rows, patch.columns, taxels, RATE)


def test_modules_differ_in_serial_number_clock_and_pace():
    _, device = heard_with(count=50)
    assert len({patch.serial_number for patch in device.patches}) == 3
    assert len({patch.device_time(0) for patch in device.patches}) == 3
    passed = {p.device_time(10 * SECOND) - p.device_time(0) for p in device.patches}
    assert len(passed) == 3
    assert all(abs(time - 10_000_000) <= 500 for time in passed)


def test_clock_and_scan_number_wrap_and_nothing_else_happens():
    skin = small_skin()
    patch = VirtualPatch(skin.patches[0], np.arange(12), RATE, 7)
    patch.wrap_in(1.0, at=3 * SECOND)
    counts = np.arange(skin.count, dtype=np.int32)
    received = np.ones(skin.count, dtype=bool)
    heard = [
        decode_packet(
            patch.measure(counts, received, 3 * SECOND + scan * SECOND // 50)[0]
        )
        for scan in range(100)
    ]
    times = np.array([packet.device_time for packet in heard])
    scans = np.array([packet.scan for packet in heard])
    assert (np.diff(times) % 2**32 == 20_000).all()
    assert (np.diff(scans) % 2**16 == 1).all()
    assert np.flatnonzero(np.diff(times) < 0).tolist() == [49]
    assert np.flatnonzero(np.diff(scans) < 0).tolist() == [49]


def test_a_scan_that_does_not_fit_is_refused():
    skin = small_skin()
    device = VirtualSkin(skin, [Listener()])
    received = np.ones(skin.count, dtype=bool)
    with pytest.raises(DeviceError, match="has 5 counts, skin 'small' has 34"):
        device.send(Scan(1, np.zeros(5, np.int32), received[:5], np.zeros(0)))
    counts = np.full(skin.count, 70_000, np.int32)
    with pytest.raises(DeviceError, match="allowed by the protocol are 0 to 65535"):
        device.send(Scan(1, counts, received, np.zeros(0)))
    with pytest.raises(ValueError, match="4 ports for 3 patches"):
        VirtualSkin(skin, [Listener()] * 4)
    with pytest.raises(ValueError, match="rate is 0"):
        VirtualSkin(skin, [Listener()], rate=0.0)


def test_scans_are_held_at_a_higher_rate_and_left_out_at_a_lower():
    scans = list(scans_of(small_skin(), 50))
    stamps = [scan.stamp for scan in scans]
    faster = [scan.stamp for scan in resample_scans(scans, 4 * RATE)]
    assert faster == [stamp for stamp in stamps[:-1] for _ in range(4)] + stamps[-1:]
    slower = [scan.stamp for scan in resample_scans(scans, RATE / 5)]
    assert slower == [*stamps[::5], stamps[-1]]
    assert [scan.stamp for scan in resample_scans(scans, RATE)] == stamps
    assert list(resample_scans([], RATE)) == []


def test_a_pseudo_terminal_carries_every_packet():
    skin = small_skin()
    device = pty_skin(skin)
    with opened(device.ports[0]) as line:
        with playing(device, scans_of(skin, 500), ManualClock()):
            packets = read_packets(line, 3 * (500 + 2 * 10))
    found = rebuilt(skin, packets)
    np.testing.assert_array_equal(found, [s.counts for s in scans_of(skin, 500)])
    assert device.counters()["unheard"] == 0


def test_a_udp_socket_carries_every_packet():
    skin = small_skin()
    with listening() as (heard, port):
        device = udp_skin(skin, port)
        with playing(device, scans_of(skin, 10), ManualClock()):
            packets = [decode_packet(heard.recv(2048)) for _ in range(3 * (10 + 2))]
    found = rebuilt(skin, packets)
    np.testing.assert_array_equal(found, [s.counts for s in scans_of(skin, 10)])


def test_patches_are_spread_over_ports():
    skin = small_skin()
    ports = [Listener(), Listener()]
    VirtualSkin(skin, ports).play(scans_of(skin, 2), ManualClock())
    addresses = [{decode_packet(data).address for data in port.heard} for port in ports]
    assert addresses == [{1, 2}, {3}]


def test_a_host_clock_paces_the_scans():
    skin = small_skin()
    device = VirtualSkin(skin, [Listener()], rate=200.0)
    clock = HostClock()
    began = clock.now()
    device.play(itertools.cycle(scans_of(skin, 5)), clock, seconds=0.2)
    assert device.scans == 40
    assert clock.now() - began >= 0.19 * SECOND


def test_without_a_listener_nothing_waits_and_the_loss_is_counted():
    skin = small_skin()
    device = pty_skin(skin)
    with device:
        device.play(scans_of(skin, 50), ManualClock())
    assert device.counters()["unheard"] == device.counters()["packets"]
    assert device.counters()["bytes"] == 0


def test_a_listener_that_does_not_read_costs_whole_packets_only():
    skin = small_skin()
    port = PtyPort(timeout=0.0)
    device = VirtualSkin(skin, [port], RATE)
    with device, opened(port) as line:
        device.play(scans_of(skin, 1500), ManualClock())
        lost = device.counters()["unheard"]
        assert lost > 0
        line.timeout = 0.2
        heard = b"".join(iter(lambda: line.read(65536), b""))
        # What had begun is finished once there is room.
        device.send(next(iter(scans_of(skin, 1))))
        heard += b"".join(iter(lambda: line.read(65536), b""))
    deframer = Deframer()
    packets = [decode_packet(packet) for packet in deframer.push(heard)]
    assert deframer.broken == 0
    assert len(packets) == device.packets - lost
    assert device.counters()["unheard"] == lost
    assert device.counters()["bytes"] == len(heard)
    assert [packet.address for packet in packets[-3:]] == [3, 3, 3]


def test_a_port_is_raw_to_whoever_opens_it():
    with PtyPort() as port:
        line = os.open(port.uri.removeprefix("serial:"), os.O_RDONLY | os.O_NOCTTY)
        try:
            port.send([bytes(range(256))])
            assert select.select([line], [], [], 1.0)[0]
            assert os.read(line, 1000) == bytes(range(256))
        finally:
            os.close(line)


def test_a_listener_that_is_late_hears_the_end_all_the_same():
    skin = small_skin()
    device = pty_skin(skin)
    with opened(device.ports[0]) as line:

        def play():
            with device:
                device.play(scans_of(skin, 3), ManualClock())

        thread = threading.Thread(target=play)
        thread.start()
        time.sleep(0.2)
        packets = read_packets(line, 3 * (3 + 2))
        thread.join()
    found = rebuilt(skin, packets)
    np.testing.assert_array_equal(found, [s.counts for s in scans_of(skin, 3)])


def test_a_port_keeps_its_name_and_leaves_none_behind(tmp_path):
    link = tmp_path / "port"
    port = PtyPort(link)
    assert port.uri == f"serial:{link}"
    port.unplug()
    assert not link.is_symlink()
    port.plug()
    with opened(port) as line:
        port.send([b"abc\0"])
        assert line.read(4) == b"abc\0"
    port.close()
    port.close()
    assert not link.is_symlink()


def test_a_name_that_is_taken_or_cannot_be_made_is_refused(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    with pytest.raises(DeviceError, match="it is there already"):
        PtyPort(taken)
    assert taken.read_text() == "mine"
    with pytest.raises(DeviceError, match="cannot open a pseudo-terminal"):
        PtyPort(tmp_path / "nowhere" / "port")


def test_a_computer_that_is_not_known_is_refused():
    with pytest.raises(DeviceError, match="cannot send to"):
        UdpPort("no.such.computer.invalid", 9750)
    with UdpPort("::1", 9750) as port:
        assert port.uri == "udp://[::1]:9750"
