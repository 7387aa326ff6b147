"""This module provides the browser view as a listener."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import monotonic
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float

from eskin.drivers import Event
from eskin.errors import DeviceError
from eskin.live import Detection
from eskin.page import (
    ArmSummary,
    ComparisonBoard,
    ContactMarker,
    LogEntry,
    OpenTouch,
    Order,
    SceneDescription,
    ViewUpdate,
)
from eskin.skin import MountedSkin
from eskin.stream import (
    CommandEvent,
    Context,
    Listener,
    Message,
    Recognition,
    RecognitionState,
    found_at_once,
)
from eskin.stream.listener import RARE, Drop
from eskin.touch import Contact
from eskin.transforms import apply, invert, matrix_to_quaternion, rotate
from eskin.units import NS_PER_S
from eskin.viewer.appearance import describe_scene
from eskin.viewer.process import PageProcess

MAX_LOG_ENTRIES = 32
"""Lines of the log that wait for a picture; older ones are dropped."""
MAX_CONTACTS = 8


@runtime_checkable
class ArmStatus(Protocol):
    """An arm's state, as far as the page shows it."""

    @property
    def moving(self) -> bool:
        """Whether a joint moves."""
        ...

    @property
    def paused(self) -> bool:
        """Whether a person asked it to pause."""
        ...

    @property
    def hold_reason(self) -> str | None:
        """Why it was stopped without being asked."""
        ...

    @property
    def speed(self) -> float:
        """Share of full speed."""
        ...

    @property
    def gripper(self) -> str:
        """`open` or `closed`."""
        ...

    @property
    def target(self) -> str:
        """Where it goes."""
        ...

    @property
    def protective_stop(self) -> bool:
        """Whether the robot has stopped itself."""
        ...

    @property
    def connected(self) -> bool:
        """Whether the robot is heard."""
        ...


@final
class FrameEncoder:
    """Makes pictures; holds what is said until the next one."""

    def __init__(self, mounted: MountedSkin, begin: int) -> None:
        """Start with nothing said.

        Args:
            mounted: the skin on its robot.
            begin: stamp from which time is counted [ns since the epoch].
        """
        self.mounted = mounted
        self.begin = begin
        self.log_entries: deque[LogEntry] = deque(maxlen=MAX_LOG_ENTRIES)
        self.told: Event | None = None
        robot = mounted.robot
        q = np.zeros(len(robot.joint_names))
        self.T_world_link = mounted.kinematics.poses(q)

    def seconds(self, stamp: int) -> float:
        """Since the beginning [s]."""
        return (stamp - self.begin) / NS_PER_S

    def note(self, item: object) -> None:
        """Keep a detection, an event or what was made of a touch for the log."""
        match item:
            case Detection():
                self.log_entries.append(self.detection(item))
            case Event() if found_at_once(self.told, item):
                pass  # of many faults found together one is told; their number is shown
            case Event():
                self.told = item
                self.log_entries.append(
                    LogEntry(self.seconds(item.stamp), "event", item.text)
                )
            case CommandEvent():
                kind = "command" if item.accepted else "refused"
                text = item.action + (f": {item.why}" if item.why else "")
                self.log_entries.append(LogEntry(self.seconds(item.stamp), kind, text))

    def detection(self, detection: Detection) -> LogEntry:
        """A detection with its place on its link."""
        link = self.mounted.robot.link_index(detection.link)
        x, y, z = apply(invert(self.T_world_link[link]), detection.p_world).tolist()
        name = detection.gesture.replace("_", "-")
        return LogEntry(
            self.seconds(detection.stamp),
            "detection",
            f"{name} {detection.confidence:.0%}, "
            f"{detection.peak_force:.0f} N, {detection.patch.replace('_', ' ')}",
            detection.gesture,
            link,
            (x, y, z),
        )

    def picture(
        self,
        moment: RecognitionState,
        rate: float,
        step: float,
        age: float,
        arm: ArmSummary | None,
    ) -> ViewUpdate:
        """Everything of one moment that the page shows.

        Args:
            moment: what is known.
            rate: readings a second [1/s].
            step: what recognising one takes [s].
            age: how old it was when all was said [s].
            arm: where there is one.
        """
        state = moment.state
        reading = state.reading
        self.T_world_link = self.mounted.kinematics.poses(reading.q)
        contacts = sorted(state.contacts, key=lambda contact: -contact.force)
        said = tuple(self.log_entries)
        for _ in said:
            self.log_entries.popleft()
        return ViewUpdate(
            seconds=self.seconds(reading.stamp),
            poses=pack_poses(self.T_world_link),
            pressure=np.where(reading.valid, reading.pressure, 0.0).astype(np.float16),
            valid=np.packbits(reading.valid),
            contacts=tuple(map(self.mark, contacts[:MAX_CONTACTS])),
            touches=self.touches(moment),
            force=sum((contact.force for contact in contacts), 0.0),
            peak=max((contact.peak for contact in contacts), default=0.0),
            log_entries=said,
            faults=len(state.faults),
            rate=rate,
            step=step,
            age=age,
            arm=arm,
        )

    def mark(self, contact: Contact) -> ContactMarker:
        """A contact in the frame of its link."""
        link = self.mounted.robot.link_index(contact.link)
        n_link = rotate(invert(self.T_world_link[link]), contact.n_world)
        radius = float(np.sqrt(contact.area / np.pi))
        return ContactMarker(link, contact.p_link, n_link, radius)

    def touches(self, moment: RecognitionState) -> tuple[OpenTouch, ...]:
        """Open touches with what is thought of them, strongest first."""
        found = [
            OpenTouch(
                touch.id,
                touch.contact.link,
                touch.contact.force,
                moment.probabilities[touch.id].astype(np.float32),
            )
            for touch in moment.state.touches
            if touch.id in moment.probabilities
        ]
        return tuple(sorted(found, key=lambda touch: -touch.force))


def pack_poses(
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> Float[np.ndarray, "link 7"]:
    """Quaternion and position of each link, in single precision."""
    wxyz = matrix_to_quaternion(T_world_link[:, :3, :3])
    return np.concatenate([wxyz, T_world_link[:, :3, 3]], axis=1).astype(np.float32)


def describe_arm(arm: ArmStatus) -> ArmSummary:
    """An arm's state in one word, with the reason."""
    speed, gripper, target = arm.speed, arm.gripper, arm.target
    if not arm.connected:
        return ArmSummary("stopped", "lost connection", speed, gripper, target)
    if arm.protective_stop:
        return ArmSummary("stopped", "protective stop", speed, gripper, target)
    if arm.hold_reason:
        return ArmSummary("held", arm.hold_reason, speed, gripper, target)
    if arm.paused:
        return ArmSummary("paused", "", speed, gripper, target)
    state = "running" if arm.moving else "waiting"
    return ArmSummary(state, "", speed, gripper, target)


PICTURES = 25.0
"""A second, at most [1/s]."""


@runtime_checkable
class ReportsState(Protocol):
    """An arm, as far as the page needs one."""

    def state(self) -> ArmStatus:
        """How it is now."""
        ...


@dataclass(frozen=True)
class ViewerConfig:
    """How the page is served, and what people may do in it."""

    port: int = 8080
    """Of 127.0.0.1; 0 for any free one."""

    touchable: bool = False
    """Whether touches and other orders are taken from the page. Never with a real
    robot, unless its owner says so."""

    skins: tuple[str, ...] = ()
    """Skins that can be chosen; the first is on."""


@final
class Viewer(Listener):
    """Shows a stream in the browser, and gives back what people do there.

    The page lives in a process of its own. This one only packs a picture 25 times a
    second, and not even that while the page has not shown those before.

    Attributes:
        page: the process; None before the start and after the end.
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
        arm: ReportsState | None = None,
        board: Callable[[], ComparisonBoard | None] | None = None,
    ) -> None:
        """Nothing is started before the stream is.

        Args:
            recognition: that tells the moments.
            config: how the page is served.
            on_order: is called on a thread of its own with each order that people give.
            arm: whose state is shown.
            board: tells what recognisers that are compared say, which is then shown
                in place of all else beside the scene.
        """
        self.recognition = recognition
        self.config = config or ViewerConfig()
        self.on_order = on_order
        self.arm = arm
        self.board = board
        self.page: PageProcess | None = None
        self.due = self.counted_from = 0.0
        self.count, self.rate = 0, 0.0

    @property
    def mounted(self) -> MountedSkin:
        """The skin that is seen."""
        return self.recognition.recognizer.mounted

    def start(self, context: Context) -> None:
        """Start the page's process.

        Raises:
            DeviceError: the port cannot be had.
        """
        self.context = context
        self.packer = FrameEncoder(self.mounted, context.clock.now())
        self.page = PageProcess(self.setup(), self.config.port, self.on_order)

    def setup(self) -> SceneDescription:
        """What the page is told once."""
        return describe_scene(
            self.mounted,
            self.recognition.recognizer.model.card.vocabulary,
            touchable=self.config.touchable,
            skins=self.config.skins,
            is_arm=self.arm is not None,
            compares=self.board is not None,
        )

    def on_message(self, item: Message) -> None:
        """Keep what is said; of moments show one in 40 ms."""
        if not isinstance(item, RecognitionState):
            self.packer.note(item)
            return
        now = monotonic()
        self.count_up(self.context.clock.now() / NS_PER_S)
        if now < self.due or self.page is None or not self.page.wants():
            return
        self.due = max(self.due + 1 / PICTURES, now)
        step, stamp = self.recognition.step.quantile(0.5), item.state.reading.stamp
        arm = None if self.arm is None else describe_arm(self.arm.state())
        age = self.context.age(stamp)
        picture = self.packer.picture(item, self.rate, step, age, arm)
        board = None if self.board is None else self.board()
        self.page.give(replace(picture, board=board))

    def count_up(self, now: float) -> None:
        """Measure the rate of readings once a second."""
        self.count += 1
        elapsed = now - self.counted_from
        if elapsed >= 1.0:
            self.rate = self.count / elapsed if self.counted_from else 0.0
            self.count, self.counted_from = 0, now

    def wait_ready(self, timeout: float) -> int:
        """Wait until the page is served, once the stream has started; its port.

        Args:
            timeout: how long at most [s].

        Raises:
            DeviceError: it is not served.
        """
        if self.page is None:
            raise DeviceError(
                "there is no page; allowed is a viewer of a running stream; start it"
            )
        return self.page.wait_ready(timeout)

    def close(self) -> None:
        """End the page's process."""
        if self.page is not None:
            self.page.close()
            self.page = None
