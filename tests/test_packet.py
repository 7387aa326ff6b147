"""Packets: what is encoded is decoded, and nothing else ever is."""

import dataclasses
import importlib.util
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eskin.drivers import Deframer, encode_frame
from eskin.drivers.packet import (
    MAX_COUNTS,
    MAX_PACKET_BYTES,
    Data,
    Hello,
    Packet,
    Status,
    decode_packet,
    encode_counts,
    encode_packet,
)
from eskin.errors import PacketError

FOLDER = Path(__file__).parent / "data"
VECTORS = json.loads((FOLDER / "protocol_v1.json").read_text("utf-8"))["vectors"]
KINDS = {"hello": Hello, "data": Data, "status": Status}

U16, U32 = st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
TEXT = st.text(max_size=255).filter(lambda text: len(text.encode()) < 256)
COUNTS = hnp.arrays(np.uint16, st.integers(0, MAX_COUNTS))
PACKETS = st.one_of(
    st.builds(
        Hello, U16, U16, U32, U16, U16, U16, U16, st.integers(0, 2**64 - 1), TEXT
    ),
    st.builds(Data, U16, U16, U32, U16, COUNTS),
    st.builds(Status, U16, U16, U32, U32, U32, st.integers(-(2**15), 2**15 - 1)),
)
HELLO = Hello(4, 7, 1_000_000, 3, 4, 10, 50, 99, "demo 1.0")
DATA = Data(4, 8, 1_020_000, 0, np.array([0, 1, 256, 4095, 513], np.uint16))
STATUS = Status(4, 8, 1_021_000, 2, 0, 3125)
THREE = [HELLO, DATA, STATUS]


def same(one, other):
    """Whether two packets are equal, their counts too."""
    facts = [dataclasses.asdict(packet) for packet in (one, other)]
    counts = [fact.pop("counts", np.empty(0)) for fact in facts]
    return type(one) is type(other) and facts[0] == facts[1] and np.array_equal(*counts)


def sealed(head):
    """The bytes with the CRC that makes a packet of them."""
    return head + struct.pack("<I", zlib.crc32(head))


def reason(data):
    with pytest.raises(PacketError) as caught:
        decode_packet(data)
    assert "\n" not in str(caught.value)
    return caught.value.reason


def refusal(packet):
    with pytest.raises(PacketError) as caught:
        encode_packet(packet)
    assert "\n" not in str(caught.value)
    return caught.value.reason


@given(PACKETS)
def test_what_is_encoded_is_decoded(packet):
    data = encode_packet(packet)
    assert len(data) <= MAX_PACKET_BYTES
    assert same(decode_packet(data), packet)


@settings(max_examples=300)
@given(st.integers(0, 3), st.binary(max_size=40))
def test_what_can_be_decoded_is_encoded_to_the_same_bytes(kind, rest):
    data = sealed(bytes([1, kind]) + rest)
    try:
        packet = decode_packet(data)
    except PacketError as error:
        assert error.reason in ("length", "kind", "content")
    else:
        assert encode_packet(packet) == data


@pytest.mark.parametrize("packet", THREE)
def test_every_single_flipped_bit_is_refused(packet):
    data = encode_packet(packet)
    for place in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        assert reason(flipped) == "crc"


@pytest.mark.parametrize("packet", THREE)
def test_every_truncation_is_refused_and_so_is_a_byte_more(packet):
    data = encode_packet(packet)
    for size in range(len(data)):
        assert reason(data[:size]) in ("length", "crc")
    assert reason(data + b"\0") == "crc"


@pytest.mark.parametrize("packet", THREE)
def test_every_truncation_with_a_right_crc_is_refused(packet):
    data = encode_packet(packet)
    for size in range(len(data) - 4):
        assert reason(sealed(data[:size])) in ("length", "content")
    assert reason(sealed(data[:-4] + b"\0")) == "content"


def test_the_first_check_that_fails_is_the_reason():
    head = encode_packet(STATUS)[:-4]
    assert reason(b"") == "length"
    assert reason(bytes(13)) == "length"
    assert reason(bytes(MAX_PACKET_BYTES + 1)) == "length"
    assert reason(bytes(14)) == "crc"
    assert reason(sealed(b"\x02" + head[1:])) == "version"
    assert reason(sealed(b"\x02\x09" + head[2:])) == "version"
    assert reason(sealed(b"\x01\x00" + head[2:])) == "kind"
    assert reason(sealed(b"\x01\x04" + head[2:])) == "kind"
    assert reason(sealed(b"\x01\x02" + head[2:])) == "content"
    hello = encode_packet(HELLO)
    assert reason(sealed(hello[:-5] + b"\xff")) == "content"


def test_a_packet_holds_691_counts_and_no_more():
    assert MAX_COUNTS == 691
    full = dataclasses.replace(DATA, counts=np.full(691, 65535, np.uint16))
    assert len(encode_packet(full)) == MAX_PACKET_BYTES
    assert same(decode_packet(encode_packet(full)), full)
    for more in (692, 70_000):
        over = dataclasses.replace(DATA, counts=np.zeros(more, np.uint16))
        assert refusal(over) == "length"


@pytest.mark.parametrize(
    "packet",
    [
        dataclasses.replace(HELLO, address=-1),
        dataclasses.replace(HELLO, scan=65536),
        dataclasses.replace(HELLO, device_time=2**32),
        dataclasses.replace(HELLO, serial_number=2**64),
        dataclasses.replace(DATA, first=65536),
        dataclasses.replace(DATA, scan=-1, counts=np.zeros(600, np.uint16)),
        dataclasses.replace(STATUS, skipped=-1),
        dataclasses.replace(STATUS, temperature=32768),
    ],
)
def test_what_does_not_fit_its_field_is_refused(packet):
    assert refusal(packet) == "content"


@pytest.mark.parametrize(
    ("firmware", "said"),
    [("ü" * 128, "has 256 bytes of UTF-8; allowed are 255"), ("\udc80", "is no text")],
)
def test_a_firmware_that_is_too_long_or_no_text_is_refused(firmware, said):
    with pytest.raises(PacketError, match=said) as caught:
        encode_packet(dataclasses.replace(HELLO, firmware=firmware))
    assert caught.value.reason == "content"


@pytest.mark.parametrize(
    "counts",
    [
        np.array([65536], np.int32),
        np.array([1], np.int32),
        np.array([1.0], np.float32),
        np.zeros((2, 2), np.uint16),
    ],
)
def test_counts_of_another_type_are_refused_rather_than_wrapped(counts):
    # Behind the tests' own check of types, which users do not have.
    with pytest.raises(PacketError, match="allowed are uint16") as caught:
        encode_counts.__wrapped__(counts)
    assert caught.value.reason == "content"


def test_counts_of_either_byte_order_travel_alike():
    swapped = DATA.counts.astype(">u2")
    assert encode_counts(swapped) == encode_counts(DATA.counts)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
@pytest.mark.parametrize("packet", THREE)
def test_any_kind_of_bytes_is_decoded(packet, kind):
    assert same(decode_packet(kind(encode_packet(packet))), packet)


def test_a_decoded_packet_keeps_its_counts_when_the_buffer_is_used_again():
    buffer = bytearray(encode_packet(DATA))
    packet = decode_packet(memoryview(buffer))
    buffer[:] = bytes(len(buffer))
    assert same(packet, DATA)
    assert not packet.counts.flags.writeable


def packet_of(vector) -> Packet:
    fields = dict(vector["fields"])
    if vector["kind"] == "data":
        fields["counts"] = np.array(fields["counts"], np.uint16)
    if vector["kind"] == "hello":
        fields["serial_number"] = int(fields["serial_number"], 16)
    return KINDS[vector["kind"]](**fields)


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_the_codec_agrees_with_the_vectors_both_ways(vector):
    packet, data = packet_of(vector), bytes.fromhex(vector["packet"])
    framed = bytes.fromhex(vector["framed"])
    assert encode_packet(packet) == data
    assert same(decode_packet(data), packet)
    assert encode_frame(data) == framed
    assert Deframer().push(framed) == [data]


def test_one_vector_ends_in_a_run_that_fills_its_block():
    ends = [bytes.fromhex(vector["packet"]).rpartition(b"\0")[2] for vector in VECTORS]
    assert 254 in map(len, ends)


def test_the_vectors_are_what_their_command_makes():
    spec = importlib.util.spec_from_file_location(
        "made", FOLDER / "make_protocol_v1.py"
    )
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert made.FILE.read_text("utf-8") == made.text()


def test_the_bytes_are_those_that_were_agreed():
    by_hand = (
        "01 02  04 00  08 00  60 90 0f 00  00 00  05 00"
        "  00 00  01 00  00 01  ff 0f  01 02"
    )
    assert encode_packet(DATA) == sealed(bytes.fromhex(by_hand))
    assert zlib.crc32(b"123456789") == 0xCBF43926
