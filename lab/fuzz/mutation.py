"""Change bytes at random, as transports, disks and people do."""

import random
from collections.abc import Sequence

LARGEST = 1 << 16
"""Greatest size of an input [bytes]."""
EDGES = (0, 1, 2, 127, 128, 255, 256, 32767, 32768, 65535, 2**31, 2**32 - 1, 2**63)


def mutate(data: bytes, rng: random.Random, words: Sequence[bytes] = ()) -> bytes:
    """Return bytes with one to four random changes.

    Args:
        data: valid input.
        rng: random generator.
        words: tokens of the format, which are inserted now and then.
    """
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        rng.choice(CHANGES)(changed, rng)
        if words and rng.random() < 0.5:
            put_word(changed, rng, words)
    return bytes(changed[:LARGEST])


def flip_bit(data: bytearray, rng: random.Random) -> None:
    """Flip one bit."""
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def set_byte(data: bytearray, rng: random.Random) -> None:
    """Set one byte to a random value."""
    if data:
        data[rng.randrange(len(data))] = rng.randrange(256)


def set_number(data: bytearray, rng: random.Random) -> None:
    """Set one to eight bytes to a number near an edge case, as of a length."""
    size = rng.choice((1, 2, 4, 8))
    if len(data) >= size:
        place = rng.randrange(len(data) - size + 1)
        number = rng.choice(EDGES) + rng.randrange(-2, 3)
        whole = (number % 2 ** (8 * size)).to_bytes(size, "little")
        data[place : place + size] = whole


def add_to_number(data: bytearray, rng: random.Random) -> None:
    """Add a small number to a byte."""
    if data:
        place = rng.randrange(len(data))
        data[place] = (data[place] + rng.randrange(-4, 5)) % 256


def cut(data: bytearray, rng: random.Random) -> None:
    """Cut off the end."""
    del data[rng.randrange(len(data) + 1) :]


def leave_out(data: bytearray, rng: random.Random) -> None:
    """Remove a part."""
    start, end = part(data, rng)
    del data[start:end]


def repeat(data: bytearray, rng: random.Random) -> None:
    """Repeat a part."""
    start, end = part(data, rng)
    data[start:start] = data[start:end] * rng.choice((1, 1, 2, 20))


def insert(data: bytearray, rng: random.Random) -> None:
    """Insert random bytes."""
    place = rng.randrange(len(data) + 1)
    data[place:place] = rng.randbytes(rng.choice((1, 1, 4, 40)))


def splice(data: bytearray, rng: random.Random) -> None:
    """Overwrite a part with another."""
    start, end = part(data, rng)
    place = rng.randrange(len(data) + 1)
    data[place : place + end - start] = data[start:end]


def part(data: bytearray, rng: random.Random) -> tuple[int, int]:
    """Return start and end of a random part, most often a short one."""
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.choice((1, 4, 16, 64, 400)))


def put_word(data: bytearray, rng: random.Random, words: Sequence[bytes]) -> None:
    """Insert a token, or overwrite some bytes with it."""
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
