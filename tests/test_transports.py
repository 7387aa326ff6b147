import errno
import os
import pty
import socket
import termios
import time
import tty
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from eskin.drivers import HostClock, encode_frame, encode_packet
from eskin.drivers.serial_transport import SerialPort, SerialTransport
from eskin.drivers.udp_transport import PEER_TIMEOUT, PeerAddressFilter, UdpTransport
from eskin.errors import DeviceError
from helpers.modules import MS, START, Module
from helpers.touch import SECOND

PATIENCE = 20.0
HELLO = encode_packet(Module(0).hello(START))
DATA = [
    encode_packet(packet) for n in range(50) for packet in Module(0).data(START + n)
]


def read_until(transport, enough):
    """Everything that comes until there is enough, within a generous time."""
    deliveries, end = [], time.monotonic() + PATIENCE
    while not enough(deliveries) and time.monotonic() < end:
        deliveries += transport.read(0.05)
    return deliveries


@contextmanager
def plugged(link: Path):
    """A pseudo-terminal at a path of our choice, as long as it is plugged in."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    link.symlink_to(os.ttyname(theirs))
    try:
        yield ours
    finally:
        link.unlink()
        os.close(theirs)
        os.close(ours)


@contextmanager
def udp(**arguments):
    transport = UdpTransport(HostClock(), **arguments)
    try:
        yield transport
    finally:
        transport.close()


@contextmanager
def sender(transport):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.connect(("127.0.0.1", transport.port))
        yield out


def test_packets_come_over_several_serial_ports_as_they_were_sent(tmp_path):
    paths = [tmp_path / "a", tmp_path / "b"]
    with plugged(paths[0]) as first, plugged(paths[1]) as second:
        transport = SerialTransport(HostClock(), [str(path) for path in paths])
        before = transport.clock.now()
        for packet in DATA[:20]:
            os.write(first, encode_frame(packet))
            os.write(second, encode_frame(packet))
        deliveries = read_until(transport, lambda got: len(got) >= 40)
        for path in paths:
            got = [item for item in deliveries if item.port == str(path)]
            assert [item.packet for item in got] == DATA[:20]
        assert all(item.arrived > before for item in deliveries)
        assert transport.counters()["frames"] == 40
        transport.close()
        transport.close()


def test_a_port_that_is_unplugged_is_opened_when_it_is_back(tmp_path):
    path = tmp_path / "a"
    with plugged(path) as line:
        transport = SerialTransport(HostClock(), [str(path)])
        os.write(line, encode_frame(DATA[0]) + b"half a frame")
        assert len(read_until(transport, bool)) == 1
    kinds = []
    for _ in range(3):
        transport.read(0.05)
    with plugged(path) as line:
        end = time.monotonic() + PATIENCE
        while "returned" not in kinds and time.monotonic() < end:
            transport.read(0.05)
            kinds += [event.kind for event in transport.take_events(0)]
        os.write(line, encode_frame(DATA[1]))
        assert [item.packet for item in read_until(transport, bool)] == [DATA[1]]
        transport.close()
    assert kinds == ["silent", "returned"]


def test_what_lay_in_a_port_before_it_was_opened_is_not_read(tmp_path):
    with plugged(tmp_path / "a") as line:
        os.write(line, encode_frame(DATA[0]))
        transport = SerialTransport(HostClock(), [str(tmp_path / "a")])
        os.write(line, encode_frame(DATA[1]))
        assert [item.packet for item in read_until(transport, bool)] == [DATA[1]]
        transport.close()


def test_garbage_on_a_port_costs_at_most_the_frames_that_it_touches(tmp_path):
    rng = np.random.default_rng(0)
    with plugged(tmp_path / "a") as line:
        transport = SerialTransport(HostClock(), [str(tmp_path / "a")])
        for _ in range(100):
            os.write(line, rng.bytes(2000))
            transport.read(0.05)
        os.write(line, b"\0" + encode_frame(DATA[0]))
        deliveries = read_until(
            transport, lambda got: got and got[-1].packet == DATA[0]
        )
        assert deliveries[-1].packet == DATA[0]
        assert transport.counters()["broken"] > 0
        transport.close()


def test_a_port_that_is_not_there_is_refused_with_a_remedy(tmp_path):
    with pytest.raises(DeviceError, match="plug it in"):
        SerialTransport(HostClock(), [str(tmp_path / "none")])


def test_a_port_that_goes_while_it_is_opened_is_tried_again(tmp_path, monkeypatch):
    def gone(*_):
        raise termios.error(errno.EIO, "Input/output error")

    with plugged(tmp_path / "a"):
        port = SerialPort(str(tmp_path / "a"), 1_000_000)
        port.close()
        with monkeypatch.context() as patch:
            patch.setattr(termios, "tcflush", gone)
            assert not port.retry(SECOND)
        assert port.retry(2 * SECOND)
        port.close()


def test_a_speed_that_no_port_has_is_refused(tmp_path):
    with plugged(tmp_path / "a"), pytest.raises(DeviceError, match="baud"):
        SerialPort(str(tmp_path / "a"), -5)


def test_no_port_or_one_twice_is_refused(tmp_path):
    for paths in ([], ["a", "a"]):
        with pytest.raises(DeviceError, match="at least one, and each once"):
            SerialTransport(HostClock(), paths)


def test_a_missing_port_leaves_no_other_open(tmp_path):
    with plugged(tmp_path / "a"):
        paths = [str(tmp_path / "a"), str(tmp_path / "none")]
        with pytest.raises(DeviceError) as kept:
            SerialTransport(HostClock(), paths)
        SerialTransport(HostClock(), paths[:1]).close()
        assert "none" in str(kept.value)


def test_datagrams_come_as_they_were_sent():
    with udp() as transport, sender(transport) as out:
        for packet in [HELLO, *DATA]:
            out.send(packet)
        deliveries = read_until(transport, lambda got: len(got) >= 51)
        assert [item.packet for item in deliveries] == [HELLO, *DATA]
        peer = out.getsockname()
        assert {item.port for item in deliveries} == {f"udp://{peer[0]}:{peer[1]}"}


def test_a_datagram_is_never_longer_than_what_is_refused():
    with udp() as transport, sender(transport) as out:
        out.send(b"x" * 9000)
        out.send(b"")
        deliveries = read_until(transport, lambda got: len(got) >= 2)
        assert [len(item.packet) for item in deliveries] == [1401, 0]


def test_one_read_takes_no_more_than_a_bounded_number_of_datagrams():
    with udp() as transport, sender(transport) as out:
        for _ in range(3000):
            out.send(b"garbage")
        assert 0 < len(transport.read(1.0)) <= 2048


def test_packets_of_a_patch_from_elsewhere_than_its_first_hello_are_refused():
    with udp() as transport, sender(transport) as own, sender(transport) as other:
        own.send(HELLO)
        assert read_until(transport, bool)
        for packet in [HELLO, *DATA[:9]]:
            other.send(packet)
        own.send(DATA[10])
        deliveries = read_until(transport, bool)
        assert [item.packet for item in deliveries] == [DATA[10]]
        assert transport.counters()["refused"] == 10
        assert transport.counters()["datagrams"] == 12
        (event,) = transport.take_events(transport.clock.now())
        assert event.kind == "conflict" and event.text.startswith("10 packets")


def test_a_pin_holds_while_its_patch_is_heard_and_then_goes_to_the_next_hello():
    pins, now = PeerAddressFilter(), START
    assert pins.admit(HELLO, "a", now)
    for _ in range(100):
        now += 50 * MS
        assert pins.admit(DATA[0], "a", now) and not pins.admit(HELLO, "b", now)
    now += PEER_TIMEOUT
    assert pins.admit(DATA[0], "b", now) and pins.admit(HELLO, "b", now)
    assert not pins.admit(HELLO, "a", now)


def test_a_damaged_hello_pins_nobody():
    pins = PeerAddressFilter()
    assert pins.admit(HELLO[:-1] + b"x", "b", START)
    assert pins.admit(HELLO, "a", START) and not pins.admit(HELLO, "b", START)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::"])
def test_nothing_but_loopback_is_bound_unless_allowed(host):
    with pytest.raises(DeviceError, match="allowed is loopback"):
        UdpTransport(HostClock(), host)


def test_others_can_be_heard_when_that_is_allowed():
    with udp(host="0.0.0.0", allow_remote=True) as transport:
        assert transport.port > 0


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"host": "nowhere"}, "allowed is an IP address"),
        ({"host": "192.0.2.1", "allow_remote": True}, "choose another"),
        ({"port": 70_000}, "choose another"),
    ],
)
def test_an_address_that_cannot_be_bound_is_refused_with_a_remedy(arguments, match):
    with pytest.raises(DeviceError, match=match):
        UdpTransport(HostClock(), **arguments)


def test_a_port_that_is_taken_is_refused():
    with udp() as first, pytest.raises(DeviceError, match="choose another"):
        UdpTransport(HostClock(), port=first.port)
