"""Tests of what is published: other programs decode it and find what was felt."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from eskin.bus import (
    COMMAND_EVENT,
    CONTACTS,
    DIAGNOSTICS,
    MARKERS,
    PRESSURE,
    PUBLISHED,
    ROBOT_DESCRIPTION,
    TAXELS,
    TRANSFORMS,
    WRENCH,
    Bus,
    Publisher,
    compute_type_hash,
)
from eskin.live import Recognizer
from eskin.recording.messages import (
    DETECTION,
    EVENT,
    JOINT_STATES,
    LABEL,
    READING,
    TRUTH,
)
from eskin.stream import Recognition, RecognitionState, Stream
from helpers.live import (
    VOCABULARY,
    Press,
    calibration_of,
    mounted,
    say_always,
    scans,
)
from helpers.questions import DECISIONS, make_deciding_listener
from helpers.streams import INFO, Ear, played

MESSAGES = Path(__file__).parents[1] / "msg" / "eskin_msgs"
LAYOUT = "examples/foxglove_layout.json"
ARROW = 0
SPHERE_LIST = 7
TEXT = 9
KINDS = {"contacts": ARROW, "touches": TEXT, "detections": TEXT}
"""Types of markers by namespace, as `visualization_msgs/msg/Marker` numbers them."""
OTHERS = (JOINT_STATES, TRANSFORMS, ROBOT_DESCRIPTION)
TOPICS = (*PUBLISHED, *OTHERS, LABEL, TRUTH)
OWN = [topic for topic in TOPICS if topic.type_name.startswith("eskin_msgs")]


class MemoryBus(Bus):
    """Keeps what is sent, and wants all topics but some."""

    name = "memory"

    def __init__(self, unwanted=()):
        self.unwanted = unwanted
        self.sent = {}
        self.open_topics = None

    def open(self, topics):
        self.open_topics = topics

    def wants(self, topic):
        return topic not in self.unwanted

    def send(self, topic, stamp, data):
        self.sent.setdefault(topic.name, []).append((stamp, data))

    def close(self):
        self.open_topics = ()


@pytest.fixture(scope="module")
def typestore():
    """All types as ROS 2 defines them, and ours as `msg/` does; nothing of eskin."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted((MESSAGES / "msg").glob("*.msg")):
        name = f"eskin_msgs/msg/{path.stem}"
        store.register(get_types_from_msg(path.read_text(), name))
    return store


def publish(bus, stream):
    """Publish scans of the ur5 skin on a bus; return the states of the recognition."""
    own = mounted("ur5")
    source = played(stream)
    source.info = replace(INFO, mounted=own)
    recognizer = Recognizer(say_always("poke"), own, calibration_of(own.skin))
    recognition = Recognition(recognizer, drop="never")
    publisher = Publisher(bus, own, VOCABULARY, drop="never")
    ear = Ear(message_types=(RecognitionState,))
    listeners = [recognition, make_deciding_listener(), publisher, ear]
    with Stream(source, listeners) as running:
        running.wait()
    return ear.received


@pytest.fixture(scope="module")
def published():
    bus = MemoryBus()
    stream = scans(mounted("ur5"), [Press(2.3, 2.8, 40, 40)], 50, 3.6)
    return bus, stream, publish(bus, stream)


@pytest.fixture
def decode(published, typestore):
    """Return the decoded messages of a topic, checked to be encoded canonically."""

    def decode(topic):
        messages = []
        for _, data in published[0].sent.get(topic.name, ()):
            message = typestore.deserialize_cdr(data, topic.type_name)
            assert bytes(typestore.serialize_cdr(message, topic.type_name)) == data
            messages.append(message)
        return messages

    return decode


def read_stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_hash_of_a_type_is_that_of_ros2(topic, typestore):
    assert compute_type_hash(topic) == typestore.hash_rihs01(topic.type_name)


def test_interface_package_defines_what_is_published_and_recorded():
    defined = {}
    for topic in OWN:
        own, *others = re.split(r"=+\nMSG: ", topic.definition)
        defined[topic.type_name.rpartition("/")[2]] = own
        for other in others:
            name, _, text = other.partition("\n")
            if name.startswith("eskin_msgs/"):
                defined[name.partition("/")[2]] = text
    files = {path.stem: path.read_text() for path in (MESSAGES / "msg").glob("*.msg")}
    assert files.keys() == defined.keys()
    for name, text in files.items():
        assert text.strip() == defined[name].strip()
    built = re.findall(r"msg/(\w+)\.msg", (MESSAGES / "CMakeLists.txt").read_text())
    assert sorted(built) == sorted(defined)


def test_readings_hold_counts_and_pressure_of_each_scan(decode, published):
    _, stream, states = published
    readings = decode(READING)
    pressures = decode(PRESSURE)
    assert [read_stamp(m) for m in readings] == [scan.stamp for scan in stream]
    for message, scan in zip(readings, stream, strict=True):
        assert message.counts.tolist() == scan.counts.tolist()
        assert message.received.all()
    assert len(pressures) == len(states)
    for message, state in zip(pressures, states, strict=True):
        reading = state.state.reading
        assert read_stamp(message) == reading.stamp
        np.testing.assert_array_equal(message.valid, reading.valid)
        np.testing.assert_array_equal(
            message.pressure[reading.valid], reading.pressure[reading.valid]
        )


def test_joint_states_hold_names_and_positions(decode, published):
    stream = published[1]
    joints = mounted("ur5").robot.joint_names
    for message, scan in zip(decode(JOINT_STATES), stream, strict=True):
        assert tuple(message.name) == joints
        assert message.position.tolist() == scan.q.tolist()


def test_contacts_hold_what_was_tracked(decode, published):
    touched = 0
    for message, state in zip(decode(CONTACTS), published[2], strict=True):
        own = state.state.contacts
        assert message.header.frame_id == mounted("ur5").robot.link_names[0]
        assert tuple(message.gestures) == VOCABULARY
        assert len(message.contacts) == len(own)
        ours = {tuple(contact.taxels): contact for contact in own}
        for contact in message.contacts:
            mine = ours[tuple(contact.taxels)]
            assert (contact.link, contact.patch) == (mine.link, mine.patch)
            assert contact.force == pytest.approx(mine.force)
            point = contact.point
            normal = contact.normal
            assert (point.x, point.y, point.z) == tuple(mine.p_world)
            assert (normal.x, normal.y, normal.z) == tuple(mine.n_world)
            if contact.touch in state.probabilities:
                expected = state.probabilities[contact.touch]
                np.testing.assert_allclose(contact.probabilities, expected, rtol=1e-6)
                touched += 1
    assert touched > 10


def test_detection_is_published_once(decode):
    [message] = decode(DETECTION)
    assert message.gesture == "poke" and message.confidence > 0.9


def test_question_and_how_it_ended_are_published(decode):
    messages = decode(COMMAND_EVENT)
    skin = mounted("ur5").skin.name
    assert {message.header.frame_id for message in messages} == {skin}
    said = [(m.action, m.accepted, m.why, m.touch, m.gesture) for m in messages]
    assert said == [
        (d.action, d.accepted, d.why, d.touch or 0, d.gesture or "") for d in DECISIONS
    ]
    for message, decision in zip(messages, DECISIONS, strict=True):
        assert read_stamp(message) == decision.stamp
        onset = message.onset.sec * 1_000_000_000 + message.onset.nanosec
        assert (onset, message.patch) == (decision.onset or 0, decision.patch or "")


def test_markers_show_taxels_where_they_are_and_contacts_where_they_press(
    decode, published
):
    own = mounted("ur5")
    states = {s.state.reading.stamp: s for s in published[2]}
    messages = decode(MARKERS)
    assert len(messages) == len(published[1]) / 2
    shown = set()
    for message in messages:
        taxels, *others = message.markers
        state = states[read_stamp(taxels)].state
        positions, _ = own.place_taxels(state.reading.q)
        points = [(p.x, p.y, p.z) for p in taxels.points]
        np.testing.assert_allclose(points, positions, atol=1e-9)
        assert len(taxels.colors) == len(points)
        assert (taxels.ns, taxels.type) == ("taxels", SPHERE_LIST)
        assert all(m.type == KINDS[m.ns] for m in others)
        assert len({(m.ns, m.id) for m in others}) == len(others)
        arrows = [m for m in others if m.ns == "contacts"]
        tips = [tuple(vars(m.points[1]).values())[:3] for m in arrows]
        np.testing.assert_allclose(
            np.reshape(tips, (-1, 3)),
            np.reshape([c.p_world for c in state.contacts], (-1, 3)),
        )
        shown |= {m.ns for m in others}
    assert shown == {"contacts", "touches", "detections"}


def test_cloud_holds_place_and_pressure_of_each_taxel(decode, published):
    own = mounted("ur5")
    states = {s.state.reading.stamp: s for s in published[2]}
    messages = decode(TAXELS)
    assert len(messages) == len(decode(MARKERS))
    for message in messages:
        assert [field.name for field in message.fields] == ["x", "y", "z", "pressure"]
        assert message.width == own.skin.count and message.height == 1
        assert message.row_step == message.width * message.point_step
        points = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 4)
        reading = states[read_stamp(message)].state.reading
        positions, _ = own.place_taxels(reading.q)
        np.testing.assert_allclose(points[:, :3], positions, atol=1e-6)
        pressure = np.where(reading.valid, reading.pressure, np.nan)
        np.testing.assert_array_equal(points[:, 3], pressure)


def test_wrenches_are_what_presses_on_each_link_and_end_with_zero(decode, published):
    """At most the force of the contacts, which sums without direction; about the
    link's origin, so that the torque is square to the force of a single place."""
    own = mounted("ur5")
    states = {s.state.reading.stamp: s for s in published[2]}
    messages = decode(WRENCH)
    for message in messages:
        force, torque = (
            np.array([v.x, v.y, v.z])
            for v in (message.wrench.force, message.wrench.torque)
        )
        contacts = states[read_stamp(message)].state.contacts
        mine = [c for c in contacts if c.link == message.header.frame_id]
        whole = sum(c.force for c in mine)
        size = np.linalg.norm(force)
        assert 0.9 * whole <= size <= whole + 1e-9
        if mine:
            arm = np.cross(mine[0].p_link, force)
            np.testing.assert_allclose(torque, arm, atol=0.02 * size)
    assert len(messages) > 10 and not force.any() and not torque.any()
    assert {message.header.frame_id for message in messages} <= {*own.robot.link_names}


def test_transforms_place_every_link(decode, published):
    own = mounted("ur5")
    states = {s.state.reading.stamp: s for s in published[2]}
    for message in decode(TRANSFORMS):
        placed = {own.robot.link_names[0]: np.eye(4)}
        q = states[read_stamp(message.transforms[0])].state.reading.q
        for transform in message.transforms:
            t = transform.transform.translation
            r = transform.transform.rotation
            T = np.eye(4)
            T[:3, :3] = rotate(r.w, np.array([r.x, r.y, r.z]))
            T[:3, 3] = t.x, t.y, t.z
            placed[transform.child_frame_id] = placed[transform.header.frame_id] @ T
        poses = own.kinematics.poses(q)
        for name, T in zip(own.robot.link_names, poses, strict=True):
            np.testing.assert_allclose(placed[name], T, atol=1e-9)


def rotate(w, v):
    """Return the matrix of a unit quaternion, by Rodrigues' formula."""
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def test_description_of_the_robot_is_its_urdf(decode):
    [message] = decode(ROBOT_DESCRIPTION)
    assert message.data.encode() == mounted("ur5").robot.urdf


def test_diagnostics_tell_once_a_second_which_patch_is_silent(typestore):
    own = mounted("ur5")
    bus = MemoryBus(unwanted=set(TOPICS) - {DIAGNOSTICS})
    silent = own.skin.patches[2].id
    stream = scans(own, [], 50, 4.0)
    for scan in stream:
        scan.received[own.skin.find_taxels(silent)] = False
    publish(bus, stream)
    kinds = [
        typestore.deserialize_cdr(data, DIAGNOSTICS.type_name)
        for _, data in bus.sent[DIAGNOSTICS.name]
    ]
    assert len(kinds) == 4
    levels = {status.name: status.level for status in kinds[-1].status}
    assert levels.pop("eskin: skin") == levels.pop(f"eskin: patch {silent}") == 2
    assert set(levels.values()) == {0}


def test_what_nobody_receives_is_not_encoded():
    rare = {EVENT, DETECTION, COMMAND_EVENT}
    unwanted = {*TOPICS} - {DIAGNOSTICS, ROBOT_DESCRIPTION, *rare}
    bus = MemoryBus(unwanted)
    publish(bus, scans(mounted("ur5"), [], 50, 2.0))
    sent = {topic.name for topic in (ROBOT_DESCRIPTION, DIAGNOSTICS, COMMAND_EVENT)}
    assert bus.sent.keys() == sent
    assert bus.open_topics == ()
    assert EVENT.name not in bus.sent


def find_texts(value):
    """Yield all texts inside nested dictionaries and lists, keys included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from find_texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from find_texts(inner)


def test_layout_of_foxglove_names_topics_and_fields_that_exist():
    layout = json.loads((MESSAGES.parents[1] / LAYOUT).read_text())
    paths = {text for text in find_texts(layout) if text.startswith("/")}
    topics = {topic.name: topic for topic in TOPICS}
    for path in paths:
        name, *names = re.sub(r"\[.*?\]", "", path).split(".")
        types = topics[name].types
        fields = types[topics[name].type_name]
        for step in names:
            [field] = [field for field in fields if field.name == step]
            fields = types.get(field.type_name, ())
    assert len(paths) >= 8
    panels = set(layout["configById"])
    assert panels == {text for text in find_texts(layout["layout"]) if "!" in text}
