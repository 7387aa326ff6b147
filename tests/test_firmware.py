"""Tests of the reference sender in C: it sends what the Python codec encodes."""

import json
import random
import shutil
import subprocess
import zlib
from hashlib import blake2s
from pathlib import Path

import numpy as np
import pytest

from eskin.drivers import (
    Data,
    Deframer,
    Echo,
    Hello,
    HostSessions,
    ManualClock,
    Status,
    decode_packet,
    encode_frame,
)
from eskin.drivers.packet import END
from helpers.touch import SECOND

ROOT = Path(__file__).parents[1]
FIRMWARE = ROOT / "firmware"
VECTORS = json.loads((ROOT / "tests/data/protocol_v1.json").read_text("utf-8"))
SEALED = json.loads((ROOT / "tests/data/protocol_v2.json").read_text("utf-8"))
KEY = bytes(range(32))
ABC = "508c5e8c327c14e2e1a72ba34eeb452f37458b209ed63a294d999b4c86675982"
"""BLAKE2s-256 of `abc`, RFC 7693, appendix B."""
KEYED = {
    0: "48a8997da407876b3d79c0d92325ad3b89cbb754d86ab71aee047ad345fd2c49",
    1: "40d15fee7c328830166ac3f918650f807e7e01e177258cdc0a39b11f598066f1",
}
"""The first of the reference vectors: key 0 to 31, that many bytes 0, 1, ..."""
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
    """Return a packet as the program reads it, in one or two lines."""
    fields = dict(vector["fields"])
    if "seal" in vector:
        return f"{format_session(vector['seal'])} {format_fields(vector, fields)}"
    return format_fields(vector, fields)


def format_session(seal):
    """Return version, counter, key and challenge as the program reads them."""
    if seal is None:
        return "v 2 0 - -"
    challenge = seal["challenge"] if seal["challenge"].strip("0") else "-"
    return f"v 2 {seal['counter']} {seal['key']} {challenge}"


def format_fields(vector, fields):
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


def test_sender_makes_the_vectors_of_version_2(send):
    # Requests are made by the host alone.
    vectors = [v for v in SEALED["vectors"] if v["kind"] != "request"]
    for vector, made in zip(vectors, send(map(format_vector, vectors)), strict=True):
        assert [data.hex() for data in made] == [vector["packet"], vector["framed"]]


def test_blake2s_agrees_with_the_vectors_of_its_authors(send):
    content = [bytes(n % 256 for n in range(length)) for length in (*range(256), 511)]
    lines = [f"b {KEY.hex()} {part.hex() or '-'}" for part in content]
    found = [digest.hex() for (digest,) in send(["b - 616263", *lines])]
    assert found[0] == ABC
    assert {length: found[1 + length] for length in KEYED} == KEYED
    assert found[1:] == [blake2s(part, key=KEY).hexdigest() for part in content]


class Patch:
    """The sender in a process of its own, on a line to a host with a key."""

    def __init__(self, program, *words):
        pipes = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
        self.process = subprocess.Popen([program, *words], **pipes, text=True)
        self.deframer = Deframer()

    def call(self, line):
        """Give the program a line; return the packets that it sends."""
        print(line, file=self.process.stdin, flush=True)
        framed = bytes.fromhex(self.process.stdout.readline())
        return self.deframer.push_chunk(framed)

    def receive(self, packet):
        return self.call(f"r {(END + encode_frame(packet)).hex()}")


@pytest.fixture
def start_patch(compile_program):
    """Return a function that starts a patch, with a key or without."""
    program = compile_program(ROOT / "tests/data/session_main.c")
    started = []

    def start(*words):
        started.append(Patch(program, *words))
        return started[-1]

    yield start
    for patch in started:
        patch.process.stdin.close()
        patch.process.stdout.close()
        assert patch.process.wait(10) == 0


def judge_all(host, packets, now):
    """Return what a host thinks of packets, and the requests that it then sends."""
    verdicts = [
        host.authenticate(decode_packet(data), data, now, "line").refused
        for data in packets
    ]
    return verdicts, [packet for _, packet in host.take_requests(now)]


def test_patch_with_key_opens_a_session_and_ends_it_without_requests(start_patch):
    patch = start_patch("key")
    clock = ManualClock(SECOND)
    host = HostSessions([0], clock, KEY)
    assert patch.call("s") == []
    verdicts, (opening,) = judge_all(host, patch.call("h"), SECOND)
    assert verdicts == ["held"]
    forged = bytearray(opening)
    forged[-5] ^= 1
    assert patch.receive(reseal(forged)) == []
    hello, echo = patch.receive(opening)
    assert isinstance(decode_packet(echo), Echo)
    assert judge_all(host, [hello, echo], SECOND) == ([None, None], [])
    patch.call("t 400000")
    _, (ping,) = judge_all(host, patch.call("s"), 2 * SECOND)
    (echo,) = patch.receive(ping)
    assert decode_packet(echo).device_time == 400_000
    assert host.authenticate(decode_packet(echo), echo, 0, "line").sent == clock.now()
    # A recorded request is not answered; a session ends 2 s after the last one.
    assert patch.receive(ping) == []
    patch.call("t 2400000")
    assert len(patch.call("s")) == 1
    patch.call("t 2400001")
    assert patch.call("s") == []
    (hello,) = patch.call("h")
    # The host does not know yet that its session is over, and goes on with it.
    verdicts, (ping, opening) = judge_all(host, [hello], 3 * SECOND)
    assert verdicts == ["held"] and patch.receive(ping) == []
    assert len(patch.receive(opening)) == 2


def test_patch_without_key_answers_with_its_clock(start_patch):
    patch = start_patch()
    host = HostSessions([0], ManualClock(SECOND))
    verdicts, (opening,) = judge_all(host, patch.call("h"), SECOND)
    assert verdicts == [None] and len(patch.call("s")) == 1
    (echo,) = patch.receive(opening)
    assert judge_all(host, [echo], SECOND)[0] == [None]
    packet = decode_packet(echo)
    assert packet == Echo(0, 1, 0, 0, host.sessions[0][0].challenge, 0)


def reseal(packet):
    """Return a packet with the CRC of what it holds now."""
    return bytes(packet[:-4]) + zlib.crc32(packet[:-4]).to_bytes(4, "little")


def test_any_counts_are_sent(send):
    rng = random.Random(1)
    wanted = []
    for _ in range(400):
        share = rng.random()
        size = rng.choice([0, 1, 120, 128, 254, 691])
        wanted.append(
            [
                0 if rng.random() < share**8 else rng.randint(0, 65535)
                for _ in range(size)
            ]
        )
    deframer = Deframer()
    lines = (f"d 1 2 0 0 {len(row)} {' '.join(map(str, row))}" for row in wanted)
    for counts, (_, framed) in zip(wanted, send(lines), strict=True):
        [packet] = deframer.push_chunk(framed)
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
    packets = [*map(decode_packet, deframer.push_chunk(run_program(program, "120")))]
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
