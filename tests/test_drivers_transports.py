"""Tests of serial ports and UDP sockets, on pseudo-terminals and loopback."""

import errno
import os
import pty
import socket
import termios
import time
import tty
from contextlib import closing, contextmanager

import pytest

from eskin.drivers import (
    HostClock,
    SerialTransport,
    UdpTransport,
    encode_frame,
    encode_packet,
)
from eskin.drivers.serial_transport import SerialPort
from eskin.drivers.udp_transport import PEER_TIMEOUT, PeerAddressFilter
from eskin.errors import DeviceError
from helpers.modules import MS, Module
from helpers.touch import SECOND, START

PATIENCE = 20.0
HELLO = encode_packet(Module(0).hello(START))
DATA = [
    encode_packet(packet) for n in range(50) for packet in Module(0).data(START + n)
]


def read_until(transport, is_enough=bool):
    """Return the packets that come until there are enough."""
    packets = []
    end = time.monotonic() + PATIENCE
    while not is_enough(packets) and time.monotonic() < end:
        packets += transport.read(0.05)
    return packets


def read_one(transport):
    """Return the bytes of the only packet that comes."""
    (packet,) = read_until(transport)
    return packet.packet


@contextmanager
def plug_in(link):
    """Give the other end of a pseudo-terminal that is plugged in at a path."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    link.symlink_to(os.ttyname(theirs))
    try:
        yield ours
    finally:
        link.unlink()
        os.close(theirs)
        os.close(ours)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a"


def open_serial(*paths):
    paths = [str(path) for path in paths]
    return closing(SerialTransport(HostClock(), paths))


@contextmanager
def open_udp(**arguments):
    with closing(UdpTransport(HostClock(), **arguments)) as transport:
        yield transport


@contextmanager
def open_sender(transport):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", transport.port))
        yield sender


@pytest.fixture
def udp():
    """Return a transport, and a socket that sends to it."""
    with open_udp() as transport, open_sender(transport) as sender:
        yield transport, sender


def test_packets_come_over_several_serial_ports(tmp_path):
    paths = [tmp_path / "a", tmp_path / "b"]
    with (
        plug_in(paths[0]) as first,
        plug_in(paths[1]) as second,
        open_serial(*paths) as transport,
    ):
        before = transport.clock.now()
        for packet in DATA[:20]:
            os.write(first, encode_frame(packet))
            os.write(second, encode_frame(packet))
        packets = read_until(transport, lambda packets: len(packets) >= 40)
    for path in paths:
        got = [item.packet for item in packets if item.port == str(path)]
        assert got == DATA[:20]
    assert all(item.arrived > before for item in packets)
    assert transport.counters()["frames"] == 40
    transport.close()


def test_port_is_opened_again_when_it_is_back(path):
    kinds = []
    end = time.monotonic() + PATIENCE
    with plug_in(path) as line:
        transport = SerialTransport(HostClock(), [str(path)])
        os.write(line, encode_frame(DATA[0]) + b"half a frame")
        assert read_one(transport) == DATA[0]
    for _ in range(2):
        assert transport.read(0.05) == []
    with closing(transport), plug_in(path) as line:
        while "returned" not in kinds and time.monotonic() < end:
            transport.read(0.05)
            kinds += [event.kind for event in transport.take_events(0)]
        os.write(line, encode_frame(DATA[1]))
        assert read_one(transport) == DATA[1]
    assert kinds == ["silent", "returned"]


@pytest.mark.parametrize(
    ("line", "is_told"), [(b"12,34,1023\r\n", True), (b"\x81\x02 \n", False)]
)
def test_lines_of_text_are_told_from_broken_packets(path, line, is_told):
    with plug_in(path) as ours, open_serial(path) as transport:
        for number in range(300):
            os.write(ours, b"\x80" * (number == 0) + line)
            transport.read(0.01)
        assert transport.counters()["frames"] == 0
        events = [event.text for event in transport.take_events(0)]
        assert len(events) == is_told
        assert all(f"csv:{path} reads lines of numbers" in text for text in events)


def test_bytes_before_a_port_was_opened_are_not_read(path):
    with plug_in(path) as line:
        os.write(line, encode_frame(DATA[0]))
        with open_serial(path) as transport:
            os.write(line, encode_frame(DATA[1]))
            assert read_one(transport) == DATA[1]


def test_port_that_vanishes_while_it_is_opened_is_tried_again(path, monkeypatch):
    def vanish(*_):
        raise termios.error(errno.EIO, "Input/output error")

    with plug_in(path), closing(SerialPort(str(path), 1_000_000)) as port:
        port.close()
        with monkeypatch.context() as patch:
            patch.setattr(termios, "tcflush", vanish)
            assert not port.retry(SECOND)
        assert port.retry(2 * SECOND)


@pytest.mark.parametrize(
    ("paths", "baud", "remedy"),
    [
        (["none"], 9600, "plug it in"),
        (["a", "none"], 9600, "none"),
        (["a"], -5, "baud"),
        ([], 9600, "at least one"),
        (["a", "a"], 9600, "each once"),
    ],
)
def test_ports_that_cannot_be_opened_are_refused(path, paths, baud, remedy):
    names = [str(path.with_name(name)) for name in paths]
    with plug_in(path):
        with pytest.raises(DeviceError, match=remedy) as caught:
            SerialTransport(HostClock(), names, baud)
        # None was left open, though the error keeps the transport alive.
        SerialTransport(HostClock(), [str(path)]).close()
    assert "\n" not in str(caught.value)


def test_datagrams_come_as_they_were_sent(udp):
    transport, sender = udp
    sent = [HELLO, *DATA, b"x" * 9000, b""]
    for packet in sent:
        sender.send(packet)
    packets = read_until(transport, lambda packets: len(packets) >= len(sent))
    # One byte more than allowed tells that a datagram is too long.
    assert [item.packet for item in packets] == [HELLO, *DATA, b"x" * 1401, b""]
    host, port = sender.getsockname()
    assert {item.port for item in packets} == {f"udp://{host}:{port}"}


def test_read_returns_a_bounded_number_of_datagrams(udp):
    transport, sender = udp
    for _ in range(3000):
        sender.send(b"garbage")
    assert 0 < len(transport.read(1.0)) <= 2048


def test_second_sender_of_a_patch_is_refused(udp):
    transport, sender = udp
    sender.send(HELLO)
    assert read_one(transport) == HELLO
    with open_sender(transport) as other:
        for packet in [HELLO, *DATA[:9]]:
            other.send(packet)
        sender.send(DATA[10])
        assert read_one(transport) == DATA[10]
    counters = transport.counters()
    assert (counters["refused"], counters["datagrams"]) == (10, 12)
    (event,) = transport.take_events(transport.clock.now())
    assert event.kind == "conflict" and event.text.startswith("10 ")


def test_patch_is_bound_to_its_sender_until_it_is_silent():
    peers = PeerAddressFilter()
    now = START
    # A damaged hello binds nobody.
    assert peers.admit(HELLO[:-1] + b"x", "b", now)
    assert peers.admit(HELLO, "a", now)
    for _ in range(100):
        now += 50 * MS
        assert peers.admit(DATA[0], "a", now) and not peers.admit(HELLO, "b", now)
    now += PEER_TIMEOUT
    assert peers.admit(DATA[0], "b", now) and peers.admit(HELLO, "b", now)
    assert not peers.admit(HELLO, "a", now)


def test_remote_senders_may_be_allowed_and_a_port_is_bound_once():
    with open_udp(host="0.0.0.0", allow_remote=True) as transport:
        with pytest.raises(DeviceError, match="allowed is a free port"):
            UdpTransport(HostClock(), port=transport.port)
