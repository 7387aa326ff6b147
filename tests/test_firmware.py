"""Tests of the reference sender in C: it sends what the Python codec encodes."""

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
STRICT = "-std=c99 -Wall -Wextra -Werror -pedantic".split()
SANITIZERS = "-g -fsanitize=address,undefined -fno-sanitize-recover=all".split()
EMPTY = "int main(void) { return 0; }\n"

pytestmark = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler: cc, gcc, clang"
)


def run_program(*words, given=b""):
    done = subprocess.run(words, input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def sanitizers_work(folder):
    (folder / "empty.c").write_text(EMPTY)
    try:
        run_program(COMPILER, *SANITIZERS, folder / "empty.c", "-o", folder / "empty")
        run_program(folder / "empty")
    except AssertionError:
        return False
    return True


@pytest.fixture(scope="module", params=[(), SANITIZERS], ids=["plain", "sanitizers"])
def compile_program(request, tmp_path_factory):
    """Return a function that compiles a program, and returns its path."""
    folder = tmp_path_factory.mktemp("firmware")
    if request.param and not sanitizers_work(folder):
        pytest.skip("the C compiler has no address and undefined sanitizers")

    def compile_program(main, *options):
        program = folder / main.stem
        sources = [main, FIRMWARE / "eskin_patch.c"]
        options = [*STRICT, *request.param, *options, f"-I{FIRMWARE}"]
        run_program(COMPILER, *options, *sources, "-o", program)
        return program

    return compile_program


@pytest.fixture(scope="module")
def send(compile_program):
    """Return a function that gives the packets and frames of some lines of text."""
    program = compile_program(ROOT / "tests/data/vectors_main.c")

    def send(lines):
        out = run_program(program, given="\n".join([*lines, ""]).encode()).decode()
        return [tuple(map(bytes.fromhex, line.split())) for line in out.splitlines()]

    return send


def format_vector(vector):
    """Return a packet as the program reads it."""
    fields = dict(vector["fields"])
    counts = fields.pop("counts", None)
    if counts is not None:
        fields["count"] = len(counts)
    if "firmware" in fields:
        fields["firmware"] = f"[{fields['firmware']}]"
    return " ".join(map(str, [vector["kind"][0], *fields.values(), *(counts or ())]))


def test_sender_makes_the_vectors(send):
    vectors = VECTORS["vectors"]
    for vector, made in zip(vectors, send(map(format_vector, vectors)), strict=True):
        assert [data.hex() for data in made] == [vector["packet"], vector["framed"]]


def test_any_counts_are_sent(send):
    rng, wanted = random.Random(1), []
    for _ in range(400):
        share, size = rng.random(), rng.choice([0, 1, 120, 128, 254, 691])
        wanted.append(
            [
                0 if rng.random() < share**8 else rng.randint(0, 65535)
                for _ in range(size)
            ]
        )
    deframer = Deframer()
    lines = (f"d 1 2 0 0 {len(row)} {' '.join(map(str, row))}" for row in wanted)
    for counts, (_, framed) in zip(wanted, send(lines), strict=True):
        [packet] = deframer.push(framed)
        assert decode_packet(packet).counts.tolist() == counts
    assert (deframer.frames, deframer.broken) == (400, 0)


def test_long_firmware_name_is_cut_before_a_character(send):
    names = {"ü" * 128: 127, "a" * 300: 255, "a" * 255: 255}
    made = send(f"h 1 2 3 4 5 6 7 8 [{name}]" for name in names)
    for (name, kept), (packet, _) in zip(names.items(), made, strict=True):
        assert decode_packet(packet).firmware == name[:kept]


@pytest.mark.parametrize("size", [1400, 286])
def test_example_sends_its_matrix_in_complete_scans(compile_program, size):
    program = compile_program(
        FIRMWARE / "example_main.c", f"-DESKIN_PACKET_BYTES={size}"
    )
    deframer = Deframer()
    packets = [*map(decode_packet, deframer.push(run_program(program, "120")))]
    assert deframer.broken == 0 and not deframer.open
    hello = packets[0]
    assert (hello.rows, hello.columns, hello.taxels) == (30, 40, 30 * 40 - 36)
    assert (hello.address, hello.rate, hello.firmware) == (4, 50, "example 1.0")
    kinds = [type(packet) for packet in packets]
    assert (kinds.count(Hello), kinds.count(Status)) == (3, 3)
    data = [packet for packet in packets if isinstance(packet, Data)]
    row, column = np.divmod(np.arange(30 * 40), 40)
    there = ((row >= 3) & (row < 27)) | ((column >= 3) & (column < 37))
    for number in range(120):
        parts = [part for part in data if part.scan == number + 1]
        assert {part.device_time for part in parts} == {20_000 * number}
        ends = np.cumsum([len(part.counts) for part in parts])
        assert [part.first for part in parts] == [0, *ends[:-1]]
        counts = np.concatenate([part.counts for part in parts])
        expected = ((100 * row + column + number) % 4096)[there]
        np.testing.assert_array_equal(counts, expected)
    assert [part.scan for part in data] == sorted(part.scan for part in data)
