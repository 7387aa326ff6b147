"""The reference sender in C says byte for byte what the Python codec says."""

import json
import random
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from eskin.drivers import Data, Deframer, Hello, Status, decode_packet

ROOT = Path(__file__).parents[1]
FIRMWARE = ROOT / "firmware"
VECTORS = json.loads((ROOT / "tests/data/protocol_v1.json").read_text("utf-8"))
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
CHECKED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

pytestmark = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler: cc, gcc, clang"
)


def compiled(folder, main, *options):
    program = folder / Path(main).stem
    sources = [str(main), str(FIRMWARE / "eskin_patch.c")]
    command = [COMPILER, *STRICT, *options, f"-I{FIRMWARE}", *sources]
    done = subprocess.run(
        [*command, "-o", str(program)], capture_output=True, text=True, check=False
    )
    return program if done.returncode == 0 else pytest.fail(done.stderr)


def sanitizers_work(folder):
    empty = folder / "empty.c"
    empty.write_text("int main(void) { return 0; }\n")
    command = [COMPILER, *CHECKED, str(empty), "-o", str(folder / "empty")]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        return False
    return not subprocess.run([folder / "empty"], check=False).returncode


@pytest.fixture(scope="module", params=["plain", "with sanitizers"])
def build(request, tmp_path_factory):
    """Compiles a program; twice where there are sanitizers."""
    folder = tmp_path_factory.mktemp("firmware")
    checked = request.param != "plain"
    if checked and not sanitizers_work(folder):
        pytest.skip("the C compiler has no address and undefined sanitizers")
    return lambda main, *more: compiled(
        folder, main, *(CHECKED if checked else ()), *more
    )


def said(program, *arguments, given=b""):
    done = subprocess.run(
        [str(program), *arguments], input=given, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def line_of(vector):
    fields = dict(vector["fields"])
    counts = fields.pop("counts", None)
    if counts is not None:
        fields["count"] = len(counts)
    if "firmware" in fields:
        fields["firmware"] = f"[{fields['firmware']}]"
    words = [vector["kind"][0], *fields.values(), *(counts or ())]
    return " ".join(map(str, words))


def test_the_sender_makes_the_vectors(build):
    program = build(ROOT / "tests/data/vectors_main.c")
    lines = "\n".join(map(line_of, VECTORS["vectors"])) + "\n"
    made = said(program, given=lines.encode()).decode().splitlines()
    for vector, line in zip(VECTORS["vectors"], made, strict=True):
        assert line.split() == [vector["packet"], vector["framed"]], vector["name"]


def test_any_packet_is_framed_as_the_decoder_undoes_it(build):
    program = build(ROOT / "tests/data/vectors_main.c")
    rng, wanted, lines = random.Random(1), [], []
    for number in range(400):
        share, size = rng.random(), rng.choice([0, 1, 120, 128, 254, 691])
        counts = [
            0 if rng.random() < share**8 else rng.randint(0, 65535) for _ in range(size)
        ]
        wanted.append(counts)
        lines.append(f"d 1 {number} 0 0 {size} {' '.join(map(str, counts))}\n")
    deframer = Deframer()
    for line in said(program, given="".join(lines).encode()).decode().splitlines():
        (packet,) = deframer.push(bytes.fromhex(line.split()[1]))
        assert (
            decode_packet(packet).counts.tolist() == wanted[decode_packet(packet).scan]
        )
    assert (deframer.frames, deframer.broken) == (400, 0)


def test_a_firmware_that_is_too_long_is_cut_before_a_character(build):
    program = build(ROOT / "tests/data/vectors_main.c")
    for text, kept in (("ü" * 128, 127), ("a" * 300, 255), ("a" * 255, 255)):
        line = f"h 1 2 3 4 5 6 7 8 [{text}]\n"
        packet = decode_packet(
            bytes.fromhex(said(program, given=line.encode()).split()[0].decode())
        )
        assert packet.firmware == text[:kept]


@pytest.mark.parametrize("most", [1400, 286])
def test_the_example_scans_its_matrix_in_whole_scans(build, most):
    program = build(FIRMWARE / "example_main.c", f"-DESKIN_PACKET_BYTES={most}")
    deframer = Deframer()
    packets = [decode_packet(data) for data in deframer.push(said(program, "120"))]
    assert deframer.broken == 0 and not deframer.open
    hello = packets[0]
    assert isinstance(hello, Hello)
    assert (hello.rows, hello.columns, hello.taxels) == (30, 40, 30 * 40 - 36)
    assert (hello.address, hello.rate, hello.firmware) == (4, 50, "example 1.0")
    assert [type(packet) for packet in packets].count(Hello) == 3
    assert [type(packet) for packet in packets].count(Status) == 3
    scans = [packet for packet in packets if isinstance(packet, Data)]
    assert [scan.scan for scan in scans] == sorted(scan.scan for scan in scans)
    cells = [
        (row, column)
        for row in range(30)
        for column in range(40)
        if 3 <= row < 27 or 3 <= column < 37
    ]
    for number in range(120):
        parts = [part for part in scans if part.scan == number + 1]
        assert {part.device_time for part in parts} == {20_000 * number}
        ends = np.cumsum([len(part.counts) for part in parts])
        assert [part.first for part in parts] == [0, *ends[:-1].tolist()]
        counts = np.concatenate([part.counts for part in parts])
        expected = [(100 * row + column + number) % 4096 for row, column in cells]
        assert counts.tolist() == expected
