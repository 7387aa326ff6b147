"""Tests of devices with drivers of their own: nothing crashes, nothing old is used."""

import contextlib
import json
import os
import random
import time
import tty
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from operator import xor
from pathlib import Path
from threading import Event as Flag
from threading import Thread, Timer

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from eskin.app import SourceConfig, open_source
from eskin.cli.run import RunCommand, check_options
from eskin.cli.terminal import TerminalPrinter
from eskin.drivers import (
    FixedJoints,
    ManualClock,
    PatchSample,
    SampleDevice,
    SampledSource,
)
from eskin.drivers.csv_matrix import CsvMatrix
from eskin.drivers.shear_modules import ShearModules
from eskin.errors import DeviceError
from eskin.recording import read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin, Patch, Plane, TaxelGrid, build_skin, save_skin
from helpers.cli import call_json
from helpers.devices import calibration_of, mounted_small, small_skin

pytestmark = pytest.mark.slow

ROWS = 6
COLUMNS = 5
RATE = 100
MS = 1_000_000
SECOND = 1_000_000_000


def matrix_skin(kind="pressure"):
    """Build one patch on a table."""
    patch = Patch("pad", "table", 1, ROWS, COLUMNS, kind)
    return build_skin(
        "pad", [(patch, TaxelGrid(ROWS, COLUMNS, 0.01, 0.01), Plane(np.eye(4)))]
    )


def format_line(counts, time=None, checksum=False):
    text = (
        ",".join(map(str, counts))
        if time is None
        else f"@{time}," + ",".join(map(str, counts))
    )
    if checksum:
        text += f"*{reduce(xor, text.encode(), 0):02X}"
    return text.encode() + b"\n"


class Pad:
    """A matrix at a pseudo-terminal whose counts tell when they were sent."""

    def __init__(self, folder, timed):
        self.path = folder / "port"
        self.timed = timed
        # The first count of `encode_time` goes on as a time does.
        self.uri = f"csv:{self.path},time={'us' if timed else 'none'}"
        self.plug()

    def plug(self):
        self.host, self.device = os.openpty()
        tty.setraw(self.host)
        tty.setraw(self.device)
        os.set_blocking(self.host, False)
        self.path.symlink_to(os.ttyname(self.device))

    def unplug(self):
        self.path.unlink()
        os.close(self.device)
        os.close(self.host)

    def write(self, data):
        with contextlib.suppress(BlockingIOError):
            os.write(self.host, data)

    def send(self, now, number):
        counts = encode_time(now, number)
        time = now // 1000 % 2**32 if self.timed else None
        self.write(format_line(counts, time, self.timed))

    def disturb(self, rng):
        """Send noise, then the end of a line."""
        self.write(rng.randbytes(rng.randrange(1, 40)) + b"\n")

    def close(self):
        self.unplug()


class Modules:
    """A server of one shear module whose counts tell when they were sent."""

    def __init__(self, folder, timed):
        self.number = 0
        self.port = 0
        self.plug()
        self.port = self.server.socket.getsockname()[1]
        self.uri = f"xela://127.0.0.1:{self.port}"

    def plug(self):
        self.clients = []
        self.server = serve(self.greet, "127.0.0.1", self.port)
        self.thread = Thread(target=self.server.serve_forever)
        self.thread.start()

    def greet(self, client):
        client.send(json.dumps({"message": "Welcome", "sensors": 1}))
        self.clients.append(client)
        with contextlib.suppress(ConnectionClosed):
            for _ in client:
                pass

    def unplug(self):
        self.server.shutdown()
        for client in self.clients:
            client.close()
        self.thread.join()
        self.number = 0

    def write(self, text):
        for client in self.clients:
            with contextlib.suppress(ConnectionClosed):
                client.send(text)

    def send(self, now, number):
        self.number += 1
        self.write(format_message(self.number, now, encode_time(now, number)))

    def disturb(self, rng):
        """Send a message of which a part is replaced by noise."""
        text = format_message(self.number + 1, time.time_ns(), [7] * 30)
        at = rng.randrange(len(text))
        self.write(text[:at] + str(rng.randbytes(3)) + text[at + 9 :])

    def close(self):
        self.unplug()


def encode_time(now, number):
    """Return counts of which the first two go on as a time [ns], the next a number."""
    ms = now // MS
    rest = [20] * (ROWS * COLUMNS - 3)
    return [ms % 10_000, ms // 10_000 % 10_000, number, *rest]


def format_message(number, now, counts, **changes):
    words = [f"{v:04X}" for z in counts for v in (32_768 + 5, 32_768 - 7, z)]
    module = {"sensor": "1", "taxels": len(counts), "data": ",".join(words)}
    whole = {"message": number, "time": now / SECOND, "sensors": 1, "1": module}
    module.update(changes)
    return json.dumps(whole)


def play(device, seconds, begun, stop):
    """Send at the rate, with noise; once begun, unplug in the second quarter."""
    rng = random.Random(0)
    begin = time.monotonic()
    first = float("inf")
    plugged = True
    count = 0
    while not stop.is_set():
        if begun.is_set():
            first = min(first, time.monotonic())
        away = 0.25 <= (time.monotonic() - first) / seconds < 0.5
        if away == plugged:
            device.unplug() if away else device.plug()
            plugged = not away
        if plugged:
            device.send(time.time_ns(), count)
            if count % 10 == 0:
                device.disturb(rng)
        count += 1
        stop.wait(max(0.0, begin + count / RATE - time.monotonic()))
    if not plugged:
        device.plug()


def run_device(kind, timed, seconds, tmp_path, capsys, monkeypatch):
    """Record a device through `eskin run`; return its result and recording."""
    begun = Flag()
    start = TerminalPrinter.start

    def note_start(printer, context):
        start(printer, context)
        begun.set()

    monkeypatch.setattr(TerminalPrinter, "start", note_start)
    skin = matrix_skin("shear" if kind is Modules else "pressure")
    save_skin(skin, tmp_path / "skin")
    device = kind(tmp_path, timed)
    stop = Flag()
    thread = Thread(target=play, args=(device, seconds, begun, stop))
    thread.start()
    words = ["--skin", tmp_path / "skin", "--robot-urdf", "table", "--seconds", seconds]
    words += ["--record", tmp_path / "kept.mcap", "--source", device.uri]
    try:
        result, out = call_json(capsys, "run", *words)
    finally:
        stop.set()
        thread.join()
        device.close()
    return result, out, read_recording(tmp_path / "kept.mcap")


DEVICES = [(Pad, False), (Pad, True), (Modules, True)]
NAMES = ["bare", "timed", "modules"]


@pytest.mark.parametrize("seconds", [3, pytest.param(60, marks=pytest.mark.long)])
@pytest.mark.parametrize(("kind", "timed"), DEVICES, ids=NAMES)
def test_device_is_read_unplugged_and_read_again(
    kind, timed, seconds, tmp_path, capsys, monkeypatch
):
    given = (tmp_path, capsys, monkeypatch)
    result, out, recording = run_device(kind, timed, seconds, *given)
    scans = list(recording.scans())
    heard = [scan for scan in scans if scan.received.any()]
    assert result["readings"] == len(scans) and result["source"]["damaged"] > 0
    # Nothing old is given as new: no data twice, none while it was away.
    assert all(b.counts[2] > a.counts[2] for a, b in pairwise(heard))
    assert 0 < len(heard) < len(scans)
    assert "is gone" in out or "no longer sends" in out
    assert "again" in out or "is back" in out
    if kind is Modules:
        assert all((scan.shear == (5, -7)).all() for scan in heard)


class Script(SampleDevice):
    """Gives samples when they are due, and is gone in between where it should be."""

    def __init__(self, clock, events):
        self.clock = clock
        self.events = sorted(events, key=lambda event: event[0])
        self.open = False

    def connect(self):
        if self.events and self.events[0][1] == "gone":
            if self.clock.now() < self.events[0][2]:
                raise OSError("not there")
            self.events.pop(0)
        self.open = True

    def receive(self, timeout):
        assert self.open
        due = self.events[0][0] if self.events else self.clock.now() + SECOND
        self.clock.sleep(min(timeout, max(0.0, (due - self.clock.now()) / SECOND)))
        if self.clock.now() < due:
            return []
        if self.events[0][1] == "gone":
            raise OSError("pulled")
        return [self.events.pop(0)[1]]

    def disconnect(self):
        self.open = False

    def counters(self):
        return {"bytes": 5 * (self.clock.now() >= 3 * SECOND)}


def sample(patch, stamp, value, age=0):
    size = len(small_skin().find_taxels(small_skin().patches[patch].id))
    counts = np.full(size, value, np.int32)
    return stamp + age, PatchSample(patch, stamp, counts)


def read_script(events, count, rate=50.0, patience=0.0):
    """Return the first scans of a scripted device, and its source."""
    clock = ManualClock(SECOND)
    source = SampledSource(
        Script(clock, events),
        mounted_small(),
        calibration_of(small_skin()),
        FixedJoints(np.zeros(0)),
        clock,
        "test:",
        rate,
        patience,
    )
    return [source.read() for _ in range(count)], source


def patches_of(scan):
    """Return the value of each patch that was received."""
    skin = small_skin()
    taxels = {p.id: skin.find_taxels(p.id) for p in skin.patches}
    return {
        name: int(scan.counts[places[0]])
        for name, places in taxels.items()
        if scan.received[places].all()
    }


def test_samples_of_all_patches_become_one_scan():
    names = [patch.id for patch in small_skin().patches]
    events = [
        sample(patch, SECOND + period * 20 * MS + patch * MS, 10 * period + patch)
        for period in range(1, 9)
        for patch in range(3)
    ]
    scans, _ = read_script(events, 12)
    values = [patches_of(scan) for scan in scans if scan.received.any()]
    # Until all three are known, what has come counts alone.
    for period in range(3, 9):
        whole = {name: 10 * period + patch for patch, name in enumerate(names)}
        assert whole in values
    assert all(b.stamp > a.stamp for a, b in pairwise(scans))


def test_patch_that_stops_is_not_received_and_the_others_go_on():
    events = [
        sample(patch, SECOND + period * 20 * MS, period)
        for period in range(1, 40)
        for patch in range(3)
        if patch != 1 or period < 10
    ]
    scans, source = read_script(events, 40)
    values = [patches_of(scan) for scan in scans]
    assert all("middle" not in value or value["middle"] < 10 for value in values)
    assert values[-1] == {"left": 39, "right": 39} or values[-1].keys() <= {
        "left",
        "right",
    }
    assert [e.kind for e in source.take_events() if e.patch == "middle"] == [
        "appeared",
        "silent",
    ]


def test_sample_that_is_old_is_not_used():
    events = [sample(0, SECOND + n * 20 * MS, n) for n in range(1, 35)]
    events.append(sample(0, SECOND + 100 * MS, 999, age=550 * MS))
    scans, source = read_script(events, 35)
    assert all(999 not in patches_of(scan).values() for scan in scans)
    assert source.counters()["late"] == 1


def test_patch_whose_samples_are_all_too_old_becomes_silent():
    """Only what lay unread on this computer shows that a patch still sends."""
    events = [sample(0, SECOND + n * 20 * MS, n) for n in range(1, 150)]
    events += [
        sample(1, SECOND + n * 20 * MS, n, age=0 if n < 50 else 600 * MS)
        for n in range(1, 150)
    ]
    _, source = read_script(sorted(events, key=lambda one: one[0]), 140)
    kinds = [event.kind for event in source.take_events() if event.patch == "middle"]
    assert sorted(kinds) == ["appeared", "late", "silent"]


def test_events_tell_all_that_was_refused_and_the_latest_cause_at_the_end():
    events = [sample(0, SECOND + n * 20 * MS, n) for n in range(1, 400)]
    _, source = read_script(events, 2)
    given = [1, 20, 300]
    refused = [(count, f"cause {count}") for count in given]
    source.device.take_refused = lambda: refused.pop(0) if refused else (0, "")
    while refused:
        source.read()
    told = [event for event in source.take_events() if event.kind == "damaged"]
    told += [event for event in source.take_last_events() if event.kind == "damaged"]
    assert sum(int(event.text.split()[0]) for event in told) == sum(given)
    assert told[0].text.startswith("1 message could not be read; the last: cause 1")
    assert "cause 300" in told[-1].text


def test_stamps_increase_whatever_a_device_states():
    times = (20, 40, 40, 30, 60)
    events = [sample(0, SECOND + ms * MS, n) for n, ms in enumerate(times)]
    scans, _ = read_script(events, 5)
    assert all(b.stamp > a.stamp for a, b in pairwise(scans))
    assert [patches_of(scan).get("left") for scan in scans] == [0, 3, 1, 2, 4]


def test_device_that_is_gone_gives_scans_without_data_until_it_is_back():
    away = (SECOND + 210 * MS, "gone", 2 * SECOND)
    events = [
        sample(0, SECOND + n * 20 * MS, n) for n in (*range(1, 11), *range(60, 90))
    ]
    scans, source = read_script([*events, away], 70)
    heard = [scan for scan in scans if scan.received.any()]
    values = [patches_of(scan)["left"] for scan in heard]
    assert values == sorted(set(values)) and {10, 60} <= set(values)
    assert 30 < sum(not scan.received.any() for scan in scans) < 60
    kinds = [event.kind for event in source.take_events() if event.patch is None]
    assert kinds == ["silent", "returned"]


def test_device_that_sends_no_byte_is_waited_for_no_longer_than_said():
    with pytest.raises(DeviceError, match=r"test: sent no byte within 1\.5 s; allowed"):
        read_script([], 0, patience=1.5)
    _, source = read_script([], 0, patience=2.5)
    assert 3 * SECOND <= source.clock.now() < 3.1 * SECOND


@pytest.mark.parametrize("data", [b"", b"?"])
def test_matrix_has_sent_once_any_byte_has_come(tmp_path, data):
    pad = Pad(tmp_path, timed=False)
    skin = matrix_skin()
    config = SourceConfig(skin=skin, robot="table", rate=50.0, patience=0.3)
    with contextlib.closing(pad):
        Timer(0.1, pad.write, [data]).start()
        if data:
            open_source(pad.uri, config=config).close()
            return
        with pytest.raises(DeviceError, match=r"port\S* sent no byte within 0\.3"):
            open_source(pad.uri, config=config)


class Wire:
    """Stands for a serial port whose buffer holds what was not read yet."""

    def __init__(self, path, baud, deframer):
        self.deframer = deframer
        self.data = b"\n"
        self.line = self

    def fileno(self):
        return 7

    def retry(self, now):
        return False

    def read(self):
        data = self.data
        self.data = b""
        return self.deframer.push_chunk(data)

    def close(self):
        self.line = None


@pytest.mark.parametrize("timed", [False, True], ids=["bare", "timed"])
@pytest.mark.parametrize("overflows", [False, True])
def test_lines_that_lay_unread_are_told_as_the_lag_of_the_computer(
    monkeypatch, timed, overflows
):
    """The cable is not blamed, even where the buffer of the port has cut lines."""
    monkeypatch.setattr("eskin.drivers.csv_matrix.SerialPort", Wire)
    monkeypatch.setattr(
        "eskin.drivers.csv_matrix.select.select",
        lambda files, *_: (files if wire.data else [], [], []),
    )
    clock = ManualClock(SECOND)
    skin = matrix_skin()
    path = f"port,time={'us' if timed else 'none'}"
    device = CsvMatrix(clock, [path], skin, 115_200)
    source = SampledSource(
        device,
        MountedSkin(skin, load_robot("table")),
        calibration_of(skin),
        FixedJoints(np.zeros(0)),
        clock,
        f"csv:{path}",
        50.0,
    )
    [wire] = device.ports

    def send(numbers, is_read):
        for number in numbers:
            clock.sleep(0.02)
            time = clock.now() // 1000 if timed else None
            wire.data += format_line(encode_time(clock.now(), number), time, timed)
            if is_read:
                source.read(0.0)

    send(range(60), True)
    assert [event.kind for event in source.take_events()] == ["appeared"]
    used = device.counters()["samples"]
    send(range(60, 160), False)
    if overflows:
        wire.data += b"5,7\n,,8x;2\n"
    send(range(160, 220), True)
    [event] = source.take_events()
    assert event.kind == "late"
    assert "lay unread, as this computer was busy for 2.0 s; stop" in event.text
    assert device.counters()["samples"] > used + 50
    source.close()


def test_module_that_the_server_repeats_is_not_received_again():
    clock = ManualClock(SECOND)
    device = ShearModules(clock, "ws://127.0.0.1:1", matrix_skin("shear"))
    found = []
    for number in range(1, 40):
        clock.sleep(0.01)
        taken = min(number, 30)
        text = format_message(number, clock.now(), [number] * 30, time=taken)
        found += device.parse(text, clock.now())
    assert [int(one.counts[0]) for one in found] == list(range(31 - len(found), 31))
    assert len(found) > 15 and device.counters()["repeated"] == 9


def parse_messages(changes):
    """Return samples of messages with changes, and what is told of those not read."""
    clock = ManualClock(SECOND)
    device = ShearModules(clock, "ws://127.0.0.1:1", matrix_skin("shear"))
    found = []
    for number in range(1, 30):
        clock.sleep(0.01)
        text = format_message(number, clock.now(), [20 + number] * 30)
        found += device.parse(json.dumps(changes(json.loads(text))), clock.now())
    return found, device.take_refused()


WORDS = {
    "numbers of the message as texts": lambda m: (
        m | {"message": str(m["message"]), "time": str(m["time"])}
    ),
    "list of texts": lambda m: change_data(m, lambda words: words),
    "list of numbers": lambda m: change_data(m, lambda words: to_numbers(words)),
    "decimal numbers": lambda m: change_data(
        m, lambda words: ",".join(map(str, to_numbers(words)))
    ),
    "too few numbers": lambda m: change_data(m, lambda words: ",".join(words[1:])),
    "fractions": lambda m: change_data(m, lambda words: [0.5] * len(words)),
    "no data": lambda m: m | {"1": {"sensor": "1"}},
}


def to_numbers(words):
    return [int(word, 16) for word in words]


def change_data(message, change):
    return message | {
        "1": message["1"] | {"data": change(message["1"]["data"].split(","))}
    }


@pytest.mark.parametrize("changes", WORDS.values(), ids=WORDS)
def test_counts_of_modules_are_read_rightly_or_refused_with_a_reason(changes):
    found, (refused, why) = parse_messages(changes)
    assert {int(one.counts[0]) for one in found} <= {20 + n for n in range(1, 30)}
    assert all((one.shear == [[5, -7]] * 30).all() for one in found)
    assert len(found) > 15 or (refused == 29 and "; allowed are messages" in why)
    is_unclear = changes in [*WORDS.values()][3:]
    assert bool(found) != is_unclear and (not is_unclear or "\n" not in why)


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_no_message_of_a_server_raises(data):
    device = ShearModules(ManualClock(), "ws://127.0.0.1:1", matrix_skin("shear"))
    text = format_message(1, SECOND, [20] * 30)
    at = data.draw(st.integers(0, len(text)))
    noise = data.draw(st.text(max_size=5))
    device.parse(text[:at] + noise + text[at + len(noise) :], SECOND)
    device.parse(json.dumps(data.draw(JSON)), SECOND)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["message", "time", "1", "data"]), inner)
    ),
    max_leaves=6,
)


def test_server_of_modules_commands_no_real_robot_unless_allowed():
    command = RunCommand(
        ("xela://127.0.0.1:5000",), robot="ur://127.0.0.1", ask=("terminal",)
    )
    with pytest.raises(DeviceError, match="--allow-unauthenticated"):
        check_options(command)
    check_options(replace(command, allow_unauthenticated=True))
    check_options(replace(command, source=("csv:/dev/ttyACM0",)))
    for uri in ("csv:/dev/ttyACM0", "xela://127.0.0.1:5000"):
        with pytest.raises(DeviceError, match="--key"):
            check_options(RunCommand((uri,), key=Path("key")))
