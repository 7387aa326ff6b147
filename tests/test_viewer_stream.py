import logging

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from eskin.drivers import STEPPED, Event, ManualClock, PlayedSource, SourceInfo
from eskin.errors import StreamError
from eskin.live import Detection, Recognizer
from eskin.page.server import is_local
from eskin.stream import CommandEvent, Recognition, Stream
from eskin.transforms import apply
from eskin.viewer import Viewer, ViewerConfig
from eskin.viewer.process import PageProcess
from eskin.viewer.viewer import MAX_LOG_ENTRIES, FrameEncoder
from helpers.live import START, calibration_of, say_always, scans, two_hands
from helpers.viewer import Q, mounted, picture, setup


def detection(p_world):
    return Detection(
        stamp=START + 2_500_000_000,
        touch=4,
        gesture="double_pat",
        confidence=0.97,
        onset=START,
        end=START,
        link="forearm_link",
        patch="forearm_back",
        p_world=p_world,
        n_world=np.zeros(3),
        direction_world=np.zeros(3),
        peak_force=8.0,
    )


def test_words_float_at_their_place_on_the_link_and_say_when():
    packer = FrameEncoder(mounted(), START)
    packer.T_world_link = mounted().kinematics.poses(Q)
    place = mounted().skin.positions[1661]
    link = mounted().robot.link_index("forearm_link")
    packer.note(detection(apply(packer.T_world_link[link], place)))
    (saying,) = packer.log_entries
    assert saying.link == link and np.allclose(saying.p_link, place)
    assert saying.seconds == 2.5
    assert saying.text == "double-pat 97%, 8 N, forearm back"


def test_commands_taken_and_refused_and_events_are_in_the_log():
    packer = FrameEncoder(mounted(), START)
    packer.note(CommandEvent(START, "pause", 4, "poke", True, ""))
    packer.note(CommandEvent(START, "resume", 5, "poke", False, "too soon"))
    packer.note(Event(START, "silent", "patch 'a' is silent"))
    assert [(saying.kind, saying.text) for saying in packer.log_entries] == [
        ("command", "pause"),
        ("refused", "resume: too soon"),
        ("event", "patch 'a' is silent"),
    ]


def test_a_log_that_nobody_reads_keeps_what_is_newest():
    packer = FrameEncoder(mounted(), START)
    for number in range(MAX_LOG_ENTRIES + 5):
        packer.note(Event(START, "lost", str(number)))
    assert (
        packer.log_entries[0].text == "5" and len(packer.log_entries) == MAX_LOG_ENTRIES
    )


def played(stream):
    robot, skin = mounted().robot, mounted().skin
    info = SourceInfo(
        "sim:test", "ur5", robot.joint_names, skin, calibration_of(skin), 50.0
    )
    return PlayedSource(info, stream, STEPPED, ManualClock())


class Kept:
    """A page that keeps what it is given."""

    def __init__(self, given):
        self.give = given.append

    def wants(self):
        return True

    def close(self):
        pass


def test_a_stream_is_seen_with_its_touches_and_what_is_said_of_them(monkeypatch):
    on = mounted()
    recognizer = Recognizer(say_always("poke"), on, calibration_of(on.skin))
    recognition = Recognition(recognizer, drop="never")
    viewer, given = Viewer(recognition, ViewerConfig(0)), []
    monkeypatch.setattr("eskin.viewer.viewer.MAX_UPDATE_RATE", 1e9)
    monkeypatch.setattr("eskin.viewer.viewer.PageProcess", lambda *_: Kept(given))
    source = played(scans(on, two_hands(on), 50, 5.0))
    with Stream(source, [recognition, viewer]) as stream:
        stream.wait()
    assert len(given) > 20
    touched = [picture for picture in given if picture.touches]
    assert touched
    for one in touched:
        assert np.argmax(one.touches[0].probabilities) == 1
    assert any(one.contacts for one in touched)
    said = [saying for one in given for saying in one.log_entries]
    assert {saying.gesture for saying in said if saying.kind == "detection"} == {"poke"}
    poses = on.kinematics.poses(np.zeros(6))
    assert given[0].poses.shape == (len(poses), 7)


def test_a_stream_with_a_taken_port_does_not_begin():
    page = PageProcess(setup(), 0, None)
    try:
        port = page.wait_ready(60.0)
        on = mounted()
        recognizer = Recognizer(say_always("poke"), on, calibration_of(on.skin))
        recognition = Recognition(recognizer)
        viewer = Viewer(recognition, ViewerConfig(port))
        with pytest.raises((StreamError, OSError), match=f"port {port}"):
            with Stream(played([]), [recognition, viewer]):
                pass
    finally:
        page.close()


def test_a_page_that_dies_is_said_once_and_stops_nothing(caplog):
    page = PageProcess(setup(), 0, None)
    try:
        page.wait_ready(60.0)
        with caplog.at_level(logging.ERROR):
            page.process.kill()
            page.process.wait()
            for thread in page.threads[:2]:
                page.give(picture())
                thread.join(5.0)
        assert [r.message for r in caplog.records] == [page.failure]
    finally:
        page.close()


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (None, True),
        ("http://127.0.0.1:8080", True),
        ("http://localhost:9999", True),
        ("http://evil.example", False),
        ("http://127.0.0.1.evil.example:8080", False),
        ("null", False),
    ],
)
def test_only_pages_of_this_computer_may_connect(origin, allowed):
    assert is_local(origin) is allowed


def test_another_sites_page_is_turned_away_before_it_hears_or_orders_anything():
    page = PageProcess(setup(), 0, lambda order: None)
    try:
        address = f"ws://127.0.0.1:{page.wait_ready(60.0)}"
        settings = {"subprotocols": ["viser-v1.1.1"], "max_size": None}
        with connect(address, origin="http://evil.example", **settings) as foreign:
            with pytest.raises(ConnectionClosed, match="1008"):
                foreign.recv(timeout=10)
        with connect(address, origin=address.replace("ws", "http"), **settings) as own:
            assert own.recv(timeout=10)
    finally:
        page.close()
