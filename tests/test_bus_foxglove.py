"""Tests of the server for Foxglove, by a client of its published protocol."""

import json
import struct
import sys
from dataclasses import replace
from threading import Thread
from time import monotonic, sleep

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from eskin.bus import PUBLISHED, Publisher
from eskin.bus.foxglove import FoxgloveBus, build_asset_finder
from eskin.errors import DeviceError
from eskin.live import Recognizer
from eskin.registry import advise_install
from eskin.robot import load_urdf
from eskin.stream import Recognition, Stream
from helpers.cli import assert_refused
from helpers.live import VOCABULARY, Press, calibration_of, mounted, say_always, scans
from helpers.questions import DECISIONS, make_deciding_listener
from helpers.streams import INFO, played

PROTOCOL = "foxglove.sdk.v1"
MESSAGE = 1
ASSET = 4
MARKERS = "/eskin/markers"
PRESSURE = "/eskin/pressure"
DETECTION = "/eskin/detection"
DESCRIPTION = "/robot_description"
JOINTS = "/joint_states"
COMMAND_EVENT = "/eskin/command_event"
TOPICS = (MARKERS, PRESSURE, DETECTION, DESCRIPTION, JOINTS, COMMAND_EVENT)


class Client:
    """Subscribes to topics and keeps the messages."""

    def __init__(self, port):
        self.socket = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], max_size=None
        )
        self.info = json.loads(self.socket.recv(5))
        self.channels = {}
        while not self.channels.keys() >= set(TOPICS):
            for channel in json.loads(self.socket.recv(5))["channels"]:
                self.channels[channel["topic"]] = channel
        self.messages = {topic: [] for topic in TOPICS}
        self.assets = []
        self.thread = Thread(target=self.listen)
        self.thread.start()

    def subscribe(self):
        subscriptions = [
            {"id": number, "channelId": self.channels[topic]["id"]}
            for number, topic in enumerate(TOPICS)
        ]
        self.send(op="subscribe", subscriptions=subscriptions)

    def send(self, **order):
        self.socket.send(json.dumps(order))

    def listen(self):
        try:
            for data in self.socket:
                if isinstance(data, bytes):
                    self.take(data)
        except ConnectionClosed:
            pass

    def take(self, data):
        if data[0] == MESSAGE:
            number, stamp = struct.unpack_from("<IQ", data, 1)
            self.messages[TOPICS[number]].append((stamp, data[13:]))
        elif data[0] == ASSET:
            number, status, length = struct.unpack_from("<IBI", data, 1)
            self.assets.append((number, status, data[10 + length :]))

    def wait_for(self, stamp):
        """Wait until the messages of the reading of a stamp have come."""
        deadline = monotonic() + 30
        for topic in (PRESSURE, JOINTS):
            while stamp not in dict(self.messages[topic][-1:]):
                assert monotonic() < deadline, f"{topic} has no message of {stamp}"
                sleep(0.01)

    def close(self):
        self.thread.join(10)
        self.socket.close()


@pytest.fixture(scope="module")
def shown():
    """A press on a ur5 in its skin, and the client that was shown it."""
    on = mounted("ur5")
    stream = scans(on, [Press(2.3, 2.8, 40, 40)], 50, 3.6)
    source = played(stream)
    source.info = replace(INFO, mounted=on)
    recognizer = Recognizer(say_always("poke"), on, calibration_of(on.skin))
    recognition = Recognition(recognizer, drop="never")
    bus = FoxgloveBus(0)
    publisher = Publisher(bus, on, VOCABULARY, drop="never")
    start = publisher.start
    close = bus.close
    clients = []
    subscribed = [topic for topic in PUBLISHED if topic.name in TOPICS]

    def start_and_wait(context):
        start(context)
        clients.append(Client(bus.port))
        clients[0].subscribe()
        while not all(bus.wants(topic) for topic in subscribed):
            context.clock.sleep(0.01)

    def wait_and_close():
        clients[0].wait_for(stream[-1].stamp)
        close()

    publisher.start = start_and_wait
    bus.close = wait_and_close
    with Stream(source, [recognition, make_deciding_listener(), publisher]) as running:
        running.wait()
    clients[0].close()
    return stream, clients[0]


def test_channels_are_described_as_ros2_messages(shown):
    client = shown[1]
    assert client.info["name"] == "eskin" and client.info["capabilities"] == []
    store = get_typestore(Stores.EMPTY)
    for topic in TOPICS:
        channel = client.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))


def decode(client, topic):
    """Decode the messages of a topic by the schema that the server gave."""
    channel = client.channels[topic]
    store = get_typestore(Stores.EMPTY)
    name = channel["schemaName"]
    store.register(get_types_from_msg(channel["schema"], name))
    return [
        (stamp, store.deserialize_cdr(data, name))
        for stamp, data in client.messages[topic]
    ]


def test_client_gets_every_reading_with_its_stamp(shown):
    stream, client = shown
    readings = decode(client, PRESSURE)
    assert [stamp for stamp, _ in readings] == [scan.stamp for scan in stream]
    assert all(len(m.pressure) == mounted("ur5").skin.count for _, m in readings)
    assert [stamp for stamp, _ in decode(client, JOINTS)] == [s.stamp for s in stream]


def test_client_gets_robot_taxels_and_detection(shown):
    on = mounted("ur5")
    client = shown[1]
    assert {m.data.encode() for _, m in decode(client, DESCRIPTION)} == {on.robot.urdf}
    assert [m.gesture for _, m in decode(client, DETECTION)] == ["poke"]
    _, last = decode(client, MARKERS)[-1]
    assert len(last.markers[0].points) == on.skin.count


def test_client_gets_question_and_how_it_ended(shown):
    messages = decode(shown[1], COMMAND_EVENT)
    assert [(stamp, m.action, m.accepted, m.why) for stamp, m in messages] == [
        (each.stamp, each.action, each.accepted, each.why) for each in DECISIONS
    ]


URDF = """<robot name="cup"><link name="cup"><visual><geometry>
<mesh filename="package://cups/cup.stl"/></geometry></visual></link></robot>"""


def test_only_meshes_of_the_urdf_are_served(tmp_path):
    package = tmp_path / "cups"
    package.mkdir()
    (package / "cup.urdf").write_text(URDF)
    (package / "cup.stl").write_bytes(b"solid cup")
    (package / "secret.stl").write_bytes(b"solid secret")
    robot = load_urdf(package / "cup.urdf", meshes=False)
    find = build_asset_finder(robot, package)
    assert find("package://cups/cup.stl") == b"solid cup"
    for other in ("package://cups/secret.stl", "file:///etc/passwd", "cup.stl"):
        assert find(other) is None
    (package / "cup.stl").unlink()
    assert find("package://cups/cup.stl") is None


def test_port_that_is_taken_is_one_line():
    first = FoxgloveBus(0)
    second = None
    first.open(())
    try:
        second = FoxgloveBus(first.port)
        with pytest.raises(DeviceError, match="--foxglove-port"):
            second.open(())
    finally:
        first.close()


def test_without_foxglove_one_line_says_what_to_install(monkeypatch, capsys):

    monkeypatch.delitem(sys.modules, "eskin.bus.foxglove", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    words = ("run", "--source", "sim:ur5", "--foxglove")
    assert_refused(capsys, *words, part=advise_install("foxglove"))
