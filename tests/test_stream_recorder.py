"""Tests of the recorder: it writes all that it receives, and what it wrote is safe."""

import errno
import io
import os
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from eskin.drivers import Event
from eskin.errors import RecordingError, StreamError
from eskin.live import Detection
from eskin.recording import read_recording, rewrite_recording
from eskin.stream import Correction, Recorder, RecorderConfig, Stream
from eskin.touch import Scan
from helpers.streams import (
    INFO,
    METADATA,
    SECOND,
    START,
    Ear,
    make_scans,
    played,
    same_scans,
)
from lab.soak.kill import kill_often

pytestmark = pytest.mark.slow

SCANS = make_scans(200)
EVENTS = (
    Event(START + SECOND, "silent", "patch 'a' is silent: plug it in", "a"),
    Event(START + 2 * SECOND, "fault", "a row of 'a' is out", "a", 0, None, None),
    Event(START + 3 * SECOND, "slow", "ü"),
)
DETECTION = Detection(
    stamp=START + 2 * SECOND,
    touch=4,
    gesture="poke",
    confidence=0.875,
    onset=START + SECOND,
    end=START + 2 * SECOND,
    link="forearm",
    patch="a",
    p_world=np.array([0.1, 0.2, 0.3]),
    n_world=np.array([0.0, 0.6, 0.8]),
    direction_world=np.zeros(3),
    peak_force=12.5,
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mcap"


def make_recorder(path, free=None, **config):
    config = RecorderConfig(**({"least_free": 0} | config))
    options = {} if free is None else {"free": free}
    return Recorder(path, METADATA, config, drop="never", **options)


def play(scans, *listeners):
    with Stream(played(scans), listeners) as stream:
        stream.wait()


def make_publisher(*items):
    """Return a listener that publishes each item with the scan of its time."""

    def publish(scan):
        for item in items:
            if item.stamp == scan.stamp:
                publisher.context.publish(item)

    publisher = Ear("publisher", do=publish)
    return publisher


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_recording_has_every_scan_and_all_metadata(path):
    play(SCANS, make_recorder(path))
    recording = read_recording(path)
    assert same_scans(list(recording.scans()), SCANS) and not recording.truncated
    assert recording.metadata == METADATA
    assert (recording.robot_name, recording.joint_names) == ("elbow", INFO.joint_names)
    assert recording.load_robot().urdf == INFO.mounted.robot.urdf
    assert recording.calibration.to_bytes() == INFO.calibration.to_bytes()
    assert names(path.parent) == [path.name]


def test_detections_and_events_are_recorded_and_rewritten(path):
    play(SCANS, make_publisher(*EVENTS, DETECTION), make_recorder(path))
    recording = read_recording(path)
    assert recording.events == tuple(event.record() for event in EVENTS)
    assert recording.detections == (DETECTION.record(),)
    other = path.with_name("b.mcap")
    rewrite_recording(recording, other)
    again = read_recording(other)
    assert again.events == recording.events
    assert same_scans(list(again.scans()), SCANS)


def correct(seconds, start, gesture):
    """Return a correction of a touch that lasts half a second."""
    begin = START + round(start * SECOND)
    stamp = START + round(seconds * SECOND)
    return Correction(stamp, begin, begin + SECOND // 2, gesture)


def test_last_correction_of_each_touch_becomes_its_label(path):
    made = correct(1, 0.2, "poke"), correct(2, 0.2, "wave"), correct(3, 1.4, "grab")
    play(SCANS, make_publisher(*made), make_recorder(path))
    labels = read_recording(path).labels
    assert [(label.gesture, label.source) for label in labels] == [
        ("wave", "true"),
        ("grab", "true"),
    ]
    spans = [(label.start, label.end) for label in labels]
    assert spans == [(found.start, found.end) for found in made[1:]]


def test_scans_are_synced_every_half_second(path, monkeypatch):
    synced = []
    fsync = os.fsync

    def note(number):
        fsync(number)
        synced.append(read_recording(path.with_name("a.mcap.part")).count)

    monkeypatch.setattr(os, "fsync", note)
    monkeypatch.setattr("eskin.stream.recorder.perf_counter", lambda: 0.0)
    recorder = make_recorder(path)
    play(SCANS, recorder)
    assert synced == list(range(25, 201, 25)) and recorder.sync.count == 7


def test_slow_disk_is_synced_less_often_and_nothing_is_lost(path, monkeypatch):
    synced = []
    clock = count(0, 0.8).__next__  # [s]
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(number))
    monkeypatch.setattr("eskin.stream.recorder.perf_counter", clock)
    play(SCANS, recorder := make_recorder(path))
    assert recorder.sync.count == 3 and len(synced) == 4
    assert read_recording(path).count == len(SCANS)


def test_pieces_together_have_every_scan(path):
    recorder = make_recorder(path, piece_bytes=10_000)
    scans = make_scans(500)
    play(scans, recorder)
    files = recorder.pieces.files
    assert names(path.parent) == [f"a-{n + 1:04d}.mcap" for n in range(len(files))]
    pieces = [read_recording(file) for file in files]
    assert len(pieces) > 2
    assert same_scans([scan for piece in pieces for scan in piece.scans()], scans)
    for number, piece in enumerate(pieces):
        assert not piece.truncated
        assert piece.metadata.notes == {"piece": str(number + 1)}
        assert piece.joint_names == INFO.joint_names
        assert piece.skin.count == INFO.skin.count
    sizes = [file.stat().st_size for file in files[:-1]]
    assert 10_000 <= min(sizes) <= max(sizes) < 15_000


@pytest.mark.parametrize(
    "name", ["a[1].mcap", "a[1].mcap.part", "a[1]-0001.mcap", "a[1]-0007.mcap.part"]
)
def test_earlier_recording_is_never_overwritten(tmp_path, name):
    (tmp_path / name).write_bytes(b"precious")
    with pytest.raises(RecordingError) as error:
        play(SCANS, make_recorder(tmp_path / "a[1].mcap"))
    assert name in str(error.value) and "\n" not in str(error.value)
    assert (tmp_path / name).read_bytes() == b"precious"
    assert names(tmp_path) == [name]


def test_missing_folder_is_refused(path):
    with pytest.raises(RecordingError, match="folder"):
        play(SCANS, make_recorder(path.parent / "gone" / "a.mcap"))


def play_until_stop(recorder, scans):
    """Play scans and return the one event, which says that recording has stopped."""
    ear = Ear(message_types=(Scan, Event))
    play(scans, recorder, ear)
    [event] = [item for item in ear.received if isinstance(item, Event)]
    assert event.kind == "unrecorded"
    assert same_scans([item for item in ear.received if item is not event], scans)
    return event


def test_recording_stops_before_disk_is_full(path):
    def free(folder):
        return 40_000 - sum(file.stat().st_size for file in folder.iterdir())

    recorder = make_recorder(path, free, least_free=20_000)
    scans = make_scans(1000)
    event = play_until_stop(recorder, scans)
    assert "0 MB" in event.text
    recording = read_recording(path)
    assert 0 < recording.count < len(scans) and not recording.truncated
    assert same_scans(list(recording.scans()), scans[: recording.count])
    assert recorder.unrecorded == len(scans) - recording.count
    assert names(path.parent) == [path.name]


def test_nearly_full_disk_is_refused(path):
    free = 1_500_000_000
    least = 2_000_000_000
    with pytest.raises(RecordingError, match="1500 MB.*2000 MB"):
        play(SCANS, make_recorder(path, lambda _: free, least_free=least))
    assert not list(path.parent.iterdir())


class TinyDisk(io.FileIO):
    """A file on a disk with little room, which takes what fits and then nothing."""

    room = 0
    reason = errno.ENOSPC

    def write(self, data):
        if not TinyDisk.room:
            raise OSError(TinyDisk.reason, os.strerror(TinyDisk.reason))
        taken = super().write(memoryview(data)[: TinyDisk.room])
        TinyDisk.room -= taken
        return taken


@pytest.fixture
def open_with(monkeypatch):
    """Replace how files are opened for writing."""
    real = Path.open

    def replace(open_binary):
        def open_file(path, mode="r", *rest, **more):
            if mode == "xb":
                return open_binary(path) or real(path, mode, *rest, **more)
            return real(path, mode, *rest, **more)

        monkeypatch.setattr(Path, "open", open_file)

    return replace


@pytest.fixture
def tiny_disk(open_with, monkeypatch):
    def set_room(room, reason):
        monkeypatch.setattr(TinyDisk, "room", room)
        monkeypatch.setattr(TinyDisk, "reason", reason)
        open_with(lambda path: io.BufferedWriter(TinyDisk(path, "wb")))

    return set_room


@pytest.mark.parametrize("room", [15_000, 15_500, 20_001])
def test_full_disk_keeps_what_was_written(path, tiny_disk, room):
    tiny_disk(room, errno.ENOSPC)
    scans = make_scans(1000)
    event = play_until_stop(make_recorder(path), scans)
    assert "disk is full" in event.text
    recording = read_recording(path.with_name("a.mcap.part"))
    assert recording.truncated and recording.count > 0
    assert same_scans(list(recording.scans()), scans[: recording.count])


def test_disk_full_at_new_piece_keeps_those_before(path, open_with):
    def open_binary(path):
        if "0003" in path.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    open_with(open_binary)
    recorder = make_recorder(path, piece_bytes=10_000)
    scans = make_scans(1000)
    play_until_stop(recorder, scans)
    files = [path.with_name(f"a-000{number}.mcap") for number in (1, 2)]
    assert sorted(path.parent.iterdir()) == files
    kept = [scan for file in files for scan in read_recording(file).scans()]
    assert same_scans(kept, scans[: len(kept)])
    assert recorder.unrecorded == len(scans) - len(kept)


def test_failing_disk_stops_stream(path, tiny_disk):
    tiny_disk(15_000, errno.EIO)
    with pytest.raises(StreamError, match="'recorder'.*Input/output"):
        play(make_scans(1000), make_recorder(path))
    assert read_recording(path.with_name("a.mcap.part")).count > 0


def test_recording_is_finished_when_other_listener_fails(path):
    def fail(scan):
        if scan is SCANS[150]:
            raise KeyError("view")

    with pytest.raises(StreamError, match="view"):
        play(SCANS, make_recorder(path), Ear("viewer", do=fail))
    recording = read_recording(path)
    assert not recording.truncated
    assert same_scans(list(recording.scans()), SCANS[: recording.count])


def test_recording_of_a_killed_process_has_all_up_to_its_end(tmp_path):
    [killed] = kill_often(tmp_path, 1)
    assert killed.whole and killed.seconds > killed.lost
