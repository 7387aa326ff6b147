"""A recorder writes all that it hears, and what it wrote is safe."""

import dataclasses
import errno
import io
import os
from pathlib import Path

import numpy as np
import pytest
from benchmarks.soak.kill import kill_often

from eskin.drivers import Event
from eskin.errors import RecordingError, StreamError
from eskin.live import Detection
from eskin.recording import EventRecord, read_recording, rewrite_recording
from eskin.recording.messages import pack_event, unpack_event
from eskin.stream import Recorder, RecorderConfig, Stream
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

SCANS = make_scans(200)
ANYHOW = RecorderConfig(least_free=0)
EVENTS = (
    Event(START + SECOND, "silent", "patch 'a' is silent: plug it in", "a"),
    Event(START + 2 * SECOND, "fault", "a row of 'a' is out", "a", 0, None, None),
    Event(START + 3 * SECOND, "slow", "ü"),
)


def detection(stamp):
    return Detection(
        stamp=stamp,
        touch=4,
        gesture="poke",
        confidence=0.875,
        onset=stamp - SECOND,
        end=stamp,
        link="forearm",
        patch="a",
        p_world=np.array([0.1, 0.2, 0.3]),
        n_world=np.array([0.0, 0.6, 0.8]),
        direction_world=np.zeros(3),
        peak_force=12.5,
    )


def stream_to(recorder, scans=SCANS, others=()):
    with Stream(played(scans), [recorder, *others]) as stream:
        stream.wait()
    return stream


def recorder_to(path, config=ANYHOW, **more):
    return Recorder(path, METADATA, config, drop="never", **more)


class Reporter(Ear):
    """Tells events and detections among the scans."""

    def __init__(self, words):
        super().__init__("reporter")
        self.words = words
        self.do = self.report

    def report(self, scan):
        for word in self.words:
            if word.stamp == scan.stamp:
                self.context.publish(word)


def test_every_scan_is_in_the_recording_with_all_metadata(tmp_path):
    stream_to(recorder_to(tmp_path / "a.mcap"))
    recording = read_recording(tmp_path / "a.mcap")
    assert same_scans(list(recording.scans()), SCANS)
    assert not recording.truncated
    assert recording.metadata == METADATA
    assert (recording.robot_name, recording.joint_names) == ("ur5", INFO.joint_names)
    assert recording.calibration.to_bytes() == INFO.calibration.to_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_detections_and_events_are_recorded(tmp_path):
    said = detection(START + 2 * SECOND)
    recorder = recorder_to(tmp_path / "a.mcap")
    with Stream(played(SCANS), [Reporter([*EVENTS, said]), recorder]) as stream:
        stream.wait()
    recording = read_recording(tmp_path / "a.mcap")
    assert recording.events == tuple(event.record() for event in EVENTS)
    assert recording.detections == (said.record(),)
    rewrite_recording(recording, tmp_path / "b.mcap")
    again = read_recording(tmp_path / "b.mcap")
    assert again.events == recording.events
    assert same_scans(list(again.scans()), SCANS)


@pytest.mark.parametrize("event", EVENTS)
def test_an_event_is_packed_and_unpacked(event):
    record = event.record()
    assert isinstance(record, EventRecord)
    assert unpack_event(pack_event(record, "square")) == record


def test_an_event_reads_as_ros_reads_it(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    recorder = recorder_to(tmp_path / "a.mcap")
    event = dataclasses.replace(EVENTS[0], taxel=7)
    with Stream(played(SCANS), [Reporter([event]), recorder]) as stream:
        stream.wait()
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        [(_, channel, _, message)] = reader.iter_decoded_messages(["/eskin/event"])
    assert channel.topic == "/eskin/event"
    assert (message.kind, message.text, message.patch) == (event.kind, event.text, "a")
    assert (message.row, message.column, message.taxel) == (-1, -1, 7)
    assert message.header.stamp.sec == START // SECOND + 1
    assert message.header.frame_id == "square"


def test_all_but_the_last_half_second_is_in_the_file_while_recording_goes_on(tmp_path):
    recorder, left = recorder_to(tmp_path / "a.mcap"), []

    def look(scan):
        part = read_recording(tmp_path / "a.mcap.part")
        recorded = part.end if part.count else START - SECOND // 50
        left.append((scan.stamp - recorded) / SECOND)

    class Both(Ear):
        def start(self, context):
            recorder.start(context)

        def on_message(self, item):
            recorder.on_message(item)
            look(item)

        def close(self):
            recorder.close()

    with Stream(played(SCANS), [Both("recorder")]) as stream:
        stream.wait()
    assert len(left) == 200
    assert max(left) <= 0.5 + 1e-9


def test_every_chunk_is_synced_before_more_is_written(tmp_path, monkeypatch):
    synced = []
    fsync = os.fsync

    def note(number):
        fsync(number)
        synced.append(read_recording(tmp_path / "a.mcap.part").count)

    monkeypatch.setattr(os, "fsync", note)
    recorder = recorder_to(tmp_path / "a.mcap")
    stream_to(recorder)
    assert synced == [25, 50, 75, 100, 125, 150, 175, 200]
    assert recorder.sync.count == 7


# RecordingFiles.


def test_the_pieces_together_hold_every_scan_and_each_is_whole(tmp_path):
    config = RecorderConfig(least_free=0, piece_bytes=10_000)
    recorder = recorder_to(tmp_path / "a.mcap", config)
    scans = make_scans(1000)
    stream_to(recorder, scans)
    files = sorted(tmp_path.iterdir())
    assert files == recorder.pieces.files
    assert [f.name for f in files] == [f"a-{n + 1:04d}.mcap" for n in range(len(files))]
    assert len(files) > 3
    pieces = [read_recording(path) for path in files]
    assert same_scans([s for piece in pieces for s in piece.scans()], scans)
    for number, piece in enumerate(pieces):
        assert not piece.truncated
        assert piece.metadata.notes == {"piece": str(number + 1)}
        assert piece.joint_names == INFO.joint_names
        assert piece.skin.count == INFO.skin.count
    sizes = [path.stat().st_size for path in files[:-1]]
    assert 10_000 <= min(sizes) <= max(sizes) < 15_000


@pytest.mark.parametrize(
    "name", ["a[1].mcap", "a[1].mcap.part", "a[1]-0001.mcap", "a[1]-0007.mcap.part"]
)
def test_an_earlier_recording_is_never_written_over(tmp_path, name):
    (tmp_path / name).write_bytes(b"precious")
    with pytest.raises(RecordingError, match="is there already") as caught:
        stream_to(recorder_to(tmp_path / "a[1].mcap"))
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    assert (tmp_path / name).read_bytes() == b"precious"
    assert len(list(tmp_path.iterdir())) == 1


# Disks.


def test_recording_stops_before_the_disk_is_full_and_the_rest_goes_on(tmp_path):
    def free(folder):
        size = sum(path.stat().st_size for path in folder.iterdir())
        return 40_000 - size

    config = RecorderConfig(least_free=20_000)
    recorder = recorder_to(tmp_path / "a.mcap", config, free=free)
    ear = Ear(message_types=(Scan, Event))
    scans = make_scans(2000)
    stream_to(recorder, scans, [ear])
    recording = read_recording(tmp_path / "a.mcap")
    assert not recording.truncated
    assert 0 < recording.count < 2000
    assert same_scans(list(recording.scans()), scans[: recording.count])
    assert recorder.unrecorded == 2000 - recording.count
    [event] = [item for item in ear.heard if isinstance(item, Event)]
    assert event.kind == "unrecorded"
    assert "its disk has 0 MB left; allowed are 0 MB or more; free" in event.text
    assert same_scans([item for item in ear.heard if item is not event], scans)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_disk_that_is_nearly_full_is_refused_before_anything_is_written(tmp_path):
    config = RecorderConfig(least_free=2_000_000_000)
    recorder = recorder_to(tmp_path / "a.mcap", config, free=lambda _: 1_500_000_000)
    message = "its disk has 1500 MB left; allowed are 2000 MB or more; free some space"
    with pytest.raises(RecordingError, match=message):
        stream_to(recorder)
    assert not list(tmp_path.iterdir())


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
def tiny_disk(monkeypatch):
    real = Path.open

    def opened(path, mode="r", *rest, **more):
        if mode != "wb":
            return real(path, mode, *rest, **more)
        return io.BufferedWriter(TinyDisk(path, "wb"))

    monkeypatch.setattr(Path, "open", opened)
    return TinyDisk


@pytest.mark.parametrize("room", [15_000, 15_500, 20_000, 20_001, 25_000])
def test_a_full_disk_leaves_what_was_written_and_the_rest_goes_on(
    tmp_path, tiny_disk, room
):
    tiny_disk.room, tiny_disk.reason = room, errno.ENOSPC
    recorder, ear = recorder_to(tmp_path / "a.mcap"), Ear(message_types=(Scan, Event))
    scans = make_scans(2000)
    stream_to(recorder, scans, [ear])
    recording = read_recording(tmp_path / "a.mcap.part")
    assert recording.truncated
    assert recording.count > 0
    assert same_scans(list(recording.scans()), scans[: recording.count])
    [event] = [item for item in ear.heard if isinstance(item, Event)]
    assert event.kind == "unrecorded"
    assert "has stopped, all else goes on: its disk is full" in event.text
    assert same_scans([item for item in ear.heard if item is not event], scans)


def test_a_disk_that_is_full_at_a_new_piece_keeps_those_before(tmp_path, monkeypatch):
    real = Path.open

    def opened(path, mode="r", *rest, **more):
        if mode == "wb" and "0003" in path.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(path, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", opened)
    recorder = recorder_to(tmp_path / "a.mcap", RecorderConfig(piece_bytes=20_000))
    ear, scans = Ear(message_types=(Scan, Event)), make_scans(2000)
    stream_to(recorder, scans, [ear])
    names = ["a-0001.mcap", "a-0002.mcap"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    kept = [s for name in names for s in read_recording(tmp_path / name).scans()]
    assert same_scans(kept, scans[: len(kept)])
    assert recorder.unrecorded == 2000 - len(kept)
    [event] = [item for item in ear.heard if isinstance(item, Event)]
    assert event.kind == "unrecorded"


def test_a_disk_that_fails_otherwise_stops_the_stream(tmp_path, tiny_disk):
    tiny_disk.room, tiny_disk.reason = 20_000, errno.EIO
    recorder = recorder_to(tmp_path / "a.mcap")
    with pytest.raises(StreamError, match="listener 'recorder' failed .*Input/output"):
        stream_to(recorder, make_scans(2000))
    assert read_recording(tmp_path / "a.mcap.part").count > 0


def test_a_recording_is_finished_when_another_listener_fails(tmp_path):
    def fail(scan):
        if scan is SCANS[150]:
            raise KeyError("view")

    with pytest.raises(StreamError, match="view"):
        stream_to(recorder_to(tmp_path / "a.mcap"), SCANS, [Ear("viewer", do=fail)])
    recording = read_recording(tmp_path / "a.mcap")
    assert not recording.truncated
    assert same_scans(list(recording.scans()), SCANS[: recording.count])


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError, match="give a path in a folder that exists"):
        stream_to(recorder_to(tmp_path / "gone" / "a.mcap"))


# Kills.


def test_kill_9_loses_at_most_the_last_second_and_the_file_opens(tmp_path):
    killed = kill_often(tmp_path, 5)
    assert len(killed) == 5
    assert all(one.whole for one in killed)
    assert max(one.lost for one in killed) <= 1.0
