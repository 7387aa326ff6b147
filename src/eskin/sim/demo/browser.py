"""This module serves the demonstration in the browser, where the mouse is the hand."""

import gc
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event as Flag
from threading import Lock
from typing import final

import numpy as np

from eskin.arms import SimulatedArm, Task
from eskin.command import (
    Policy,
    PolicyConfig,
    QuestionConfig,
    SkinMonitorConfig,
    load_commands,
)
from eskin.drivers import Clock, Event, FixedJoints, HostClock
from eskin.errors import DeviceError, EskinError
from eskin.live import Detection, Recognizer, load_model, warm_up
from eskin.page import Order, PageOrder, RecordingState, TouchOrder
from eskin.page.process import free_port, make_token
from eskin.page.viewer import (
    Viewer,
    ViewerConfig,
    describe_question,
    describe_rules,
)
from eskin.recording import PARTLY_LABELLED, Metadata
from eskin.recording.mcap_file import MCAP_SUFFIX
from eskin.robot import Kinematics, load_robot
from eskin.sim.demo.headless import DemoConfig, build_arm, is_on_arm
from eskin.sim.demo.live_source import LiveSource, WaitingClock
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.stream import (
    Context,
    Correction,
    Listener,
    Message,
    Recognition,
    Recorder,
    Stream,
    short_switch_interval,
    stop_on_signals,
)
from eskin.stream.listener import Drop
from eskin.touch import Scan


@final
class RecordButton(Listener):
    """Records from each `press` to the next `release`, each time into a new file."""

    name = "record button"
    message_types = (Scan, Detection, Event, Correction)
    size = 2000
    drop: Drop = "newest"

    def __init__(self, folder: Path, metadata: Metadata) -> None:
        """Record nothing yet."""
        self.folder = folder
        self.metadata = metadata
        self.recorder: Recorder | None = None
        self.saved: RecordingState | None = None
        self.lock = Lock()

    def start(self, context: Context) -> None:
        """Keep the context for recordings."""
        self.context = context

    def press(self) -> None:
        """Start a recording, unless one is running.

        Raises:
            RecordingError: the file cannot be written.
        """
        with self.lock:
            if self.recorder is None:
                name = time.strftime("touches-%Y%m%d-%H%M%S") + MCAP_SUFFIX
                recorder = Recorder(self.folder / name, self.metadata)
                recorder.start(self.context)
                self.recorder = recorder

    def release(self) -> None:
        """Finish the recording, if there is one."""
        with self.lock:
            recorder = self.recorder
            self.recorder = None
            if recorder is not None:
                recorder.close()
                self.saved = RecordingState(str(recorder.path), False)

    def describe(self) -> RecordingState | None:
        """Return the state of the recording; None before the first."""
        recorder = self.recorder
        if recorder is None:
            return self.saved
        return RecordingState(str(recorder.path), True)

    def on_message(self, item: Message) -> None:
        """Record a message while recording."""
        with self.lock:
            if self.recorder is not None:
                self.recorder.on_message(item)

    def close(self) -> None:
        """Finish the recording, if there is one."""
        self.release()


@final
class PageOrderHandler:
    """Applies orders of a page to the simulated skin and arm.

    A touch goes through the same hand, contact and sensor as the training data: the
    recogniser does not know which gesture was meant.
    """

    def __init__(
        self,
        skin: InteractiveSkin,
        arm: SimulatedArm | None,
        button: RecordButton | None = None,
        choice: "SkinChoice | None" = None,
    ) -> None:
        """Store the skin and the arm that orders apply to.

        The arm is paused, and unlocked as at the robot; it is None for a robot that
        stands still. Without a button nothing is recorded, and without a choice the
        skin stays.
        """
        self.skin = skin
        self.arm = arm
        self.button = button
        self.choice = choice
        self.dragged: dict[int, int] = {}

    def handle(self, order: Order) -> None:
        """Apply an order."""
        if isinstance(order, TouchOrder):
            self.handle_touch(order)
        elif isinstance(order, PageOrder):
            self.handle_other(order)

    def handle_or_log(self, order: Order) -> None:
        """Apply an order, or log why it cannot be applied."""
        try:
            self.handle(order)
        except (EskinError, ValueError) as error:
            logger.warning("%s", error)

    def handle_touch(self, order: TouchOrder) -> None:
        """Begin, move or end a touch of the skin."""
        hand = self.skin.hand
        place = LinkPoint(order.link, np.array(order.p_link, np.float64))
        match order.kind:
            case "poke":
                hand.poke(place, order.force, order.seconds)
            case "double_pat":
                hand.double_pat(place, order.force, order.seconds)
            case "grab":
                hand.grab(place, order.force, order.seconds)
            case "begin":
                self.dragged[order.key] = hand.begin(place, order.force)
            case "move":
                if order.key in self.dragged:
                    hand.move(self.dragged[order.key], place)
            case "end":
                if order.key in self.dragged:
                    hand.end(self.dragged.pop(order.key))

    def handle_other(self, order: PageOrder) -> None:
        """Apply an order other than a touch."""
        match order.kind:
            case "unplug":
                self.skin.unplug(str(order.value))
            case "plug":
                self.skin.plug(str(order.value))
            case "kill":
                self.skin.kill(float(order.value or 0.0))
            case "restore":
                self.skin.restore()
            case "pause_task" if self.arm is not None:
                self.arm.pause()
            case "resume_task" if self.arm is not None:
                self.arm.unlock()
                self.arm.release()
                self.arm.resume()
            case "record" if self.button is not None:
                self.button.press()
            case "stop_recording" if self.button is not None:
                self.button.release()
            case "skin" if self.choice is not None:
                self.choice.choose(str(order.value))


SKINS = ("ur5", "ur5-half", "ur5-double", "ur5-shapes", "ur5-missing")
"""Preset skins that fit the arm."""

MONITOR = SkinMonitorConfig(max_age=0.4, max_silence=0.4)
"""Limits of the skin monitor, beyond what simulated time may be ahead of a reading."""

ANSWER_SECONDS = 3.0
"""Time to begin the answer to a question: a mouse takes longer than a hand at the arm,
for which `QuestionConfig` has 1 s [s]."""

READY_TIMEOUT = 60.0
"""Longest time until the page is served [s]."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PageResult:
    """Counts what happened while a page was served."""

    readings: int
    """Number of scans that were read."""
    detections: int
    """Number of detections."""
    commands: int
    """Number of commands that were executed."""
    step: tuple[float, float]
    """Time of a recognition step, p50 and p99 [ms]."""


def serve(
    config: DemoConfig,
    port: int,
    seconds: float | None = None,
    tell: Callable[[str], None] = lambda link: None,
) -> PageResult:
    """Serve the page until time is up or a signal comes.

    The skin can be changed in the page. Port 0 is any free one; without `seconds` there
    is no end; `tell` is called with the link of the page.

    Raises:
        DeviceError: the port is not available.
        StreamError: something failed while it ran.
    """
    # The same link throughout: an open page stays open when the skin is changed in it.
    port = free_port(port)
    token = make_token()
    while True:
        choice = SkinChoice()
        page = ViewerConfig(port, touchable=True, token=token)
        with run_demo(config, page, choice) as demo:
            tell(demo.link)
            demo.stream.wait(seconds)
        if choice.skin is None:
            step = demo.recognition.step
            return PageResult(
                readings=demo.source.given,
                detections=demo.recognition.detections,
                commands=0 if demo.policy is None else demo.policy.accepted,
                step=(1e3 * step.quantile(0.5), 1e3 * step.quantile(0.99)),
            )
        config = replace(config, skin=choice.skin)


@dataclass(frozen=True, eq=False)
class RunningDemo:
    """Holds a served page and the parts behind it."""

    link: str
    """Link that opens the page."""
    arm: SimulatedArm | None
    """Arm at its task; None where another robot stands still."""
    source: LiveSource
    """Source that scans the skin on the arm."""
    recognition: Recognition
    """Listener that recognises touches."""
    policy: Policy | None
    """Listener that commands the arm; None without one."""
    stream: Stream
    """Stream from the source to the listeners."""


@final
class SkinChoice:
    """Stores the skin chosen in the page, and stops the stream to change to it."""

    def __init__(self) -> None:
        """Start without a choice."""
        self.skin: str | None = None
        self.stop: Callable[[], None] = Flag().set

    def choose(self, skin: str) -> None:
        """Choose another skin, and stop the stream."""
        self.skin = skin
        self.stop()


@contextmanager
def run_demo(
    config: DemoConfig,
    page: ViewerConfig,
    choice: SkinChoice,
    clock: Clock | None = None,
) -> Iterator[RunningDemo]:
    """Serve one skin on its arm while the context lasts; signals stop the stream.

    The skins are added to `page`; `choice` receives another skin that is chosen in it.
    Arm and skin have the clock of this computer unless one is given.

    Raises:
        DeviceError: the port is not available, or a robot that stands still is to be
            commanded or to have dynamics.
        CommandError: the command map cannot be used.
        StreamError: something failed while it ran.
    """
    model = load_model(config.model)
    skin = build_skin(config)
    recognizer = Recognizer(model, skin.mounted, skin.calibration)
    warm_up(recognizer)
    warm_up_hand(config)
    clock = WaitingClock(clock or HostClock())
    recognition = Recognition(recognizer)
    metadata = Metadata("demo", "mouse", "browser", notes=PARTLY_LABELLED)
    button = RecordButton(Path.cwd(), metadata)
    with ExitStack() as stack:
        if is_on_arm(skin):
            arm = stack.enter_context(build_arm(config, clock))
            words = model.card.vocabulary
            commands = load_commands(
                config.commands,
                words,
                skin.mounted.skin,
                simulated=True,
            )
            # Time waits for the policy, so nothing needs to watch its readings.
            config_of_policy = PolicyConfig(
                monitor=MONITOR,
                question=QuestionConfig(window=ANSWER_SECONDS),
                check_period=None,
            )
            policy = Policy(arm, commands, words, config_of_policy)
            page = complete_page(config, page, arm, policy)
            question = partial(describe_question, policy)
            source = LiveSource(
                skin, arm, clock, after_scan=lambda: arm.apply_wrenches(skin.wrenches)
            )
        else:
            if config.commands is not None or config.dynamics:
                raise DeviceError(
                    "commands or dynamics are asked for on robot "
                    f"'{skin.wearer.name}', which stands still; allowed are both on "
                    "ur5; leave them out"
                )
            arm = policy = question = None
            page = replace(page, skins=(config.skin,))
            q = np.zeros(len(skin.mounted.robot.joint_names))
            source = LiveSource(skin, FixedJoints(q), clock)
        handler = PageOrderHandler(skin, arm, button, choice)
        viewer = Viewer(
            recognition, page, handler.handle_or_log, arm, button.describe, question
        )
        gc.unfreeze()
        gc.collect()
        gc.freeze()
        commanding = () if policy is None else (policy,)
        stream = Stream(source, [recognition, *commanding, viewer, button])
        choice.stop = stream.stop
        with short_switch_interval(), stream:
            if policy is not None:
                clock.latest = lambda: policy.monitor.latest
            link = viewer.wait_ready(READY_TIMEOUT)
            with stop_on_signals(stream.stop):
                yield RunningDemo(
                    link=link,
                    arm=arm,
                    source=source,
                    recognition=recognition,
                    policy=policy,
                    stream=stream,
                )


TOOL_LENGTH = 0.1
"""Distance from the tool's link to the part between the fingers [m]."""


def complete_page(
    config: DemoConfig, page: ViewerConfig, arm: SimulatedArm, policy: Policy
) -> ViewerConfig:
    """Add the skins to choose from, the commands and the places of the task."""
    others = () if config.robot else [name for name in SKINS if name != config.skin]
    return replace(
        page,
        skins=(config.skin, *others),
        commands=describe_rules(policy.commands),
        places=locate_places(arm.executor.task),
    )


def locate_places(task: Task) -> tuple[tuple[str, tuple[float, float, float]], ...]:
    """Return the places at which a task takes and brings parts, in the world [m]."""
    robot = load_robot(task.robot_name)
    kinematics = Kinematics(robot)
    tool = robot.link_index(task.tool)
    found = []
    for waypoint in task.waypoints:
        if waypoint.purpose is not None:
            T_world_tool = kinematics.poses(np.array(waypoint.q))[tool]
            x, y, z = (T_world_tool @ (0.0, 0.0, TOOL_LENGTH, 1.0))[:3].tolist()
            found.append((waypoint.name, (x, y, z)))
    return tuple(found)


def build_skin(config: DemoConfig) -> InteractiveSkin:
    """Build the simulated skin of a demonstration, which loses no scans."""
    return InteractiveSkin(
        config.skin, config.seed, config.build_kind, loses=False, robot=config.robot
    )


def warm_up_hand(config: DemoConfig) -> None:
    """Compile or load all code that a touch needs, on a second simulated skin."""
    skin = build_skin(config)
    q = np.zeros(len(skin.mounted.robot.joint_names))
    for number in range(40):
        if number == 5:
            skin.hand.perform("poke")
        skin.scan(number + 1, q)
