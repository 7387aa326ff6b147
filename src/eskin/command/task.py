"""What an arm does all day: waypoints, and what the gripper does there."""

from dataclasses import dataclass
from typing import Literal

Purpose = Literal["take", "bring"]


@dataclass(frozen=True)
class Waypoint:
    """Where the arm stops on its way."""

    name: str
    """Tells it from the others."""

    q: tuple[float, ...]
    """Joint positions [rad]."""

    purpose: Purpose | None = None
    """`take`: the gripper closes on a part here; `bring`: it opens and leaves it."""


@dataclass(frozen=True)
class Task:
    """Waypoints that an arm goes through again and again.

    Raises:
        ValueError: there is no waypoint, two have one name, or positions do not fit.
    """

    name: str
    """What is done."""

    robot_name: str
    """Preset or URDF that it is for."""

    joint_names: tuple[str, ...]
    """In the order of `Waypoint.q`."""

    waypoints: tuple[Waypoint, ...]
    """In the order in which they are gone to; the arm begins at the first."""

    part: str = "part"
    """What is carried."""

    tool: str = "tool0"
    """Link that a jog moves."""

    lowest: float = 0.1
    """Least height of that link over the robot's base to which a jog goes [m]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be gone through."""
        names = [waypoint.name for waypoint in self.waypoints]
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(
                f"task '{self.name}' has waypoints {', '.join(names) or 'none'}; "
                "allowed are two or more, each name once; name them apart"
            )
        for waypoint in self.waypoints:
            if len(waypoint.q) != len(self.joint_names):
                raise ValueError(
                    f"waypoint '{waypoint.name}' has {len(waypoint.q)} positions; "
                    f"allowed are {len(self.joint_names)}, one a joint; correct it"
                )

    def after(self, place: int, steps: int = 1) -> int:
        """The place of the waypoint some steps on, in a circle."""
        return (place + steps) % len(self.waypoints)


UR5_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
OVER_RACK = (-1.529, -1.560, 1.693, -1.703, -1.571, 0.0)
OVER_FRAME = (0.487, -1.517, 1.597, -1.651, -1.571, 0.0)
FRAME_TASK = Task(
    name="frame assembly",
    robot_name="ur5",
    joint_names=UR5_JOINTS,
    waypoints=(
        Waypoint("over the rack", OVER_RACK),
        Waypoint("rack", (-1.529, -1.399, 2.012, -2.184, -1.571, 0.0), "take"),
        Waypoint("lift", OVER_RACK),
        Waypoint("over the frame", OVER_FRAME),
        Waypoint("frame", (0.487, -1.384, 1.932, -2.119, -1.571, 0.0), "bring"),
        Waypoint("back off", OVER_FRAME),
    ),
    part="frame part",
)
"""A rack to the right of the arm, a frame and its worker in front and to the left; the
tool points down all the way [rad]."""
