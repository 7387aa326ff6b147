"""Make the test vectors of protocol version 2 anew.

    python tests/data/make_protocol_v2.py

Every vector is one packet: its fields, the key, challenge and counter of its seal where
it has one, its bytes in hex, and the same framed for a serial line.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np

from eskin.drivers import SessionSeal, encode_frame
from eskin.drivers.packet import (
    MAX_COUNTS,
    MAX_SEALED_COUNTS,
    Data,
    Echo,
    Hello,
    Packet,
    Request,
    Status,
    encode_packet,
)

FILE = Path(__file__).with_name("protocol_v2.json")
ABOUT = (
    "eskin device protocol, version 2; see docs/protocol.md; "
    "made by tests/data/make_protocol_v2.py"
)
KEY = bytes(range(32))
CHALLENGE = bytes(range(0xA0, 0xB0))
NONE = bytes(16)
Seal = tuple[bytes, bytes, int]

U16 = 2**16 - 1
U32 = 2**32 - 1
U64 = 2**64 - 1
HELLO = Hello(4, 7, 1_000_000, 3, 4, 10, 50, 0x1122334455667788, "demo 1.0")
DATA = Data(4, 8, 1_020_000, 0, np.array([0, 1, 256, 4095, 513], np.uint16))
STATUS = Status(4, 8, 1_021_000, 2, 0, 3125)


def packets() -> dict[str, tuple[Packet, Seal | None]]:
    """The packets by name, with their seals; those of docs/protocol.md come first."""
    return {
        "request": (Request(4, 3, CHALLENGE), None),
        "echo": (Echo(4, 8, 1_022_000, 3, CHALLENGE, 150), None),
        "sealed hello": (HELLO, (KEY, NONE, 0)),
        "sealed request": (Request(4, 3, CHALLENGE), (KEY, CHALLENGE, 3)),
        "sealed data": (DATA, (KEY, CHALLENGE, 17)),
        "hello": (HELLO, None),
        "data": (DATA, None),
        "status": (STATUS, None),
        "sealed status": (STATUS, (KEY, CHALLENGE, 18)),
        "sealed echo": (
            Echo(4, 8, 1_022_000, 3, CHALLENGE, 150),
            (KEY, CHALLENGE, 19),
        ),
        "sealed hello in a session": (HELLO, (KEY, CHALLENGE, 2**32)),
        "sealed data, largest counter": (DATA, (KEY[::-1], CHALLENGE, 2**48 - 1)),
        "sealed data, most counts": (
            Data(1, 2, 3, 4, np.arange(MAX_SEALED_COUNTS, dtype=np.uint16)),
            (KEY, CHALLENGE, 20),
        ),
        "data, most counts": (
            Data(1, 2, 3, 4, np.arange(MAX_COUNTS, dtype=np.uint16)),
            None,
        ),
        "sealed data, no counts": (
            Data(9, 1, 2, 3, np.zeros(0, np.uint16)),
            (KEY, b"\xff" * 16, 21),
        ),
        "sealed hello, all largest": (
            Hello(65535, 65535, 2**32 - 1, 65535, 65535, 65535, 65535, 2**64 - 1, "ü"),
            (b"\xff" * 32, b"\xff" * 16, 22),
        ),
    }


def vector(name: str, packet: Packet, seal: Seal | None) -> dict[str, object]:
    """One entry of the file."""
    fields = dataclasses.asdict(packet)
    if isinstance(packet, Data):
        fields["counts"] = packet.counts.tolist()
    if isinstance(packet, Hello):
        fields["serial_number"] = f"{packet.serial_number:016x}"
    if isinstance(packet, Request | Echo):
        fields["challenge"] = packet.challenge.hex()
    data = encode_packet(packet, 2)
    made = None
    if seal is not None:
        key, challenge, counter = seal
        data = SessionSeal(key, challenge).close(data, counter)
        made = {"key": key.hex(), "challenge": challenge.hex(), "counter": counter}
    return {
        "name": name,
        "kind": type(packet).__name__.lower(),
        "fields": fields,
        "seal": made,
        "packet": data.hex(),
        "framed": encode_frame(data).hex(),
    }


def text() -> str:
    """The whole file; one vector a line."""
    made = (vector(name, *item) for name, item in packets().items())
    lines = ",\n".join(map(json.dumps, made))
    return f'{{"about": {json.dumps(ABOUT)},\n"vectors": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8", newline="\n")
