"""Changing bytes at random, as transports, disks and people do."""

import random
from collections.abc import Sequence

LARGEST = 1 << 16
"""No input grows beyond this [bytes]."""
EDGES = (0, 1, 2, 127, 128, 255, 256, 32767, 32768, 65535, 2**31, 2**32 - 1, 2**63)


def mutate(data: bytes, rng: random.Random, words: Sequence[bytes] = ()) -> bytes:
    """The bytes with one to four changes.

    Args:
        data: a valid input.
        rng: what changes, and where.
        words: that mean something to the reader, and are put in now and then.
    """
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        rng.choice(CHANGES)(changed, rng)
        if words and rng.random() < 0.5:
            put_word(changed, rng, words)
    return bytes(changed[:LARGEST])


def flip_bit(data: bytearray, rng: random.Random) -> None:
    """One bit."""
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def set_byte(data: bytearray, rng: random.Random) -> None:
    """One byte to anything."""
    if data:
        data[rng.randrange(len(data))] = rng.randrange(256)


def set_number(data: bytearray, rng: random.Random) -> None:
    """Two, four or eight bytes to a number near an edge, as a length may be."""
    size = rng.choice((1, 2, 4, 8))
    if len(data) >= size:
        place = rng.randrange(len(data) - size + 1)
        number = rng.choice(EDGES) + rng.randrange(-2, 3)
        whole = (number % 2 ** (8 * size)).to_bytes(size, "little")
        data[place : place + size] = whole


def add_to_number(data: bytearray, rng: random.Random) -> None:
    """A little more or less in a byte."""
    if data:
        place = rng.randrange(len(data))
        data[place] = (data[place] + rng.randrange(-4, 5)) % 256


def cut(data: bytearray, rng: random.Random) -> None:
    """The end is missing."""
    del data[rng.randrange(len(data) + 1) :]


def leave_out(data: bytearray, rng: random.Random) -> None:
    """A part is missing."""
    start, end = part(data, rng)
    del data[start:end]


def repeat(data: bytearray, rng: random.Random) -> None:
    """A part stands there several times."""
    start, end = part(data, rng)
    data[start:start] = data[start:end] * rng.choice((1, 1, 2, 20))


def insert(data: bytearray, rng: random.Random) -> None:
    """Some bytes more."""
    place = rng.randrange(len(data) + 1)
    data[place:place] = rng.randbytes(rng.choice((1, 1, 4, 40)))


def splice(data: bytearray, rng: random.Random) -> None:
    """A part is overwritten by another."""
    start, end = part(data, rng)
    place = rng.randrange(len(data) + 1)
    data[place : place + end - start] = data[start:end]


def part(data: bytearray, rng: random.Random) -> tuple[int, int]:
    """Start and end of some part, rather a short one."""
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.choice((1, 4, 16, 64, 400)))


def put_word(data: bytearray, rng: random.Random, words: Sequence[bytes]) -> None:
    """A word, in place of something or between."""
    place = rng.randrange(len(data) + 1)
    data[place : place + rng.choice((0, 0, 1, 4))] = rng.choice(words)


CHANGES = (
    flip_bit,
    set_byte,
    set_number,
    add_to_number,
    cut,
    leave_out,
    repeat,
    insert,
    splice,
)
