"""This module shows a stream in the browser, or a calibration."""

from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from threading import Event as Flag
from time import monotonic
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float16

from eskin.command import ASK, SUSPEND, Arm, ArmState, CommandMap, Policy
from eskin.drivers import Event
from eskin.errors import DeviceError, RecordingError
from eskin.live import UNKNOWN, Detection
from eskin.page.appearance import describe_scene
from eskin.page.html import ASKED, AT_WORK, HOW, name_question, to_words
from eskin.page.messages import (
    ArmCondition,
    ArmSummary,
    ContactMarker,
    CorrectionOrder,
    EntryKind,
    GuideBoard,
    LogEntry,
    OpenTouch,
    Order,
    PageOrder,
    QuestionBoard,
    RecordingState,
    SceneDescription,
    TouchRule,
    ViewUpdate,
)
from eskin.page.process import (
    DEFAULT_PORT,
    FLAG_TICK,
    PageProcess,
    format_link,
    make_token,
)
from eskin.recording.records import NONE, check_new_name
from eskin.skin import MountedSkin
from eskin.stream import (
    CommandEvent,
    Context,
    Correction,
    Listener,
    Message,
    Recognition,
    RecognitionState,
)
from eskin.stream.listener import RARE, Drop
from eskin.touch import Contact, TouchState
from eskin.transforms import apply, invert, rotate
from eskin.units import NS_PER_S

MAX_LOG_ENTRIES = 32
"""Greatest number of log entries that wait for an update; older ones are dropped."""
MAX_CONTACTS = 8
"""Greatest number of contacts in an update."""


@final
class FrameEncoder:
    """Builds updates of the page, and holds log entries until the next update."""

    def __init__(self, mounted: MountedSkin, begin: int) -> None:
        """Start with an empty log.

        Args:
            mounted: skin on its robot.
            begin: stamp of time zero [ns since the epoch].
        """
        self.mounted = mounted
        self.begin = begin
        self.log_entries: deque[LogEntry] = deque(maxlen=MAX_LOG_ENTRIES)
        joints = len(mounted.robot.joint_names)
        self.T_world_link = mounted.kinematics.poses(np.zeros(joints))

    def seconds(self, stamp: int) -> float:
        """Return the time of a stamp since `begin` [s]."""
        return (stamp - self.begin) / NS_PER_S

    def log(self, stamp: int, kind: EntryKind, text: str) -> None:
        """Add a line of a time and a kind to the log."""
        self.log_entries.append(LogEntry(self.seconds(stamp), kind, text))

    def note(self, item: object) -> None:
        """Add a detection, an event or a command to the log."""
        match item:
            case Detection():
                self.log_entries.append(self.describe_detection(item))
            case Event():
                self.log(item.stamp, "event", to_words(item.text))
            case CommandEvent():
                kind = "command" if item.accepted else "refused"
                self.log(item.stamp, kind, describe_command(item))

    def describe_detection(self, detection: Detection) -> LogEntry:
        """Return the log entry of a detection, with its position on its link."""
        link = self.mounted.robot.link_index(detection.link)
        x, y, z = apply(invert(self.T_world_link[link]), detection.p_world).tolist()
        name = to_words(detection.gesture)
        label = f"{name} {detection.confidence:.0%}"
        if detection.gesture == UNKNOWN and detection.likeliest:
            likeliest = to_words(detection.likeliest)
            name = "no gesture" if likeliest == NONE else likeliest
            label = f"{name}, probably ({detection.confidence:.0%})"
        where = f"{detection.peak_force:.0f} N, {to_words(detection.patch)}"
        return LogEntry(
            self.seconds(detection.stamp),
            "detection",
            f"{label}, {where}",
            detection.gesture,
            link,
            (x, y, z),
            detection.touch,
            label,
        )

    def build_update(self, recognised: RecognitionState, rate: float) -> ViewUpdate:
        """Return the update that shows a recognition at a rate of readings [1/s].

        Its other fields are set by `dataclasses.replace`.
        """
        state = recognised.state
        reading = state.reading
        self.T_world_link = self.mounted.kinematics.poses(reading.q)
        contacts = sorted(state.contacts, key=lambda contact: -contact.force)
        entries = tuple(self.log_entries)
        for _ in entries:
            self.log_entries.popleft()
        return ViewUpdate(
            seconds=self.seconds(reading.stamp),
            T_world_link=self.T_world_link,
            pressure=np.where(reading.valid, reading.pressure, 0.0).astype(np.float16),
            valid=reading.valid,
            contacts=tuple(map(self.build_marker, contacts[:MAX_CONTACTS])),
            touches=self.build_touches(recognised),
            force=sum((contact.force for contact in contacts), 0.0),
            peak=max((contact.peak for contact in contacts), default=0.0),
            log_entries=entries,
            rate=rate,
        )

    def build_marker(self, contact: Contact) -> ContactMarker:
        """Return the marker of a contact, in the frame of its link."""
        link = self.mounted.robot.link_index(contact.link)
        n_link = rotate(invert(self.T_world_link[link]), contact.n_world)
        radius = float(np.sqrt(contact.area / np.pi))
        return ContactMarker(
            link, contact.p_link, n_link, radius, contact.force, contact.patch
        )

    def build_touches(self, recognised: RecognitionState) -> tuple[OpenTouch, ...]:
        """Return the open touches with their probabilities, strongest first."""
        found = [
            OpenTouch(
                touch.id,
                touch.contact.patch,
                touch.contact.force,
                recognised.probabilities[touch.id].astype(np.float32),
            )
            for touch in recognised.state.touches
            if touch.id in recognised.probabilities
        ]
        return tuple(sorted(found, key=lambda touch: -touch.force))


DONE = {
    "pause": "paused",
    "hold": "stopped",
    "resume": "resumed",
    "slow": "slowed",
    "normal": "at full speed",
    "next_waypoint": "on to the next waypoint",
    "previous_waypoint": "back to the waypoint before",
    "jog": "moved a little",
    "close_gripper": "gripper closes",
    "open_gripper": "gripper opens",
}
"""What the log says of an action that was carried out."""


def describe_rules(commands: CommandMap) -> tuple[TouchRule, ...]:
    """Return what each gesture commands by a command map."""
    return tuple(
        TouchRule(rule.gesture, rule.where, rule.actions) for rule in commands.commands
    )


def describe_question(policy: Policy, now: int) -> QuestionBoard:
    """Return what a policy asks, and what a person has to observe before it asks again.

    Args:
        policy: policy that commands the arm.
        now: time [ns since the epoch].
    """
    commands = policy.commands
    question = policy.question
    answer = commands.answer if commands.asks else ""
    rest = 0.0
    if policy.failed_at is not None:
        rest = policy.config.question.quiet_after_failure
    if question is None:
        return QuestionBoard(answer, rest)
    request = question.request
    window = question.deadline - question.asked_at
    return QuestionBoard(
        answer=answer,
        rest=rest,
        action=request.rule.function or request.action,
        link=request.detection.link,
        left=min(max((question.deadline - now) / window, 0.0), 1.0),
        is_answering=question.is_answering,
    )


def describe_command(command: CommandEvent) -> str:
    """Return what the log says of a command: what was done, or why it was not."""
    action = command.action
    why = command.why
    if action == SUSPEND:
        return "stands still while it is touched"
    if action == ASK:
        return to_words(f"asks: {why}")
    if not command.accepted:
        was_asked_for = command.touch is not None and action != "none"
        asked = ASKED.get(action, action)
        return to_words(f"{asked} refused: {why}" if was_asked_for else why)
    if command.likeliest:
        why = f"probably a {command.likeliest}"
    done = DONE.get(action, action)
    return to_words(f"{done} ({why})")


def build_still(
    mounted: MountedSkin,
    seconds: float,
    q: Float[np.ndarray, "joint"],
    pressure: Float16[np.ndarray, "taxel"],
    valid: Bool[np.ndarray, "taxel"],
) -> ViewUpdate:
    """Return an update that shows pressures [kPa] without contacts and touches."""
    return ViewUpdate(
        seconds=seconds,
        T_world_link=mounted.kinematics.poses(q),
        pressure=pressure,
        valid=valid,
    )


NEVER_ASKS = QuestionBoard("")
"""Question of an arm that never asks."""


def describe_arm(
    arm: ArmState,
    commands: Sequence[TouchRule] = (),
    board: QuestionBoard = NEVER_ASKS,
    by_mouse: bool = False,
) -> ArmSummary:
    """Return the summary of an arm's state, with its reason and how to go on.

    Args:
        arm: state of the arm.
        commands: what each gesture commands.
        board: what the arm asks.
        by_mouse: whether the mouse is the hand.
    """
    state: ArmCondition = "running" if arm.moving else "standing"
    if arm.moving and arm.speed_limit == 0:
        state = "stopping"
    why = ""
    if not arm.connected or arm.protective_stop:
        state = "stopped"
        why = str(arm.problem)
    elif arm.hold_reason is not None:
        state = "held"
        why = str(arm.hold_reason)
    elif arm.paused:
        state = "paused"
    elif board.action:
        why = "until its question is answered"
    elif arm.speed_limit == 0:
        why = "while it is touched"
    elif arm.speed_limit < 1:
        why = "slowly because of its skin, as the log says"
    elif arm.gripping is not None:
        why = "while its gripper moves"
    if board.action:
        remedy = describe_answer(board, by_mouse)
    elif state not in AT_WORK:
        remedy = describe_way(commands, arm.paused, board, by_mouse)
    elif board.rest:
        remedy = describe_rest(board)
    else:
        remedy = describe_speeding_up(commands, arm, board, by_mouse)
    # The speed that was chosen stays while the arm stands for a touch or a question.
    limit = arm.speed_limit or 1.0
    return ArmSummary(
        state,
        why,
        min(arm.speed, limit),
        arm.gripper,
        arm.target,
        remedy,
        arm.carrying,
    )


def describe_rest(board: QuestionBoard) -> str:
    """Return for how long nothing may touch an arm at work before it is asked again."""
    return f"Touch nothing for {board.rest:g} s, then it can be asked again."


def describe_touch(gesture: str, by_mouse: bool) -> str:
    """Return a gesture, and how the mouse makes it where the mouse is the hand."""
    how = f" ({HOW[gesture]})" if by_mouse and gesture in HOW else ""
    return f"{to_words(gesture)}{how}"


def find_touches(
    commands: Sequence[TouchRule], action: str, by_mouse: bool
) -> list[str]:
    """Return the gestures that command an action, as `describe_touch` does."""
    return [
        describe_touch(rule.gesture, by_mouse)
        for rule in commands
        if action in rule.actions
    ]


def describe_answer(board: QuestionBoard, by_mouse: bool) -> str:
    """Return what an arm asks and how to answer; the question must be open."""
    question = name_question(board.action)
    if board.is_answering:
        return f"{question} Let go and wait."
    answer = describe_touch(board.answer, by_mouse)
    return f"{question} Answer: {answer} on the {to_words(board.link)}."


def describe_speeding_up(
    commands: Sequence[TouchRule],
    arm: ArmState,
    board: QuestionBoard,
    by_mouse: bool,
) -> str:
    """Return what gives a slow arm its full speed; empty where there is nothing to do.

    Args:
        commands: what each gesture commands.
        arm: state of the arm.
        board: what the arm asks.
        by_mouse: whether the mouse is the hand.
    """
    touches = find_touches(commands, "normal", by_mouse)
    if arm.speed == 1 or not touches:
        return ""
    steps = [touches[0]]
    if board.answer:
        steps.append(f"{describe_touch(board.answer, by_mouse)} there when it asks")
    return f"To full speed: {', then '.join(steps)}."


def describe_way(
    commands: Sequence[TouchRule],
    paused: bool,
    board: QuestionBoard,
    by_mouse: bool,
) -> str:
    """Return what lets a stopped arm go on; empty where no touch does.

    An arm that is not paused must be before a touch can resume it. After a question
    that was not answered, the skin must stay untouched before the next.

    Args:
        commands: what each gesture commands.
        paused: whether the arm is paused.
        board: what the arm asks.
        by_mouse: whether the mouse is the hand.
    """
    pausing = find_touches(commands, "pause", by_mouse)
    resuming = find_touches(commands, "resume", by_mouse)
    if not resuming or not (paused or pausing):
        return ""
    steps = [] if paused else [pausing[0]]
    if board.rest:
        steps.append(f"touch nothing for {board.rest:g} s")
    elif not paused:
        steps.append("wait 1 s")
    steps.append(resuming[0])
    if board.answer:
        steps.append(f"{describe_touch(board.answer, by_mouse)} there when it asks")
    return f"To go on: {', then '.join(steps)}."


MAX_UPDATE_RATE = 25.0
"""Greatest rate of updates [1/s]."""
MAX_TOUCHES = 100
"""Greatest number of touches that can still be corrected."""
LAST_CONTACT = NS_PER_S // 50
"""Time from the last reading in contact until a touch is over [ns]."""


@dataclass(frozen=True)
class ViewerConfig:
    """Configures the port of the page and the actions that it offers."""

    port: int = DEFAULT_PORT
    """Port of 127.0.0.1; 0 for any free one."""
    touchable: bool = False
    """Whether the page may send touches and other orders.

    Do not set it with a real robot, unless its owner permits it.
    """
    skins: tuple[str, ...] = ()
    """Skins offered for selection; the first is the current one."""
    warning: str = ""
    """Warning that the page always shows, such as that packets are unauthenticated."""
    commands: tuple[TouchRule, ...] = ()
    """What each gesture commands."""
    places: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    """Name of each place of the task, and where parts are put there, in the world frame
    [m]."""
    token: str = field(default_factory=make_token, repr=False)
    """Token of the link that opens the page; by default a new one."""

    @property
    def link(self) -> str:
        """Link that opens the page, unless the port is any free one."""
        return format_link(self.port, self.token)


@final
class Viewer(Listener):
    """Shows a stream in the browser and forwards the orders given there.

    The page runs in a process of its own. This process only builds an update 25 times
    a second, and skips it while the page has not shown those before.

    Attributes:
        page: process of the page; None before the start and after the end.
    """

    name = "viewer"
    message_types = (RecognitionState, *RARE)
    size = 64
    drop: Drop = "oldest"

    def __init__(
        self,
        recognition: Recognition,
        config: ViewerConfig | None = None,
        on_order: Callable[[Order], None] | None = None,
        arm: Arm | None = None,
        recording: Callable[[], RecordingState | None] | None = None,
        question: Callable[[int], QuestionBoard] | None = None,
    ) -> None:
        """Prepare the viewer; the page starts with the stream.

        Args:
            recognition: recognition that publishes the states to show.
            config: configuration of the page.
            on_order: function called with each order, on a thread of its own.
            arm: arm to show the state of.
            recording: function that returns the state of the recording, None before
                the first. With it, detections can be corrected in the page.
            question: function that describes what the arm asks at a time [ns since the
                epoch]; None for an arm that never asks.
        """
        self.recognition = recognition
        self.config = config or ViewerConfig()
        self.on_order = on_order
        self.arm = arm
        self.recording = recording
        self.question = question
        self.touches: dict[int, tuple[int, int]] = {}
        self.corrected: dict[int, str] = {}
        self.names = [*recognition.recognizer.model.card.vocabulary]
        self.page: PageProcess | None = None
        self.due = self.counted_from = 0.0
        self.count = 0
        self.rate = 0.0

    @property
    def mounted(self) -> MountedSkin:
        """Skin that the page shows, on its robot."""
        return self.recognition.recognizer.mounted

    def start(self, context: Context) -> None:
        """Start the page's process.

        Raises:
            DeviceError: the port is not available.
        """
        self.context = context
        self.encoder = FrameEncoder(self.mounted, context.clock.now())
        self.page = PageProcess(
            self.describe_scene(), self.config.port, self.take_order, self.config.token
        )

    def take_order(self, order: Order) -> None:
        """Carry out an order of the page; touches and others go to `on_order`."""
        if isinstance(order, CorrectionOrder):
            self.correct(order)
        elif self.on_order is not None:
            self.on_order(order)

    def correct(self, order: CorrectionOrder) -> None:
        """Note what a touch was, for the recording, and say so in the log."""
        known = self.touches.get(order.touch)
        gesture = order.gesture
        text = "not kept: nothing is recorded; press record first"
        if known is None:
            text = "not kept: the touch is not known"
        elif self.is_recording:
            try:
                check_new_name(gesture, self.names)
                self.corrected[order.touch] = gesture
                self.names.append(gesture)
                text = f"kept: that was a {to_words(gesture)}"
            except RecordingError as error:
                text = f"not kept: {error}"
        self.encoder.log(self.context.clock.now(), "note", text)

    def publish_corrections(self, going_on: Collection[int]) -> None:
        """Publish corrections, but not yet of touches that go on, by their ids.

        A touch may be recognised, and corrected, before it has ended.
        """
        for touch in [each for each in self.corrected if each not in going_on]:
            start, last = self.touches[touch]
            now = self.context.clock.now()
            gesture = self.corrected.pop(touch)
            self.context.publish(Correction(now, start, last + LAST_CONTACT, gesture))

    @property
    def is_recording(self) -> bool:
        """Whether a recording is made now."""
        state = None if self.recording is None else self.recording()
        return state is not None and state.is_on

    def note_touches(self, state: TouchState) -> None:
        """Note first and latest contact of the touches of a reading [ns]."""
        for row in state.rows:
            self.touches[row.id] = row.onset, row.last
        while len(self.touches) > MAX_TOUCHES:
            del self.touches[next(iter(self.touches))]

    def describe_scene(self) -> SceneDescription:
        """Return the description of the scene, which is sent once."""
        gestures = self.recognition.recognizer.model.card.vocabulary
        return replace(
            describe_scene(self.mounted, gestures),
            touchable=self.config.touchable,
            skins=self.config.skins,
            is_arm=self.arm is not None,
            warning=self.config.warning,
            commands=self.config.commands,
            corrects=self.recording is not None,
            places=self.config.places,
        )

    def on_message(self, item: Message) -> None:
        """Add a message to the log; show a recognition state at most every 40 ms."""
        if not isinstance(item, RecognitionState):
            self.encoder.note(item)
            return
        if item.state.open or item.state.closed:
            self.note_touches(item.state)
        if self.corrected:
            self.publish_corrections([touch.id for touch in item.state.open])
        now = monotonic()
        self.update_rate(self.context.clock.now() / NS_PER_S)
        if now < self.due or self.page is None or not self.page.wants():
            return
        self.due = max(self.due + 1 / MAX_UPDATE_RATE, now)
        update = replace(
            self.encoder.build_update(item, self.rate),
            step=self.recognition.step.quantile(0.5),
            age=self.context.age(item.state.reading.stamp),
            recording=None if self.recording is None else self.recording(),
        )
        if self.arm is not None:
            board = NEVER_ASKS
            if self.question is not None:
                board = self.question(self.context.clock.now())
            summary = describe_arm(
                self.arm.state(), self.config.commands, board, self.config.touchable
            )
            update = replace(update, arm=summary, question=board)
        self.page.give(update)

    def update_rate(self, now: float) -> None:
        """Measure the rate of readings once a second."""
        self.count += 1
        elapsed = now - self.counted_from
        if elapsed >= 1.0:
            self.rate = self.count / elapsed if self.counted_from else 0.0
            self.count = 0
            self.counted_from = now

    def wait_ready(self, timeout: float) -> str:
        """Wait until the page is served and return its link.

        The stream must have been started.

        Args:
            timeout: longest time to wait [s].

        Raises:
            DeviceError: the page is not served.
        """
        if self.page is None:
            raise DeviceError(
                "there is no page; allowed is the viewer of a running stream; start it"
            )
        return self.page.wait_ready(timeout)

    def close(self) -> None:
        """End the page's process."""
        if self.page is not None:
            self.page.close()
            self.page = None


@final
class CalibrationViewer:
    """Shows a calibration in the browser, and stores what the person clicks there.

    Attributes:
        opened: flag set once a browser has opened the page.
        closed: flag set once the person has closed it by its button.
        skipped: patch or point that the person wants to leave out; None where nothing
            is to be left out.
        repeated: number of presses of which the person wants to repeat the last; None
            where nothing is to be repeated.
    """

    def __init__(
        self, mounted: MountedSkin, rate: float, config: ViewerConfig | None = None
    ) -> None:
        """Start the page's process.

        Args:
            mounted: skin that is calibrated, on its robot.
            rate: rate of the scans [1/s].
            config: configuration of the page; nothing can be touched there.

        Raises:
            DeviceError: the port is not available.
        """
        config = config or ViewerConfig()
        self.rate = rate
        self.opened = Flag()
        self.closed = Flag()
        self.skipped: str | None = None
        self.repeated: int | None = None
        self.encoder: FrameEncoder | None = None
        self.mounted = mounted
        self.stamp = 0
        self.due = 0.0
        scene = replace(
            describe_scene(mounted, ()), calibrates=True, warning=config.warning
        )
        self.page = PageProcess(scene, config.port, self.take_order, config.token)

    def take_order(self, order: Order) -> None:
        """Store what the person has clicked."""
        if not isinstance(order, PageOrder):
            return
        match order.kind:
            case "opened":
                self.opened.set()
            case "skip":
                self.skipped = str(order.value)
            case "again":
                self.repeated = int(order.value or 0)
            case "close":
                self.closed.set()

    @property
    def is_opened(self) -> bool:
        """Return whether a browser has opened the page.

        Raises:
            DeviceError: the page cannot be served.
        """
        if self.page.failure is not None and not self.opened.is_set():
            raise DeviceError(self.page.failure)
        return self.opened.is_set()

    def wait_opened(self) -> None:
        """Wait until a browser has opened the page.

        Raises:
            DeviceError: the page cannot be served.
        """
        while not self.is_opened:
            self.opened.wait(FLAG_TICK)

    def wait_closed(self) -> None:
        """Wait until the person has closed the page, or its process has ended."""
        self.page.wait_for(self.closed)

    def wants(self) -> bool:
        """Return whether the page is to be given the latest scan."""
        return monotonic() >= self.due and self.page.wants()

    def tell(self, line: str) -> None:
        """Add a line to the log of the page."""
        if self.encoder is not None:
            self.encoder.log(self.stamp, "event", line.strip())

    def show(self, state: TouchState, board: GuideBoard) -> None:
        """Show pressures and contacts of a scan, and what to do next."""
        self.stamp = state.reading.stamp
        if self.encoder is None:
            self.encoder = FrameEncoder(self.mounted, self.stamp)
        self.due = monotonic() + 1 / MAX_UPDATE_RATE
        update = self.encoder.build_update(RecognitionState(state, {}, ()), self.rate)
        self.page.give(replace(update, guide=board))

    def close(self) -> None:
        """End the page's process."""
        self.page.close()
