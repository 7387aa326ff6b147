"""From what the recogniser says to what the page shows."""

from collections import deque
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float

from eskin.drivers import Event
from eskin.live import Detection
from eskin.page import ArmLine, ContactMark, Picture, Saying, TouchNow
from eskin.skin import MountedSkin
from eskin.stream import CommandEvent, RecognitionState, found_at_once
from eskin.touch import Contact
from eskin.transforms import apply, invert, matrix_to_quaternion, rotate
from eskin.units import NS_PER_S

MOST_SAID = 32
"""Lines of the log that wait for a picture; older ones are dropped."""
MOST_CONTACTS = 8


@runtime_checkable
class ArmTold(Protocol):
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
class Packer:
    """Makes pictures; holds what is said until the next one."""

    def __init__(self, mounted: MountedSkin, begin: int) -> None:
        """Start with nothing said.

        Args:
            mounted: the skin on its robot.
            begin: stamp from which time is counted [ns since the epoch].
        """
        self.mounted = mounted
        self.begin = begin
        self.sayings: deque[Saying] = deque(maxlen=MOST_SAID)
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
                self.sayings.append(self.detection(item))
            case Event() if found_at_once(self.told, item):
                pass  # of many faults found together one is told; their number is shown
            case Event():
                self.told = item
                self.sayings.append(
                    Saying(self.seconds(item.stamp), "event", item.text)
                )
            case CommandEvent():
                kind = "command" if item.accepted else "refused"
                text = item.action + (f": {item.why}" if item.why else "")
                self.sayings.append(Saying(self.seconds(item.stamp), kind, text))

    def detection(self, detection: Detection) -> Saying:
        """A detection with its place on its link."""
        link = self.mounted.robot.link_index(detection.link)
        x, y, z = apply(invert(self.T_world_link[link]), detection.p_world).tolist()
        name = detection.gesture.replace("_", "-")
        return Saying(
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
        arm: ArmLine | None,
    ) -> Picture:
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
        said = tuple(self.sayings)
        for _ in said:
            self.sayings.popleft()
        return Picture(
            seconds=self.seconds(reading.stamp),
            poses=packed_poses(self.T_world_link),
            pressure=np.where(reading.valid, reading.pressure, 0.0).astype(np.float16),
            valid=np.packbits(reading.valid),
            contacts=tuple(map(self.mark, contacts[:MOST_CONTACTS])),
            touches=self.touches(moment),
            force=sum((contact.force for contact in contacts), 0.0),
            peak=max((contact.peak for contact in contacts), default=0.0),
            sayings=said,
            faults=len(state.faults),
            rate=rate,
            step=step,
            age=age,
            arm=arm,
        )

    def mark(self, contact: Contact) -> ContactMark:
        """A contact in the frame of its link."""
        link = self.mounted.robot.link_index(contact.link)
        n_link = rotate(invert(self.T_world_link[link]), contact.n_world)
        radius = float(np.sqrt(contact.area / np.pi))
        return ContactMark(link, contact.p_link, n_link, radius)

    def touches(self, moment: RecognitionState) -> tuple[TouchNow, ...]:
        """Open touches with what is thought of them, strongest first."""
        found = [
            TouchNow(
                touch.id,
                touch.contact.link,
                touch.contact.force,
                moment.probabilities[touch.id].astype(np.float32),
            )
            for touch in moment.state.touches
            if touch.id in moment.probabilities
        ]
        return tuple(sorted(found, key=lambda touch: -touch.force))


def packed_poses(
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> Float[np.ndarray, "link 7"]:
    """Quaternion and position of each link, in single precision."""
    wxyz = matrix_to_quaternion(T_world_link[:, :3, :3])
    return np.concatenate([wxyz, T_world_link[:, :3, 3]], axis=1).astype(np.float32)


def arm_line(arm: ArmTold) -> ArmLine:
    """An arm's state in one word, with the reason."""
    speed, gripper, target = arm.speed, arm.gripper, arm.target
    if not arm.connected:
        return ArmLine("stopped", "lost connection", speed, gripper, target)
    if arm.protective_stop:
        return ArmLine("stopped", "protective stop", speed, gripper, target)
    if arm.hold_reason:
        return ArmLine("held", arm.hold_reason, speed, gripper, target)
    if arm.paused:
        return ArmLine("paused", "", speed, gripper, target)
    state = "running" if arm.moving else "waiting"
    return ArmLine(state, "", speed, gripper, target)
