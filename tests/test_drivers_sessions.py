"""Tests of protocol version 2: seals, sessions, requests, and what is refused."""

import zlib
from contextlib import suppress
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.drivers import (
    DeviceSource,
    Echo,
    FixedJoints,
    HostClock,
    HostSessions,
    ManualClock,
    Request,
    SerialTransport,
    SessionSeal,
    UdpTransport,
    decode_packet,
    encode_packet,
    read_key,
)
from eskin.drivers.sessions import CounterWindow
from eskin.errors import PacketError
from eskin.sim.virtual import (
    PtyPort,
    UdpPort,
    VirtualPatch,
    VirtualSkin,
)
from helpers.devices import (
    RATE,
    calibration_of,
    mounted_small,
    playing,
    scans_of,
    small_skin,
)
from helpers.modules import MS, SKIN, TAXELS, AssemblerRun, Module
from helpers.touch import SECOND, START

KEY = bytes(range(32))
OTHER_KEY = bytes(32)
COUNTS = np.arange(TAXELS).astype(np.int32)
ALL = np.ones(TAXELS, bool)
CHALLENGE = b"c" * 16


class Talk:
    """One patch and its host, without a line between them."""

    def __init__(self, key: bytes | None = KEY, patch_key: bytes | None = None):
        self.clock = ManualClock(SECOND)
        numbers = count(1)
        self.host = HostSessions(
            [0], self.clock, key, lambda size: next(numbers).to_bytes(size, "little")
        )
        patch_key = key if patch_key is None else patch_key
        taxels = np.arange(TAXELS)
        self.patch = VirtualPatch(SKIN.patches[0], taxels, 50.0, 7, key=patch_key)

    def authenticate(self, data, port="a"):
        return self.host.authenticate(decode_packet(data), data, self.clock.now(), port)

    def refused(self, data, port="a"):
        """Return why a packet is not assembled; None for one that is."""
        return self.authenticate(data, port).refused

    def measure(self):
        (data,) = self.patch.measure(COUNTS, ALL, self.clock.now())
        return data

    def hello(self):
        return self.patch.build_hello(self.clock.now())

    def wait(self, seconds):
        self.clock.sleep(seconds)
        return [data for _, data in self.host.take_requests(self.clock.now())]

    def answer(self, data):
        return self.patch.answer(decode_packet(data), data, self.clock.now())

    def open(self, port="a"):
        """Open the session by a hello; return the request, and all that answers it."""
        self.authenticate(self.hello(), port)
        *_, opening = self.wait(0.05)
        answers = self.answer(opening)
        assert [self.refused(data, port) for data in answers] == [None] * len(answers)
        return opening, answers


def reseal(content):
    """Return bytes with the CRC that makes a packet of them."""
    return bytes(content) + zlib.crc32(content).to_bytes(4, "little")


def test_patch_is_assembled_from_the_first_packet_of_its_session():
    talk = Talk()
    assert talk.patch.measure(COUNTS, ALL, 0) == []
    assert talk.refused(talk.hello()) == "held"
    talk.open()
    verdict = talk.authenticate(talk.measure(), port="anywhere")
    assert verdict.refused is None and verdict.port == f"key:{7:016x}"


def test_echo_tells_when_its_request_was_sent_once():
    talk = Talk()
    _, (_, opening_echo) = talk.open()
    assert isinstance(decode_packet(opening_echo), Echo)
    (ping,) = talk.wait(0.25)
    sent = talk.clock.now()
    (echo,) = talk.answer(ping)
    talk.clock.sleep(0.01)
    assert talk.authenticate(echo).sent == sent
    assert talk.refused(echo) == "duplicate"
    # The patch answers no request twice, and one of another number is of no use.
    assert talk.answer(ping) == []
    numbers = replace(decode_packet(echo), number=9)
    seal = talk.patch.session.seal
    assert talk.refused(seal.close(encode_packet(numbers, 2), 99)) == "late"


@pytest.mark.parametrize(
    "forge",
    [
        lambda talk, data: encode_packet(decode_packet(data)),
        lambda talk, data: encode_packet(decode_packet(data), 2),
        lambda talk, data: SessionSeal(OTHER_KEY, talk.challenge()).close(
            encode_packet(decode_packet(data), 2), 500
        ),
        lambda talk, data: SessionSeal(KEY, CHALLENGE).close(
            encode_packet(decode_packet(data), 2), 500
        ),
        lambda talk, data: talk.patch.session.unopened.close(
            encode_packet(decode_packet(data), 2), 500
        ),
        lambda talk, data: reseal(data[:-20] + bytes(16)),
        lambda talk, data: reseal(data[:4] + b"\xff" + data[5:-4]),
    ],
    ids="v1 v2 key challenge unopened tag changed".split(),
)
def test_packet_without_valid_seal_is_unauthenticated(forge):
    talk = Talk()
    talk.challenge = lambda: talk.host.sessions[0][0].challenge
    talk.open()
    data = talk.measure()
    assert talk.refused(forge(talk, data)) == "unauthenticated"
    # It has used up nothing: what was sent is still assembled.
    assert talk.refused(data) is None


@pytest.mark.parametrize("make", [Talk.measure, Talk.hello])
def test_changed_bits_and_other_lengths_are_never_authentic(make):
    talk = Talk()
    talk.open()
    data = make(talk)
    changed = [data[:place] + data[place + 1 :] for place in range(len(data) - 4)]
    for place in range(8 * (len(data) - 4)):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        changed.append(flipped)
    for bad in changed:
        with suppress(PacketError):
            assert talk.refused(reseal(bad[:-4])) == "unauthenticated"
    assert talk.refused(data) is None


def test_packets_of_an_earlier_run_of_the_host_are_refused():
    talk = Talk()
    opening, _ = talk.open()
    old = [talk.measure() for _ in range(5)]
    again = Talk()
    # Its host draws other challenges.
    again.host.random = lambda size: b"\x99" * size
    again.open()
    assert {again.refused(data) for data in old} == {"unauthenticated"}
    assert again.answer(opening) == []
    assert again.refused(again.measure()) is None


def test_reordered_packets_are_new_once_and_old_ones_never():
    talk = Talk()
    talk.open()
    packets = [talk.measure() for _ in range(1100)]
    order = np.random.default_rng(0).permutation(len(packets[:300]))
    assert {talk.refused(packets[n]) for n in order} == {None}
    assert {talk.refused(packets[n]) for n in order} == {"duplicate"}
    assert talk.refused(packets[1099]) is None
    assert talk.refused(packets[0]) == "late"


@given(st.lists(st.integers(0, 3000), max_size=200))
def test_window_accepts_each_counter_once(counters):
    window = CounterWindow()
    accepted = set()
    for counter in counters:
        if window.add_counter(counter) == "new":
            assert counter not in accepted
            accepted.add(counter)
    assert max(counters, default=-1) == window.highest


def test_patch_that_reboots_gets_a_new_session_and_its_old_packets_are_refused():
    talk = Talk()
    talk.open()
    old = [talk.measure() for _ in range(3)]
    assert talk.refused(old[0]) is None
    talk.patch.power_up(talk.clock.now())
    talk.clock.sleep(0.1)
    talk.open()
    assert {talk.refused(data) for data in old} == {"unauthenticated"}
    assert talk.refused(talk.measure()) is None
    assert len(talk.host.sessions[0]) == 1


def test_recorded_hello_of_no_session_interrupts_nothing():
    talk = Talk()
    boot = talk.hello()
    talk.open()
    for port in ["a", *map(str, range(20))]:
        assert talk.refused(boot, port) == "held"
    requests = talk.wait(0.25)
    # One request goes to each, and the patch answers only that of its session.
    assert len(requests) <= 8
    assert sum(len(talk.answer(data)) for data in requests) == 1
    assert talk.refused(talk.measure()) is None
    assert talk.wait(0.05) == []


def test_stranger_cannot_open_a_session_or_make_the_patch_answer():
    talk = Talk()
    request = Request(0, 0, CHALLENGE)
    later = encode_packet(replace(request, number=1), 2)
    forged = [
        encode_packet(request, 2),
        SessionSeal(OTHER_KEY, CHALLENGE).close(encode_packet(request, 2), 0),
        SessionSeal(KEY, CHALLENGE).close(later, 1),
    ]
    assert [talk.answer(data) for data in forged] == [[], [], []]
    talk.open()
    taken = SessionSeal(KEY, CHALLENGE).close(encode_packet(request, 2), 0)
    assert talk.answer(taken) == []
    # After two seconds without its host the patch may have another.
    talk.clock.sleep(2.1)
    assert len(talk.answer(taken)) == 2


def test_host_without_key_takes_packets_without_seal_and_asks_for_the_clock():
    talk = Talk(key=None)
    _, (echo,) = talk.open()
    assert talk.refused(talk.measure()) is None
    (ping,) = talk.wait(0.25)
    sent = talk.clock.now()
    (echo,) = talk.answer(ping)
    # Who has not received the request does not know its challenge.
    forged = replace(decode_packet(echo), challenge=CHALLENGE)
    assert talk.refused(encode_packet(forged, 2)) == "late"
    assert talk.refused(echo, port="b") == "late"
    assert talk.authenticate(echo).sent == sent
    sealed = Talk(patch_key=KEY).hello()
    assert talk.refused(sealed) == "unauthenticated"


def test_host_sends_no_requests_to_patches_of_version_1():
    talk = Talk(key=None)
    talk.patch.version = 1
    assert talk.refused(talk.hello()) is None
    assert talk.wait(1.0) == []


def test_silent_session_is_dropped():
    talk = Talk()
    talk.open()
    talk.wait(9.0)
    assert talk.host.sessions[0]
    talk.wait(1.1)
    assert not talk.host.sessions[0]


def test_packet_that_is_too_long_for_a_seal_is_refused():
    full = Module(taxels=691).data(SECOND)[0]
    with pytest.raises(PacketError, match="allowed with a seal are 1376") as caught:
        SessionSeal(KEY, CHALLENGE).close(encode_packet(full, 2), 0)
    assert caught.value.reason == "length"


def test_key_file_is_read(tmp_path):
    path = tmp_path / "key"
    path.write_text(KEY.hex().upper() + "\n")
    path.chmod(0o600)
    assert read_key(path) == KEY


@pytest.mark.slow
@pytest.mark.parametrize("over", ["udp", "serial"])
def test_sealed_packets_are_assembled_over_a_transport(over):
    skin = small_skin()
    clock = HostClock()
    if over == "udp":
        transport = UdpTransport(clock, authenticated=True)
        port = UdpPort("127.0.0.1", transport.port)
    else:
        port = PtyPort()
        transport = SerialTransport(clock, [port.uri.removeprefix("serial:")])
    device = VirtualSkin(skin, [port], RATE, key=KEY)
    with playing(device, scans_of(skin, 10_000), clock):
        source = DeviceSource(
            transport,
            mounted_small(),
            calibration_of(skin),
            FixedJoints(np.zeros(0)),
            clock,
            "test:",
            key=KEY,
        )
        with source:
            end = clock.now() + 700 * MS
            while clock.now() < end:
                source.read(0.1)
            counters = source.counters()
    assert counters["used"] > 30 and counters["echo"] >= 6
    assert counters["unauthenticated"] == counters["foreign"] == 0


@pytest.mark.parametrize(
    ("port", "sent", "held", "outcome", "is_noted"),
    [
        ("a", 5 * MS, 1000, "echo", True),
        ("b", 5 * MS, 1000, "foreign", False),
        ("a", None, 1000, "echo", False),
        # No patch holds a request for longer than its answer took.
        ("a", 5 * MS, 5001, "echo", False),
    ],
)
def test_echo_bounds_the_clock_of_its_patch(port, sent, held, outcome, is_noted):
    run = AssemblerRun().play(Module(serial=1).stream(0, 1), 1)
    noted = []
    run.assembler.streams[0].clock.push_echo = lambda *times: noted.append(times)
    arrived = START + 2 * SECOND
    echo = Echo(0, 1, 123_456, 1, CHALLENGE, held)
    sent = None if sent is None else arrived - sent
    run.assembler.push_packet(echo, arrived, port, sent)
    assert run.counts[outcome] == 1
    assert noted == ([(123_456, sent, arrived - MS)] if is_noted else [])
