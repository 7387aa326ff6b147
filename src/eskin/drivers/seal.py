"""This module seals packets of version 2 with a pre-shared key, and checks seals.

A seal stands between the body of a packet and its CRC: the session, a counter, and a
tag, which is the keyed BLAKE2s (RFC 7693) of the session's challenge and all bytes of
the packet before the tag.
"""

import string
import zlib
from hashlib import blake2s
from hmac import compare_digest
from pathlib import Path
from typing import final

from eskin.drivers.packet import (
    CHALLENGE_BYTES,
    CRC,
    MAX_PACKET_BYTES,
    SEAL,
    SEALED,
    VERSION_2,
)
from eskin.errors import DeviceError, PacketError
from eskin.files import read_file

KEY_BYTES = 32
"""Size of a key, the largest that BLAKE2s takes."""
MAX_KEY_FILE = 1000
"""Largest size of a file that may hold a key [bytes]."""
TAG_BYTES = 16
"""Size of a tag: a forger who guesses is right once in 2**128 packets."""
NO_CHALLENGE = bytes(CHALLENGE_BYTES)
"""Challenge of a patch that is in no session."""
SESSION_BITS = 16
"""Bits of the session in the number that holds session and counter."""
SEALED_BYTES = SEAL.size + CRC.size
"""Bytes after the body of a packet with a seal."""
TAG_END = -CRC.size
TAG_START = TAG_END - TAG_BYTES
OTHERS_MAY_READ = 0o077
"""Permissions of a key file that nobody but its owner may have."""


@final
class SessionSeal:
    """Seals the packets of one session, and checks the seals of others.

    Attributes:
        session: first two bytes of the challenge, by which packets name the session.
    """

    def __init__(self, key: bytes, challenge: bytes) -> None:
        """Prepare the seals of a key of 32 bytes and a challenge of 16."""
        self.session = read_session(challenge)
        self.start = blake2s(challenge, digest_size=TAG_BYTES, key=key)

    def compute_tag(self, content: bytes) -> bytes:
        """Return the tag of all bytes of a packet before its tag."""
        state = self.start.copy()
        state.update(content)
        return state.digest()

    def close(self, packet: bytes, counter: int) -> bytes:
        """Return a packet of version 2 with a seal.

        Args:
            packet: packet without a seal, as `encode_packet` returns it.
            counter: number that no other packet of this sender has, below 2**48.

        Raises:
            PacketError: the packet is too long with a seal (`length`).
        """
        if len(packet) + SEAL.size > MAX_PACKET_BYTES:
            raise PacketError(
                f"packet has {len(packet)} bytes; allowed with a seal are "
                f"{MAX_PACKET_BYTES - SEAL.size}; send the scan in several packets",
                "length",
            )
        number = self.session | counter << SESSION_BITS
        start = bytes((packet[0], packet[1] | SEALED))
        content = start + packet[2:TAG_END] + number.to_bytes(8, "little")
        content += self.compute_tag(content)
        return content + CRC.pack(zlib.crc32(content))

    def is_valid(self, packet: bytes) -> bool:
        """Return whether a packet with a seal was made with this key and challenge."""
        tag = self.compute_tag(packet[:TAG_START])
        return compare_digest(tag, packet[TAG_START:TAG_END])


def is_sealed(packet: bytes) -> bool:
    """Return whether a decodable packet has a seal, valid or not."""
    return packet[0] == VERSION_2 and packet[1] >= SEALED


def read_session(challenge: bytes) -> int:
    """Return the number by which packets name the session of a challenge."""
    return int.from_bytes(challenge[: SESSION_BITS // 8], "little")


def read_seal(packet: bytes) -> tuple[int, int]:
    """Return session and counter of a packet with a seal, which is not checked."""
    number, _ = SEAL.unpack_from(packet, len(packet) - SEALED_BYTES)
    return number & ((1 << SESSION_BITS) - 1), number >> SESSION_BITS


def read_key(path: Path) -> bytes:
    """Read a key file: 64 hexadecimal digits that only their owner may read.

    Raises:
        DeviceError: the file cannot be read, is open to others or holds no key.
    """
    try:
        mode, text = path.stat().st_mode, read_file(path, MAX_KEY_FILE).strip()
    except OSError as error:
        raise DeviceError(
            f"key {path} cannot be read ({error.strerror}); allowed is a file of 64 "
            "hexadecimal digits; correct the path"
        ) from error
    if mode & OTHERS_MAY_READ:
        raise DeviceError(
            f"key {path} has mode {mode & 0o777:03o}, so others may use it; allowed is "
            f"600; run chmod 600 {path}, and make a new key if others have read it"
        )
    digits = string.hexdigits.encode()
    if len(text) != 2 * KEY_BYTES or any(digit not in digits for digit in text):
        raise DeviceError(
            f"key {path} holds {len(text)} bytes that are no key; allowed are 64 "
            "hexadecimal digits; make one with openssl rand -hex 32"
        )
    return bytes.fromhex(text.decode())
