"""Tests of the viewer: meshes, the log, and the process that serves the page."""

import logging
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

from eskin.command import (
    SUSPEND,
    ArmState,
    Problem,
    Refusal,
    SkinMonitorConfig,
    Trigger,
    load_commands,
)
from eskin.command.skin_monitor import SkinMonitor
from eskin.drivers import STEPPED, Event, ManualClock, PlayedSource, SourceInfo
from eskin.errors import DeviceError, StreamError
from eskin.live import Detection, Recognizer
from eskin.page import (
    ArmSummary,
    CorrectionOrder,
    PageOrder,
    PaintOrder,
    QuestionBoard,
    RecordingState,
    TouchOrder,
    TouchRule,
)
from eskin.page.appearance import build_link_meshes, describe_scene
from eskin.page.html import (
    describe_commands,
    list_gestures,
    render_arm,
    render_bars,
    render_log,
    render_purpose,
    render_status,
    to_words,
)
from eskin.page.messages import ArmCondition, LogEntry, OpenTouch
from eskin.page.process import (
    MAX_IN_FLIGHT,
    MAX_ORDERS,
    PageProcess,
    free_port,
)
from eskin.page.scene import FIELD_OF_VIEW, place_camera
from eskin.page.viewer import (
    MAX_LOG_ENTRIES,
    FrameEncoder,
    Viewer,
    ViewerConfig,
    describe_arm,
    describe_command,
    describe_rules,
)
from eskin.robot.meshes import MeshReader
from eskin.robot.presets import read_preset_urdf
from eskin.robot.urdf import parse_urdf
from eskin.skin import MountedSkin, mount_skin
from eskin.stream import CommandEvent, Recognition, Stream
from eskin.transforms import apply
from eskin.units import NS_PER_S
from helpers.commands import RecordingArm
from helpers.live import START, calibration_of, say_always, scans, two_hands
from helpers.questions import ASKED, QUESTION, STALE
from helpers.viewer import GESTURES, Q, make_setup, make_update, mounted

pytestmark = pytest.mark.slow

ARM = ArmState(0, Q, True, False, None, 0.5, "open", "rack", False, True)
ORDER = TouchOrder("poke", "forearm_link", (0.0, 0.0, 0.1), 5.0, 0.2, 1)


def test_meshes_are_closed_with_outward_normals():
    meshes = build_link_meshes(mounted())
    assert len(meshes) > 20
    for mesh in meshes:
        faces = mesh.faces
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        directed = {tuple(edge) for edge in edges.tolist()}
        assert len(directed) == len(edges)
        assert all((b, a) in directed for a, b in directed)
        a, b, c = mesh.vertices[faces].transpose(1, 0, 2)
        assert np.einsum("fi,fi->f", a, np.cross(b, c)).sum() > 0


@pytest.mark.parametrize(("skin", "turn"), [("ur5", 0.0), ("ur10", 2.0), ("flat", 0.0)])
def test_camera_sees_the_whole_robot_from_the_side_of_its_skin(skin, turn):
    skinned = mount_skin(skin, None)
    q = np.full(len(skinned.robot.joint_names), turn)
    view = describe_scene(skinned, (), q)
    camera = np.array(view.middle), view.distance, np.array(view.direction)
    T = skinned.kinematics.poses(q)
    shapes = [apply(T[solid.link], solid.vertices) for solid in view.solids]
    places, normals = skinned.place_taxels(q)
    for aspect in (0.4, 0.9, 1.0, 1.8):
        position, target = place_camera(*camera, aspect)
        ahead = (target - position) / np.linalg.norm(target - position)
        assert normals.mean(axis=0) @ ahead < 0.1
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        rays = np.concatenate([*shapes, places]) - position
        half = np.tan(FIELD_OF_VIEW / 2) * (rays @ ahead)
        across = rays @ right / half
        up = rays @ np.cross(right, ahead) / half
        square = min(aspect, 1.0)
        assert np.abs(across).max() < square
        assert 1.0 - 2 * square < up.min() and up.max() < 1.0
        assert max(np.ptp(across), np.ptp(up)) > 0.4 * square


def test_shapes_that_cannot_be_read_are_not_drawn_and_told_in_one_line(caplog):
    mesh = '<collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
    urdf = read_preset_urdf("ur5").replace("</link>", f"{mesh}</link>")
    path = Path("own.urdf")
    robot = parse_urdf(urdf.encode(), path, MeshReader(path.absolute().parent))
    drawn = build_link_meshes(MountedSkin(mounted().skin, robot))
    assert len(drawn) == len(build_link_meshes(mounted()))
    (told,) = caplog.messages
    assert f"{urdf.count('gone.stl')} shapes are not drawn: own.urdf: link" in told


def test_lids_close_bare_ends_and_leave_room_for_taxels():
    robot = mounted().robot
    skin = mounted().skin
    meshes = build_link_meshes(mounted())
    lids = {m.link for m in meshes if m.colour[2] > m.colour[0] + 50}
    names = {robot.link_names[link] for link in lids}
    assert {"shoulder_link", "upper_arm_link", "forearm_link"} <= names
    low = skin.positions[skin.find_taxels("wrist_1_cap"), 2].min() - 0.003
    wrist = [m for m in meshes if m.link == robot.link_index("wrist_1_link")]
    assert wrist and all(mesh.vertices[:, 2].min() > low for mesh in wrist)


COMMANDS = (
    TouchRule("poke", "", ("pause",)),
    TouchRule("grab", "", ("resume", "normal")),
)
ASKS = "grab, then poke there when it asks"


@pytest.mark.parametrize(
    ("changes", "state", "reason"),
    [
        ({}, "running", ""),
        ({"moving": False}, "standing", ""),
        ({"moving": False, "gripping": "open"}, "standing", "while its gripper moves"),
        ({"speed_limit": 0.3}, "running", "because of its skin"),
        ({"moving": False, "speed_limit": 0.0}, "standing", "while it is touched"),
        ({"speed_limit": 0.0}, "stopping", "while it is touched"),
        ({"paused": True}, "paused", ""),
        ({"paused": True, "hold_reason": STALE}, "held", str(STALE)),
        ({"hold_reason": STALE}, "held", str(STALE)),
        ({"protective_stop": True}, "stopped", "unlock it at the robot"),
        ({"connected": False, "paused": True}, "stopped", "cable and its controller"),
    ],
)
def test_most_severe_state_of_arm_is_shown_with_what_ends_it(changes, state, reason):
    arm = replace(ARM, **changes)
    summary = describe_arm(arm, COMMANDS, QuestionBoard("poke"))
    assert summary.state == state
    assert reason in summary.why and bool(reason) == bool(summary.why)
    way = ""
    if state in ("paused", "held", "stopped"):
        before = "" if arm.paused else "poke, then wait 1 s, then "
        way = f"To go on: {before}{ASKS}."
    else:
        assert not describe_arm(replace(arm, speed=1.0), COMMANDS).remedy
        way = f"To full speed: {ASKS}."
    assert summary.remedy == way
    never = describe_arm(arm, COMMANDS).remedy
    assert never == way.replace(ASKS, "grab")
    by_mouse = describe_arm(arm, COMMANDS, QuestionBoard("poke"), by_mouse=True).remedy
    assert by_mouse == way.replace("poke", "poke (click)").replace(
        "grab", "grab (shift-click)"
    )


def test_arm_that_no_touch_resumes_promises_nothing():
    paused = replace(ARM, paused=True)
    held = replace(ARM, hold_reason=STALE)
    pausing, resuming = COMMANDS
    assert not describe_arm(paused, [pausing]).remedy
    assert describe_arm(paused, [resuming]).remedy == "To go on: grab."
    assert not describe_arm(held, [resuming]).remedy


@pytest.mark.parametrize(
    ("changes", "remedy"),
    [
        ({}, "Touch nothing for 5 s, then it can be asked again."),
        ({"paused": True}, f"To go on: touch nothing for 5 s, then {ASKS}."),
        (
            {"hold_reason": STALE},
            f"To go on: poke, then touch nothing for 5 s, then {ASKS}.",
        ),
    ],
)
def test_skin_must_rest_after_a_question_that_failed(changes, remedy):
    board = QuestionBoard("poke", rest=5.0)
    assert describe_arm(replace(ARM, **changes), COMMANDS, board).remedy == remedy


def test_arm_that_stands_for_its_question_says_so():
    board = QuestionBoard("poke", action="next_waypoint", left=0.5)
    standing = replace(ARM, moving=False, speed_limit=0.0)
    summary = describe_arm(standing, COMMANDS, board)
    assert summary.why.startswith("until its question")


@pytest.mark.parametrize("changes", [{}, {"paused": True}, {"speed": 0.3}])
def test_arm_that_asks_repeats_its_question_in_place_of_any_other_advice(changes):
    arm = replace(ARM, **changes)
    board = QuestionBoard("poke", action="normal", link="forearm_link", left=0.5)
    remedy = "Full speed? Answer: poke (click) on the forearm link."
    assert describe_arm(arm, COMMANDS, board, by_mouse=True).remedy == remedy
    answering = replace(board, is_answering=True)
    assert describe_arm(arm, COMMANDS, answering).remedy == (
        "Full speed? Let go and wait."
    )


@pytest.mark.parametrize("limit", [1.0, 0.0])
@pytest.mark.parametrize("moving", [True, False])
def test_slow_arm_shows_its_speed_and_the_way_to_full_speed_also_while_touched(
    limit, moving
):
    arm = replace(ARM, speed=0.3, speed_limit=limit, moving=moving)
    summary = describe_arm(arm, COMMANDS, QuestionBoard("poke"))
    assert (summary.speed, summary.remedy) == (0.3, f"To full speed: {ASKS}.")
    assert not describe_arm(arm, COMMANDS[:1], QuestionBoard("poke")).remedy
    assert "30% speed" in render_arm(summary)


@pytest.mark.parametrize("condition", get_args(ArmCondition))
def test_every_condition_of_the_arm_is_a_sentence_on_the_page(condition):
    shown = render_arm(ArmSummary(condition, "for a test", 1.0, "open", "over_there"))
    text = re.sub("<.*?>", "", shown.replace("<br>", "\n"))
    assert re.fullmatch(
        r"The arm [a-z ]+[ \n]for a test\ngripper open · next: over there", text
    )


def test_page_tells_what_each_gesture_commands_and_how_the_mouse_makes_it():
    rules = (
        *COMMANDS,
        TouchRule("stroke", "left forearm_link", ("slow",)),
        TouchRule("stroke", "right", ("wave_hand",)),
    )
    setup = replace(make_setup(touchable=True), commands=rules)
    told = describe_commands(setup)
    assert told["poke"] == "click · pauses the arm"
    assert told["grab"] == (
        "shift-click · resumes a paused arm or speeds up a slow arm"
    )
    assert told["stroke"] == "drag · left forearm link slows the arm · right wave hand"
    assert told["none"] == ""
    told = describe_commands(replace(setup, touchable=False))
    assert told["poke"] == "pauses the arm" and told["double_pat"] == ""


def test_rules_of_the_map_reach_the_page():
    commands = load_commands(None, GESTURES, mounted().skin)
    rules = describe_rules(commands)
    assert [rule.gesture for rule in rules] == [r.gesture for r in commands.commands]
    assert all(rule.actions and not rule.where for rule in rules)


def test_page_says_what_it_is_and_what_to_do_first():
    for touchable, first in ((True, "click on its skin"), (False, "touch its skin")):
        text = re.sub("<.*?>", "", render_purpose(make_setup(touchable)))
        assert text.startswith("This ") and text.count(".") == 1 and first in text


def test_detection_is_logged_at_its_place_on_link():
    encoder = FrameEncoder(mounted(), START)
    encoder.T_world_link = mounted().kinematics.poses(Q)
    place = mounted().skin.positions[1661]
    link = mounted().robot.link_index("forearm_link")
    detection = Detection(
        stamp=START + 2_500_000_000,
        touch=4,
        gesture="double_pat",
        confidence=0.97,
        onset=START,
        end=START,
        link="forearm_link",
        patch="forearm_back",
        p_world=apply(encoder.T_world_link[link], place),
        n_world=np.zeros(3),
        direction_world=np.zeros(3),
        peak_force=8.0,
    )
    encoder.note(detection)
    (entry,) = encoder.log_entries
    assert entry.link == link and np.allclose(entry.p_link, place)
    assert entry.seconds == 2.5
    assert entry.touch == 4
    assert entry.label == "double pat 97%" and entry.text.startswith(entry.label)
    for part in ("double pat", "97%", "8 N", "forearm back"):
        assert part in entry.text
    unsure = replace(detection, gesture="unknown", confidence=0.3)
    for likeliest, label in (
        ("none", "no gesture, probably (30%)"),
        ("double_pat", "double pat, probably (30%)"),
        ("", "unknown 30%"),
    ):
        entry = encoder.describe_detection(replace(unsure, likeliest=likeliest))
        assert entry.label == label


def test_what_is_no_gesture_is_listed_last_with_its_own_probability():
    chances = np.array([0.61, 0.2, 0.1, 0.05, 0.04], np.float32)
    bars = render_bars([OpenTouch(1, "forearm_back", 2.0, chances)], make_setup())
    text = re.sub("<.*?>", " ", bars)
    names = [to_words(name) for name in list_gestures(GESTURES)]
    assert sorted(names, key=text.index) == names and names[-1] == "none"
    assert text.split()[-2:] == ["none", "61%"]


POKE = Trigger.GESTURE.reason(gesture="poke", patch="forearm_back")
JOGS = Trigger.TOUCHED_WHILE_JOGGING.reason()
UNMAPPED = Refusal.NO_RULE.reason()
REFUSED = {"accepted": False, "reason": UNMAPPED}


def test_commands_and_events_are_logged():
    encoder = FrameEncoder(mounted(), START)
    encoder.note(CommandEvent(START, "pause", 4, "poke", True, POKE))
    encoder.note(CommandEvent(START, "go_on", 5, "double_pat", False, UNMAPPED))
    encoder.note(ASKED)
    encoder.note(Event(START, "silent", "patch 'a' is silent"))
    assert [(entry.kind, entry.text) for entry in encoder.log_entries] == [
        ("command", "paused (poke on forearm back)"),
        ("refused", f"go on refused: {UNMAPPED}"),
        ("command", f"asks: {QUESTION}"),
        ("event", "patch 'a' is silent"),
    ]
    for number in range(MAX_LOG_ENTRIES + 5):
        encoder.note(Event(START, "lost", str(number)))
    texts = [entry.text for entry in encoder.log_entries]
    assert texts == [str(number + 5) for number in range(MAX_LOG_ENTRIES)]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "paused (poke on forearm back)"),
        ({"likeliest": "double_pat"}, "paused (probably a double pat)"),
        ({"reason": JOGS}, f"paused ({JOGS})"),
        ({"action": SUSPEND}, "stands still while it is touched"),
        ({"action": "my_wave"}, "my wave (poke on forearm back)"),
        ({"action": "none", **REFUSED}, str(UNMAPPED)),
        ({"action": "resume", "touch": None, **REFUSED}, str(UNMAPPED)),
        ({"action": "go_on", **REFUSED}, f"go on refused: {UNMAPPED}"),
    ],
)
def test_log_says_what_was_done_and_what_it_was_probably(changes, text):
    paused = CommandEvent(START, "pause", 4, None, True, POKE)
    assert describe_command(replace(paused, **changes)) == text


def test_log_is_shown_while_an_answer_is_added():
    log: deque[LogEntry] = deque(maxlen=2)

    class Kind(str):
        def __hash__(self):
            log.appendleft(LogEntry(2.0, "note", "your click"))
            return super().__hash__()

    log.append(LogEntry(1.0, Kind("note"), "paused"))

    assert "paused" in render_log(log)


def test_busy_computer_is_not_taken_for_a_silent_skin():
    monitor = SkinMonitor(mounted().skin, SkinMonitorConfig(), START)
    late = START + NS_PER_S
    assert monitor.find_problem(late).cause is Problem.STALE_SKIN
    problem = monitor.find_problem(late, is_busy=True)
    assert problem.cause is Problem.BUSY_COMPUTER
    assert "cable" not in problem.remedy


def make_source(scans):
    calibration = calibration_of(mounted().skin)
    info = SourceInfo("sim:test", mounted(), calibration, 50.0)
    return PlayedSource(info, scans, STEPPED, ManualClock())


def make_recognition(**options):
    recognizer = Recognizer(
        say_always("poke"), mounted(), calibration_of(mounted().skin)
    )
    return Recognition(recognizer, **options)


def test_viewer_shows_touches_and_detections_of_stream(monkeypatch):
    updates = []
    page = SimpleNamespace(give=updates.append, wants=lambda: True, close=lambda: None)
    monkeypatch.setattr("eskin.page.viewer.MAX_UPDATE_RATE", 1e9)
    monkeypatch.setattr("eskin.page.viewer.PageProcess", lambda *_: page)
    recognition = make_recognition(drop="never")
    viewer = Viewer(recognition, ViewerConfig(0))
    source = make_source(scans(mounted(), two_hands(mounted()), 50, 4.0))
    with Stream(source, [recognition, viewer]) as stream:
        stream.wait()
    assert len(updates) > 20
    touches = [touch for update in updates for touch in update.touches]
    assert touches and all(np.argmax(touch.probabilities) == 1 for touch in touches)
    assert any(update.contacts for update in updates)
    entries = [entry for update in updates for entry in update.log_entries]
    assert {e.gesture for e in entries if e.kind == "detection"} == {"poke"}
    assert updates[0].T_world_link.shape == (len(mounted().robot.link_names), 4, 4)


@pytest.mark.parametrize("asks", [True, False])
def test_viewer_shows_what_the_arm_asks_now(monkeypatch, asks):
    updates = []
    times = []
    page = SimpleNamespace(give=updates.append, wants=lambda: True, close=lambda: None)
    monkeypatch.setattr("eskin.page.viewer.MAX_UPDATE_RATE", 1e9)
    monkeypatch.setattr("eskin.page.viewer.PageProcess", lambda *_: page)
    board = QuestionBoard("poke", action="resume", left=0.75)

    def ask(now):
        times.append(now)
        return board

    recognition = make_recognition(drop="never")
    arm = RecordingArm(ManualClock())
    question = ask if asks else None
    viewer = Viewer(recognition, ViewerConfig(0), arm=arm, question=question)
    source = make_source(scans(mounted(), [], 50, 0.2))
    with Stream(source, [recognition, viewer]) as stream:
        stream.wait()
    expected = board if asks else QuestionBoard("")
    assert updates and {update.question for update in updates} == {expected}
    assert len(times) == len(updates) * asks
    assert all(abs(now - START) < NS_PER_S for now in times)


MADE = RecordingState("a_b.mcap", True)
SAVED = RecordingState("a_b.mcap", False)


@pytest.mark.parametrize(
    ("recording", "text"),
    [(None, ""), (MADE, "recording to a_b.mcap"), (SAVED, "saved to a_b.mcap")],
)
def test_page_tells_where_it_records(recording, text):
    shown = render_status(replace(make_update(), recording=recording))
    assert text in shown and shown.count("a_b.mcap") == bool(text)


def test_correction_of_a_touch_is_published_where_it_is_recorded(monkeypatch):
    page = SimpleNamespace(give=len, wants=lambda: False, close=lambda: None)
    monkeypatch.setattr("eskin.page.viewer.PageProcess", lambda *_: page)
    recognition = make_recognition(drop="never")
    kept = []
    states = [None]
    viewer = Viewer(recognition, ViewerConfig(0), recording=lambda: states[0])
    source = make_source(scans(mounted(), two_hands(mounted()), 50, 3.0))
    with Stream(source, [recognition, viewer]) as stream:
        stream.wait()
    viewer.context = SimpleNamespace(clock=ManualClock(START), publish=kept.append)
    [touch, *_] = viewer.touches
    for states[0], number, name, said in (
        (None, touch, "stroke", "not kept: nothing is recorded; press record"),
        (SAVED, touch, "stroke", "not kept: nothing is recorded"),
        (MADE, touch, " ", "not kept: gesture ' ' is empty"),
        (MADE, touch, "unknown", "not kept: gesture 'unknown'"),
        (MADE, touch, "Stroke", "not kept: gestures 'stroke' and 'Stroke' differ"),
        (MADE, 999, "stroke", "not kept: the touch"),
        (MADE, touch, "Мой взмах+", "kept: that was a Мой взмах+"),
        (MADE, touch, "мой_взмах+", "not kept: gestures 'Мой взмах+' and 'мой_"),
    ):
        viewer.take_order(CorrectionOrder(number, name))
        assert said in viewer.encoder.log_entries[-1].text
    viewer.publish_corrections([touch])
    assert not kept, "the touch goes on"
    for _ in range(2):
        viewer.publish_corrections([])
    [correction] = kept
    assert correction.gesture == "Мой взмах+"
    assert START <= correction.start < correction.end <= START + 3_000_000_000


def wait_until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "too late"
        time.sleep(0.01)


@pytest.fixture
def make_page():
    """Start pages that are closed at the end."""
    pages = []

    def make(on_order=None):
        pages.append(PageProcess(make_setup(), 0, on_order))
        return pages[-1]

    yield make
    for page in pages:
        page.close()


def test_taken_port_is_refused_in_one_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(DeviceError, match=f"port {port}.*--port") as error:
            PageProcess(make_setup(), port, None)
        assert "\n" not in str(error.value)
        recognition = make_recognition()
        viewer = Viewer(recognition, ViewerConfig(port))
        with pytest.raises((StreamError, OSError), match=f"port {port}"):
            with Stream(make_source([]), [recognition, viewer]):
                pass
    free_port(port)


def test_page_is_served_to_this_computer_only(make_page):
    page = make_page(lambda order: None)
    page.wait_ready(60.0)
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", page.port), 1):
        pass


def test_stalled_page_misses_updates_and_delays_nobody(make_page):
    page = make_page(lambda order: None)
    page.wait_ready(60.0)
    wait_until(page.wants)
    os.kill(page.process.pid, signal.SIGSTOP)
    try:
        before = page.updates
        for index in range(500):
            page.give(make_update(index * 0.04))
        assert page.updates - before == 500
        assert page.in_flight <= MAX_IN_FLIGHT
        shown = page.shown
    finally:
        os.kill(page.process.pid, signal.SIGCONT)
    wait_until(lambda: page.in_flight == 0 and page.latest is None)
    assert page.shown - shown <= MAX_IN_FLIGHT + 1


KILL = PageOrder("kill", 0.1)
CORRECTION = CorrectionOrder(1, "poke")
BALL = PaintOrder(1, "forearm_link", (0.0, 0.0, 0.1), 0.03, False)


@pytest.mark.parametrize(
    ("offers", "allowed"),
    [
        ({}, []),
        ({"touchable": True}, [ORDER, KILL]),
        ({"corrects": True}, [CORRECTION]),
        ({"paints": True}, [KILL, BALL]),
    ],
)
def test_page_may_send_only_orders_of_what_it_offers(offers, allowed):
    orders = []
    page = PageProcess(replace(make_setup(False), **offers), 0, orders.append)
    try:
        for order in (ORDER, KILL, CORRECTION, BALL):
            page.queue_order(order)
        wait_until(lambda: len(orders) == len(allowed))
    finally:
        page.close()
    assert page.dropped == 4 - len(allowed) and orders == allowed


def test_orders_beyond_queue_are_dropped(make_page):
    executing = threading.Event()
    page = make_page(lambda order: executing.wait(10.0))
    try:
        for _ in range(MAX_ORDERS + 10):
            page.queue_order(ORDER)
        assert 9 <= page.dropped <= 10
    finally:
        executing.set()


def test_page_that_dies_is_logged_once(make_page, caplog):
    page = make_page()
    page.wait_ready(60.0)
    with caplog.at_level(logging.ERROR):
        page.process.kill()
        page.process.wait()
        for thread in page.threads[:2]:
            page.give(make_update())
            thread.join(5.0)
    assert [record.message for record in caplog.records] == [page.failure]


def test_page_ends_with_killed_parent():
    code = (
        "import time\n"
        "from helpers.viewer import make_setup\n"
        "from eskin.page.process import PageProcess\n"
        "page = PageProcess(make_setup(), 0, None)\n"
        "page.wait_ready(60)\n"
        "print(page.process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        child = int(parent.stdout.readline())
        parent.kill()
    wait_until(lambda: not is_alive(child))


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
