"""The examples of docs/protocol.md are what the codec says."""

import json
import re
from pathlib import Path

import pytest

from eskin.drivers.framing import MAX_FRAME_BYTES
from eskin.drivers.packet import MAX_COUNTS, MAX_PACKET_BYTES, MIN_PACKET_BYTES

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/protocol.md").read_text("utf-8")
VECTORS = json.loads((ROOT / "tests/data/protocol_v1.json").read_text("utf-8"))
EXAMPLES = re.findall(r"Example `(\w+)`(, framed)?:\n\n```\n(.*?)```", PAGE, re.S)


def bytes_of(block):
    """The hex at the start of every line; words come after it."""
    return "".join(
        "".join(re.match(r"(?:[0-9a-f]{2}\s+)+", line + "\n")[0].split())
        for line in block.splitlines()
    )


def test_every_kind_has_an_example_and_one_is_framed():
    names = [(name, bool(framed)) for name, framed, _ in EXAMPLES]
    once = [("hello", False), ("data", False), ("data", True), ("status", False)]
    assert names == once


@pytest.mark.parametrize(("name", "framed", "block"), EXAMPLES)
def test_an_example_is_the_vector_of_its_name(name, framed, block):
    (vector,) = (v for v in VECTORS["vectors"] if v["name"] == name)
    assert bytes_of(block) == vector["framed" if framed else "packet"]


def test_the_page_states_the_limits_of_the_codec():
    assert f"{MIN_PACKET_BYTES} to {MAX_PACKET_BYTES:,} bytes" in PAGE
    assert f"{MAX_FRAME_BYTES:,} bytes and the zero" in PAGE
    assert f"0 to {MAX_COUNTS}" in PAGE
