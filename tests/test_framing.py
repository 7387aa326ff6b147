"""Frames on a line: found again however it is cut, and whatever lies between."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.drivers.framing import MAX_FRAME_BYTES, Deframer, encode_frame
from eskin.drivers.packet import MAX_PACKET_BYTES

PACKETS = st.lists(st.binary(min_size=1, max_size=MAX_PACKET_BYTES), max_size=6)
GARBAGE = st.lists(st.binary(max_size=2000), max_size=6)


def counters(deframer):
    return deframer.bytes, deframer.frames, deframer.broken


def cut(stream, seed, most):
    rng, chunks = random.Random(seed), []
    while stream:
        size = rng.randint(0, most)
        chunks.append(stream[:size])
        stream = stream[size:]
    return chunks


def push_all(chunks):
    deframer = Deframer()
    return [packet for chunk in chunks for packet in deframer.push(chunk)], deframer


@given(PACKETS)
def test_packets_come_out_as_they_went_in(packets):
    framed = [encode_frame(packet) for packet in packets]
    assert all(data.index(0) == len(data) - 1 <= MAX_FRAME_BYTES for data in framed)
    found, deframer = push_all(framed)
    assert found == packets
    assert counters(deframer) == (sum(map(len, framed)), len(packets), 0)


@settings(max_examples=60)
@given(PACKETS, GARBAGE, st.integers(), st.sampled_from([1, 3, 100, 5000]))
def test_any_cut_of_the_stream_gives_the_same(packets, garbage, seed, most):
    parts = [encode_frame(packet) for packet in packets] + garbage
    random.Random(seed).shuffle(parts)
    stream = b"".join(parts)
    found, deframer = push_all(cut(stream, seed, most))
    expected, whole = push_all([stream])
    assert found == expected
    assert counters(deframer) == counters(whole)


@given(st.binary(max_size=3000), PACKETS)
def test_garbage_costs_at_most_the_frame_that_it_touches(garbage, packets):
    found, _ = push_all([garbage, *map(encode_frame, packets)])
    kept = packets[1:] if packets else []
    assert found[len(found) - len(kept) :] == kept
    found, _ = push_all([garbage, b"\0", *map(encode_frame, packets)])
    assert found[len(found) - len(packets) :] == packets


@given(st.binary(min_size=1, max_size=300), st.data())
def test_a_damaged_frame_costs_only_itself(packet, data):
    framed = bytearray(encode_frame(packet))
    place = data.draw(st.integers(0, len(framed) - 2))
    framed[place] ^= data.draw(st.integers(1, 255))
    found, deframer = push_all(
        [encode_frame(b"before"), bytes(framed), encode_frame(b"after")]
    )
    assert found[0] == b"before" and found[-1] == b"after"
    assert packet not in found[1:-1]
    assert deframer.frames == len(found)


def test_nothing_between_two_zeros_is_no_frame():
    found, deframer = push_all([b"\0\0", encode_frame(b"one"), b"\0\0\0"])
    assert found == [b"one"]
    assert (deframer.frames, deframer.broken) == (1, 0)


def test_what_is_no_cobs_is_counted_as_broken():
    found, deframer = push_all([b"\x05ab\0", b"\x03a\0", encode_frame(b"one")])
    assert found == [b"one"]
    assert counters(deframer) == (12, 1, 2)


@pytest.mark.parametrize("most", [1, 700, 10**6])
def test_a_frame_without_end_is_thrown_away_up_to_the_next_zero(most):
    flood = b"\x01" * 50_000
    deframer = Deframer()
    for chunk in cut(flood, 1, most):
        assert deframer.push(chunk) == []
        assert len(deframer.open) <= MAX_FRAME_BYTES
    assert deframer.broken == 1
    assert deframer.push(b"\x01\x01\0" + encode_frame(b"next")) == [b"next"]
    assert (deframer.frames, deframer.broken) == (1, 1)


def test_the_longest_packet_passes_and_a_longer_frame_does_not():
    longest = b"\xff" * MAX_PACKET_BYTES
    assert len(encode_frame(longest)) == MAX_FRAME_BYTES + 1 == 1407
    found, deframer = push_all([encode_frame(longest), encode_frame(longest + b"\xff")])
    assert found == [longest]
    assert deframer.broken == 1
