"""Tests of the device protocol: packets, frames, and docs/protocol.md."""

import dataclasses
import importlib.util
import json
import random
import re
import struct
import zlib
from hashlib import blake2s
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eskin.drivers import (
    Data,
    Deframer,
    Echo,
    Hello,
    Request,
    SessionSeal,
    Status,
    decode_packet,
    encode_frame,
    encode_packet,
)
from eskin.drivers.packet import encode_counts
from eskin.drivers.sessions import is_sealed, read_seal
from eskin.errors import PacketError

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "tests/data"
PAGE = (ROOT / "docs/protocol.md").read_text("utf-8")
EXAMPLES = re.findall(r"Example `([a-z ]+)`(, framed)?:\n\n```\n(.*?)```", PAGE, re.S)
VECTORS = json.loads((FOLDER / "protocol_v1.json").read_text("utf-8"))["vectors"]
SECOND_VECTORS = json.loads((FOLDER / "protocol_v2.json").read_text("utf-8"))["vectors"]
MIN_BYTES = 14
MAX_BYTES = 1400
MAX_FRAME = 1406
MAX_COUNTS = 691

U16 = st.integers(0, 2**16 - 1)
U32 = st.integers(0, 2**32 - 1)
U64 = st.integers(0, 2**64 - 1)
I16 = st.integers(-(2**15), 2**15 - 1)
TEXT = st.text(max_size=255).filter(lambda text: len(text.encode()) < 256)
COUNTS = hnp.arrays(np.uint16, st.integers(0, MAX_COUNTS))
PACKETS = st.one_of(
    st.builds(Hello, U16, U16, U32, U16, U16, U16, U16, U64, TEXT),
    st.builds(Data, U16, U16, U32, U16, COUNTS),
    st.builds(Status, U16, U16, U32, U32, U32, I16),
)
CHALLENGES = st.binary(min_size=16, max_size=16)
SECOND_PACKETS = st.one_of(
    PACKETS,
    st.builds(Request, U16, U32, CHALLENGES),
    st.builds(Echo, U16, U16, U32, U32, CHALLENGES, U32),
)
BYTES = st.lists(st.binary(min_size=1, max_size=MAX_BYTES), max_size=6)
HELLO = Hello(4, 7, 1_000_000, 3, 4, 10, 50, 99, "demo 1.0")
DATA = Data(4, 8, 1_020_000, 0, np.array([0, 1, 256, 4095, 513], np.uint16))
STATUS = Status(4, 8, 1_021_000, 2, 0, 3125)
each_kind = pytest.mark.parametrize("packet", [HELLO, DATA, STATUS])


def are_equal(one, other):
    """Return whether two packets are equal, their counts too."""
    fields = [dataclasses.asdict(packet) for packet in (one, other)]
    counts = [field.pop("counts", ()) for field in fields]
    return (
        type(one) is type(other) and fields[0] == fields[1] and np.array_equal(*counts)
    )


def seal(body):
    """Return the bytes with the CRC that makes a packet of them."""
    return body + struct.pack("<I", zlib.crc32(body))


def refusal(function, argument):
    """Return the reason why a packet is refused, in one line."""
    with pytest.raises(PacketError) as caught:
        function(argument)
    assert "\n" not in str(caught.value)
    return caught.value.reason


@given(PACKETS)
def test_encoded_packet_is_decoded(packet):
    data = encode_packet(packet)
    assert len(data) <= MAX_BYTES
    assert are_equal(decode_packet(data), packet)


@settings(max_examples=50)
@given(SECOND_PACKETS, st.binary(min_size=32, max_size=32), CHALLENGES, U32)
def test_packet_of_version_2_is_decoded_with_and_without_seal(
    packet, key, challenge, counter
):
    data = encode_packet(packet, 2)
    seal = SessionSeal(key, challenge)
    assert are_equal(decode_packet(data), packet) and not is_sealed(data)
    if len(data) > MAX_BYTES - 24:
        assert refusal(lambda data: seal.close(data, counter), data) == "length"
        return
    sealed = seal.close(data, counter)
    assert len(sealed) == len(data) + 24 and is_sealed(sealed)
    assert are_equal(decode_packet(sealed), packet)
    assert read_seal(sealed) == (int.from_bytes(challenge[:2], "little"), counter)
    assert seal.is_valid(sealed)


@pytest.mark.slow
@settings(max_examples=200)
@given(st.integers(1, 2), st.integers(0, 6), st.binary(max_size=50))
def test_decoded_packet_is_encoded_to_the_same_bytes(version, kind, rest):
    data = seal(bytes([version, kind]) + rest)
    try:
        packet = decode_packet(data)
    except PacketError as error:
        assert error.reason in ("length", "kind", "content")
    else:
        assert encode_packet(packet, version) == data


@each_kind
def test_flipped_bits_and_other_lengths_are_refused(packet):
    data = encode_packet(packet)
    for place in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        assert refusal(decode_packet, flipped) == "crc"
    for size in range(len(data)):
        assert refusal(decode_packet, data[:size]) in ("length", "crc")
    for size in range(len(data) - 4):
        assert refusal(decode_packet, seal(data[:size])) in ("length", "content")
    assert refusal(decode_packet, data + b"\0") == "crc"
    assert refusal(decode_packet, seal(data[:-4] + b"\0")) == "content"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (bytes(MIN_BYTES - 1), "length"),
        (bytes(MIN_BYTES), "crc"),
        (bytes(MAX_BYTES + 1), "length"),
        (seal(b"\x03\x01" + bytes(12)), "version"),
        (seal(b"\x02\x09" + bytes(12)), "kind"),
        (seal(b"\x01\x04" + bytes(12)), "kind"),
        (seal(b"\x01\x81" + bytes(40)), "kind"),
        (seal(b"\x02\x81" + bytes(8)), "content"),
        (seal(b"\x02\x83" + bytes(20)), "content"),
        (seal(b"\x01\x00" + bytes(12)), "kind"),
        (seal(b"\x01\x02" + encode_packet(STATUS)[2:-4]), "content"),
        (seal(encode_packet(HELLO)[:-5] + b"\xff"), "content"),
    ],
)
def test_reason_is_the_first_check_that_fails(data, reason):
    assert refusal(decode_packet, data) == reason


def test_packet_holds_a_bounded_number_of_counts():
    full = dataclasses.replace(DATA, counts=np.full(MAX_COUNTS, 65535, np.uint16))
    assert len(encode_packet(full)) == MAX_BYTES
    assert are_equal(decode_packet(encode_packet(full)), full)
    over = dataclasses.replace(DATA, counts=np.zeros(MAX_COUNTS + 1, np.uint16))
    assert refusal(encode_packet, over) == "length"


@pytest.mark.parametrize(
    ("packet", "field"),
    [
        (HELLO, {"address": -1}),
        (HELLO, {"scan": 65536}),
        (HELLO, {"device_time": 2**32}),
        (HELLO, {"serial_number": 2**64}),
        (HELLO, {"firmware": "ü" * 128}),
        (HELLO, {"firmware": "\udc80"}),
        (DATA, {"first": 65536}),
        (STATUS, {"skipped": -1}),
        (STATUS, {"temperature": 32768}),
    ],
)
def test_value_that_does_not_fit_its_field_is_refused(packet, field):
    changed = dataclasses.replace(packet, **field)
    assert refusal(encode_packet, changed) == "content"


@pytest.mark.parametrize(
    "counts",
    [np.array([1], np.int32), np.array([1.0]), np.zeros((2, 2), np.uint16)],
)
def test_counts_of_another_type_are_refused(counts):
    # Behind the tests' own check of types, which users do not have.
    assert refusal(encode_counts.__wrapped__, counts) == "content"


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
@each_kind
def test_any_kind_of_bytes_is_decoded_and_copied(packet, kind):
    buffer = bytearray(encode_packet(packet))
    decoded = decode_packet(kind(buffer))
    buffer[:] = bytes(len(buffer))
    assert are_equal(decoded, packet)
    assert packet is not DATA or not decoded.counts.flags.writeable


CLASSES = {
    "hello": Hello,
    "data": Data,
    "status": Status,
    "request": Request,
    "echo": Echo,
}


def make_packet(vector):
    fields = dict(vector["fields"])
    if vector["kind"] == "data":
        fields["counts"] = np.array(fields["counts"], np.uint16)
    if vector["kind"] == "hello":
        fields["serial_number"] = int(fields["serial_number"], 16)
    if "challenge" in fields:
        fields["challenge"] = bytes.fromhex(fields["challenge"])
    return CLASSES[vector["kind"]](**fields)


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_codec_agrees_with_the_vectors(vector):
    packet = make_packet(vector)
    data = bytes.fromhex(vector["packet"])
    framed = bytes.fromhex(vector["framed"])
    assert encode_packet(packet) == data
    if vector["kind"] == "data":
        swapped = dataclasses.replace(packet, counts=packet.counts.astype(">u2"))
        assert encode_packet(swapped) == data
    assert are_equal(decode_packet(data), packet)
    assert encode_frame(data) == framed
    assert Deframer().push_chunk(framed) == [data]


@pytest.mark.parametrize(
    "vector", SECOND_VECTORS, ids=lambda vector: f"2: {vector['name']}"
)
def test_codec_agrees_with_the_vectors_of_version_2(vector):
    packet = make_packet(vector)
    data = bytes.fromhex(vector["packet"])
    made = encode_packet(packet, 2)
    seal = vector["seal"]
    if seal is not None:
        key = bytes.fromhex(seal["key"])
        challenge = bytes.fromhex(seal["challenge"])
        made = SessionSeal(key, challenge).close(made, seal["counter"])
        tag = blake2s(challenge + data[:-20], key=key, digest_size=16).digest()
        assert data[-20:-4] == tag
    assert made == data and are_equal(decode_packet(data), packet)
    assert Deframer().push_chunk(bytes.fromhex(vector["framed"])) == [data]


@pytest.mark.parametrize(
    ("packet", "version"),
    [
        (Request(1, 0, bytes(16)), 1),
        (Echo(1, 2, 3, 4, bytes(16), 5), 1),
        (HELLO, 3),
        (Request(1, 0, bytes(15)), 2),
        (Echo(1, 2, 3, 4, bytes(17), 5), 2),
        (Request(1, 2**32, bytes(16)), 2),
    ],
)
def test_packet_that_a_version_does_not_have_is_refused(packet, version):
    assert refusal(lambda packet: encode_packet(packet, version), packet) == "content"


def test_request_has_neither_scan_number_nor_device_time():
    data = bytearray(encode_packet(Request(1, 2, bytes(16)), 2)[:-4])
    data[5] = 1
    assert refusal(decode_packet, seal(bytes(data))) == "content"


@pytest.mark.parametrize("name", ["make_protocol_v1", "make_protocol_v2"])
def test_vectors_are_what_their_program_makes(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    assert program.FILE.read_text("utf-8") == program.text()


def test_a_vector_ends_in_a_run_that_fills_its_block():
    ends = [bytes.fromhex(vector["packet"]).rpartition(b"\0")[2] for vector in VECTORS]
    assert 254 in map(len, ends)


def test_page_states_the_limits_and_has_an_example_of_every_kind():
    names = [(name, bool(framed)) for name, framed, _ in EXAMPLES]
    kinds = [("hello", False), ("data", False), ("data", True), ("status", False)]
    kinds += [("request", False), ("echo", False)]
    assert names == [*kinds, ("sealed hello", False), ("sealed data", False)]
    assert f"{MIN_BYTES} to {MAX_BYTES:,} bytes" in PAGE
    assert f"{MAX_FRAME:,} bytes and the zero" in PAGE
    assert f"0 to {MAX_COUNTS}" in PAGE


@pytest.mark.parametrize(("name", "framed", "block"), EXAMPLES)
def test_example_of_the_page_is_the_vector_of_its_name(name, framed, block):
    vector = next(v for v in [*VECTORS, *SECOND_VECTORS] if v["name"] == name)
    # Words follow the hex of every line.
    lines = re.findall(r"^(?:[0-9a-f]{2}\s+)+", block, re.M)
    expected = bytes.fromhex(vector["framed" if framed else "packet"])
    assert bytes.fromhex("".join(lines)) == expected


def cut(stream, seed, max_size):
    """Return the bytes in chunks of random sizes."""
    rng = random.Random(seed)
    chunks = []
    while stream:
        size = rng.randint(0, max_size)
        chunks.append(stream[:size])
        stream = stream[size:]
    return chunks


def deframe(*chunks):
    """Return the packets found, and the counts of bytes, frames and broken frames."""
    deframer = Deframer()
    packets = [packet for chunk in chunks for packet in deframer.push_chunk(chunk)]
    return packets, (deframer.bytes, deframer.frames, deframer.broken)


@settings(max_examples=60)
@given(
    BYTES,
    st.lists(st.binary(max_size=2000), max_size=6),
    st.integers(),
    st.sampled_from([1, 3, 100, 5000]),
)
def test_any_cut_of_a_stream_gives_the_same(packets, garbage, seed, max_size):
    parts = [encode_frame(packet) for packet in packets] + garbage
    random.Random(seed).shuffle(parts)
    stream = b"".join(parts)
    assert deframe(*cut(stream, seed, max_size)) == deframe(stream)


@given(st.binary(max_size=3000), BYTES)
def test_garbage_costs_at_most_the_frame_that_it_touches(garbage, packets):
    framed = [encode_frame(packet) for packet in packets]
    found, _ = deframe(garbage, *framed)
    kept = packets[1:]
    assert found[len(found) - len(kept) :] == kept
    found, _ = deframe(garbage, b"\0", *framed)
    assert found[len(found) - len(packets) :] == packets


@given(st.binary(min_size=1, max_size=300), st.data())
def test_damaged_frame_costs_only_itself(packet, data):
    framed = bytearray(encode_frame(packet))
    place = data.draw(st.integers(0, len(framed) - 2))
    framed[place] ^= data.draw(st.integers(1, 255))
    found, (_, frames, _) = deframe(
        encode_frame(b"before"), bytes(framed), encode_frame(b"after")
    )
    assert found[0] == b"before" and found[-1] == b"after"
    assert packet not in found[1:-1]
    assert frames == len(found)


@pytest.mark.parametrize(("before", "broken"), [(b"\0\0", 0), (b"\x05ab\0\x03a\0", 2)])
def test_broken_frames_are_counted_and_empty_ones_are_not(before, broken):
    frame = encode_frame(b"one")
    size = len(before) + len(frame)
    assert deframe(before, frame) == ([b"one"], (size, 1, broken))


@pytest.mark.parametrize("max_size", [1, 700, 10**6])
def test_endless_frame_is_thrown_away_up_to_the_next_zero(max_size):
    deframer = Deframer()
    for chunk in cut(b"\x01" * 5000, 1, max_size):
        assert deframer.push_chunk(chunk) == []
        assert len(deframer.open) <= MAX_FRAME
    assert deframer.broken == 1
    assert deframer.push_chunk(b"\x01\x01\0" + encode_frame(b"next")) == [b"next"]
    assert (deframer.frames, deframer.broken) == (1, 1)


def test_frame_longer_than_the_longest_packet_is_broken():
    longest = b"\xff" * MAX_BYTES
    assert len(encode_frame(longest)) == MAX_FRAME + 1
    found, counts = deframe(encode_frame(longest), encode_frame(longest + b"\xff"))
    assert found == [longest] and counts[1:] == (1, 1)
