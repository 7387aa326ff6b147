"""Make the test vectors of protocol version 1 anew.

    python tests/data/make_protocol_v1.py

Every vector is one packet: its fields, its bytes in hex, and the same framed for a
serial line with its closing zero. Firmware in any language can be held to them.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np

from eskin.drivers import encode_frame
from eskin.drivers.packet import MAX_COUNTS, Data, Hello, Packet, Status, encode_packet

FILE = Path(__file__).with_name("protocol_v1.json")
ABOUT = (
    "eskin device protocol, version 1; see docs/protocol.md; "
    "made by tests/data/make_protocol_v1.py"
)


def packets() -> dict[str, Packet]:
    """The packets by name; those of docs/protocol.md come first."""
    return {
        "hello": Hello(4, 7, 1_000_000, 3, 4, 10, 50, 0x1122334455667788, "demo 1.0"),
        "data": Data(4, 8, 1_020_000, 0, counts(0, 1, 256, 4095, 513)),
        "status": Status(4, 8, 1_021_000, 2, 0, 3125),
        "hello, all zero": Hello(0, 0, 0, 0, 0, 0, 0, 0, ""),
        "hello, all largest": Hello(
            address=65535,
            scan=65535,
            device_time=2**32 - 1,
            rows=65535,
            columns=65535,
            taxels=65535,
            rate=65535,
            serial_number=2**64 - 1,
            firmware="ü" * 127 + "!",
        ),
        "data, no counts": Data(9, 1, 2, 3, counts()),
        "data, all zero": Data(0, 0, 0, 0, counts(*[0] * 20)),
        "data, most counts, all zero": Data(1, 2, 3, 4, counts(*[0] * MAX_COUNTS)),
        "data, most counts, no zero": Data(
            0x0101, 0x0202, 0x01020304, 0x0303, counts(*[0xFFFF] * MAX_COUNTS)
        ),
        "data, run of 253": one_run(253),
        "data, run of 254": one_run(254),
        "data, run of 255": one_run(255),
        "data, ends in a run of 254": Data(1, 1, 1, 0, counts(0, *[0x0101] * 125)),
        "data, last part of a scan": Data(4, 8, 1_020_000, 691, counts(4095, 0, 7)),
        "data, zero and nonzero runs": Data(
            513, 514, 515, 1, counts(*([0x0100] * 130 + [0] * 3 + [0x0101] * 300))
        ),
        "status, all largest": Status(
            65535, 65535, 2**32 - 1, 2**32 - 1, 2**32 - 1, 32767
        ),
        "status, no temperature": Status(4, 65535, 2**32 - 1, 0, 3, -32768),
    }


def counts(*values: int) -> np.ndarray:
    """Counts as a packet holds them."""
    return np.array(values, np.uint16)


def one_run(length: int) -> Data:
    """A packet whose longest run without a zero byte is in its counts, that long."""
    whole, odd = divmod(length, 2)
    half = [0x0100] if odd else []
    return Data(0, 0, 0, 0, counts(0, *half, *[0x0101] * whole, 0, 5))


def vector(name: str, packet: Packet) -> dict[str, object]:
    """One entry of the file."""
    fields = dataclasses.asdict(packet)
    if isinstance(packet, Data):
        fields["counts"] = packet.counts.tolist()
    if isinstance(packet, Hello):
        fields["serial_number"] = f"{packet.serial_number:016x}"
    data = encode_packet(packet)
    return {
        "name": name,
        "kind": type(packet).__name__.lower(),
        "fields": fields,
        "packet": data.hex(),
        "framed": encode_frame(data).hex(),
    }


def text() -> str:
    """The whole file; one vector a line."""
    lines = ",\n".join(json.dumps(vector(*item)) for item in packets().items())
    return f'{{"about": {json.dumps(ABOUT)},\n"vectors": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8", newline="\n")
