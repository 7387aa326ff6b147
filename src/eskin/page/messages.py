"""This module defines the messages between the page and its viewer."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float16, Float32, Int

CAMERA_DIRECTION = (0.672, -0.656, 0.344)
"""Direction in the world frame to the camera from what it looks at, of unit length."""


@dataclass(frozen=True, eq=False)
class ContactMarker:
    """Describes the place of a contact."""

    link: int
    """Index of the link."""
    p_link: Float[np.ndarray, "3"]
    """Centre of the contact in the frame of its link [m]."""
    n_link: Float[np.ndarray, "3"]
    """Outward unit normal at the centre, in the frame of its link."""
    radius: float
    """Radius of a circle of the area of the contact [m]."""
    force: float = 0.0
    """Force [N]."""
    patch: str = ""
    """Name of the patch."""


@dataclass(frozen=True, eq=False)
class OpenTouch:
    """Describes an open touch and its class probabilities."""

    id: int
    """Number of the touch."""
    patch: str
    """Name of the patch that is touched."""
    force: float
    """Force of its strongest contact [N]."""
    probabilities: Float32[np.ndarray, "class"]
    """Probability of each class of the vocabulary."""


EntryKind = Literal["detection", "command", "refused", "event", "note"]
"""Kinds of lines of the log; `refused` marks a command that was not accepted, `note` an
answer to what was done in the page."""


@dataclass(frozen=True)
class LogEntry:
    """Describes a line of the log."""

    seconds: float
    """Time since the stream began [s]."""
    kind: EntryKind
    """Kind of the entry."""
    text: str
    """Text of the line."""
    gesture: str = ""
    """Gesture of a detection; empty for other entries."""
    link: int = -1
    """Index of the link of a detection; -1 for other entries."""
    p_link: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of a detection in the frame of its link [m]."""
    touch: int = -1
    """Number of the touch of a detection; -1 for other entries."""
    label: str = ""
    """Text at the place of a detection; empty for other entries."""


@dataclass(frozen=True)
class TouchRule:
    """Describes what a gesture commands."""

    gesture: str
    """Name of the gesture."""
    where: str
    """Direction, link and patch of the touch; empty where it may be any."""
    actions: tuple[str, ...]
    """Actions, of which the state of the arm chooses one."""


ArmCondition = Literal["running", "stopping", "standing", "paused", "held", "stopped"]
"""Conditions of an arm. `stopping`: it moves although it is to stand still; `standing`:
at rest in its program; `paused`: a person requested it; `held`: stopped without a
request; `stopped`: in protective stop, or not connected."""


@dataclass(frozen=True)
class ArmSummary:
    """Summarises the state of an arm."""

    state: ArmCondition
    """Condition of the arm."""
    why: str
    """Reason for the condition, or for a limit of the speed; may be empty."""
    speed: float
    """Speed at which it runs, or will once it is let go, as a share of full speed."""
    gripper: str
    """State of the gripper: `open` or `closed`."""
    target: str
    """Name of the target of the motion."""
    remedy: str = ""
    """What a person does to let the arm go on, to answer it, or to give it its full
    speed back; empty where there is nothing to do."""
    carrying: bool = False
    """Whether a part is in the gripper."""


@dataclass(frozen=True)
class QuestionBoard:
    """Tells a person what the arm asks, and what to observe before it asks again."""

    answer: str
    """Gesture that answers a question; empty where the arm never asks."""
    rest: float = 0.0
    """How long the skin must stay untouched before the next touch that asks, because a
    question was not answered [s]; 0 otherwise."""
    action: str = ""
    """Action that the arm asks about; empty while it does not ask."""
    link: str = ""
    """Name of the link that the answer must be on; empty while the arm does not ask."""
    left: float = 0.0
    """Share of the time that is left for the answer to begin, from 1 to 0."""
    is_answering: bool = False
    """Whether a touch that may be the answer has begun."""


@dataclass(frozen=True)
class RecordingState:
    """Tells where a recording is, and whether it is still made."""

    path: str
    """Path of its file."""
    is_on: bool
    """Whether it is made now; if not, it is saved."""


@dataclass(frozen=True)
class PressPlace:
    """Describes where a person is to press next."""

    name: str
    """Name by which the page asks to leave it out: of its patch, or of its point."""
    link: int
    """Index of the link."""
    p_link: tuple[float, float, float]
    """Position in the frame of the link [m]."""
    n_link: tuple[float, float, float]
    """Outward unit normal there, in the frame of the link."""


@dataclass(frozen=True)
class GuideBoard:
    """Tells a person what to do next in a calibration, and what it has measured."""

    request: str
    """What the person is to do now."""
    share: float
    """Share of the time at rest, or of the presses, that is done."""
    place: PressPlace | None = None
    """Place to press next; None where none is to be pressed."""
    result: tuple[str, ...] = ()
    """Lines of the result; empty before the end."""
    presses: int = 0
    """Number of presses so far, of which the last may be repeated."""


@dataclass(frozen=True, eq=False)
class ViewUpdate:
    """Holds the state of one instant as the page shows it."""

    seconds: float
    """Time since the stream began [s]."""
    T_world_link: Float[np.ndarray, "link 4 4"]
    """Pose of every link in the world frame."""
    pressure: Float16[np.ndarray, "taxel"]
    """Pressure of each taxel [kPa]."""
    valid: Bool[np.ndarray, "taxel"]
    """Whether each taxel is valid."""
    contacts: tuple[ContactMarker, ...] = ()
    """Contacts, strongest first."""
    touches: tuple[OpenTouch, ...] = ()
    """Open touches, strongest first."""
    force: float = 0.0
    """Sum of the forces of all contacts [N]."""
    peak: float = 0.0
    """Greatest pressure [kPa]."""
    log_entries: tuple[LogEntry, ...] = ()
    """Log entries since the last update."""
    rate: float = 0.0
    """Rate of readings [1/s]."""
    step: float = 0.0
    """Median time to recognise one reading [s]."""
    age: float = 0.0
    """Age of the reading when its processing was complete [s]."""
    arm: ArmSummary | None = None
    """Summary of the arm; None without an arm."""
    question: QuestionBoard | None = None
    """What the arm asks; None without an arm."""
    guide: GuideBoard | None = None
    """Guide through a calibration, or what is painted; None without either."""
    recording: RecordingState | None = None
    """State of the recording; None before the first."""


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """Describes the look of a part of the robot: a closed mesh in its link's frame."""

    link: int
    """Index of the link."""
    vertices: Float[np.ndarray, "vertex 3"]
    """Positions of the vertices in the frame of the link [m]."""
    faces: Int[np.ndarray, "face 3"]
    """Vertex indices of each face, counter-clockwise seen from outside."""
    colour: tuple[int, int, int]
    """Red, green and blue, each from 0 to 255."""


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """Describes a skin on its robot and the actions that the page offers."""

    title: str
    """Title of the page: robot, skin and source."""
    links: tuple[str, ...]
    """Names of the links of the robot."""
    solids: tuple[LinkMesh, ...]
    """Meshes of the robot."""
    taxel_link: Int[np.ndarray, "taxel"]
    """Index of the link of each taxel."""
    positions: Float[np.ndarray, "taxel 3"]
    """Positions of the taxels in the frames of their links [m]."""
    normals: Float[np.ndarray, "taxel 3"]
    """Outward unit normals of the taxels in the frames of their links."""
    areas: Float[np.ndarray, "taxel"]
    """Areas of the taxels [m2]."""
    patches: tuple[str, ...]
    """Names of the patches."""
    patch_index: Int[np.ndarray, "taxel"]
    """Index of the patch of each taxel."""
    rows: Int[np.ndarray, "taxel"]
    """Row of each taxel in its patch."""
    columns: Int[np.ndarray, "taxel"]
    """Column of each taxel in its patch."""
    gestures: tuple[str, ...]
    """Vocabulary, in the order of the probabilities."""
    touchable: bool = False
    """Whether the page may send touches and other orders."""
    skins: tuple[str, ...] = ()
    """Skins offered for selection; the first is the current one."""
    is_arm: bool = False
    """Whether updates include the state of an arm."""
    calibrates: bool = False
    """Whether the guide through a calibration replaces the panel beside the scene."""
    paints: bool = False
    """Whether the mouse paints, and the brush replaces the panel beside the scene."""
    middle: tuple[float, float, float] = (0.05, 0.0, 0.3)
    """Point that the camera looks at first, in the world frame [m]."""
    distance: float = 2.135
    """Distance of the camera from that point [m]."""
    direction: tuple[float, float, float] = CAMERA_DIRECTION
    """Direction in the world frame from that point to the camera, a unit vector."""
    ground: float = 0.0
    """Height of the ground in the world frame [m]."""
    warning: str = ""
    """Warning that is always shown above the panel; empty for none."""
    commands: tuple[TouchRule, ...] = ()
    """What each gesture commands."""
    corrects: bool = False
    """Whether detections can be corrected, which is kept in the recording."""
    places: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    """Name of each place of the task, and where parts are put there, in the world frame
    [m]."""


TouchKind = Literal["poke", "double_pat", "grab", "begin", "move", "end"]
PageKind = Literal[
    "pause_task", "resume_task", "unplug", "plug", "kill", "restore", "skin", "record",
    "stop_recording", "opened", "skip", "again", "close", "undo", "save",
]  # fmt: skip


@dataclass(frozen=True)
class TouchOrder:
    """Requests a touch of the simulated skin by a finger or hand."""

    kind: TouchKind
    """Kind of touch; `begin`, `move` and `end` belong to a dragged finger."""
    link: str
    """Name of the link of the selected taxel."""
    p_link: tuple[float, float, float]
    """Point on the skin in the frame of the link [m]."""
    force: float
    """Force of the touch [N]."""
    seconds: float
    """Duration of the touch; unused for a dragged finger [s]."""
    key: int
    """Identifier of the touch, shared by `begin`, `move` and `end` of one finger."""


@dataclass(frozen=True)
class PageOrder:
    """Requests an action other than a touch."""

    kind: PageKind
    """Action."""
    value: str | float | None = None
    """Argument: a patch to unplug or plug in, a place to skip, the number of presses of
    which the last is to be repeated, a share of taxels to kill, or a skin."""


@dataclass(frozen=True)
class CorrectionOrder:
    """Requests that a detection is corrected, and kept as a label."""

    touch: int
    """Number of the touch that was recognised."""
    gesture: str
    """Name of the gesture that it was."""


@dataclass(frozen=True)
class PaintOrder:
    """Requests a ball of paint, or a matrix, on the surface of a link."""

    stroke: int
    """Number of the stroke that it belongs to."""
    link: str
    """Name of the link."""
    p_link: tuple[float, float, float]
    """Centre on the surface, in the frame of the link [m]."""
    radius: float
    """Radius [m]."""
    keeps_out: bool
    """Whether no skin is to lie there."""
    matrix: tuple[int, int, float] | None = None
    """Rows, columns and pitch [m] of a matrix with its middle there; None paints."""


Order = TouchOrder | PageOrder | CorrectionOrder | PaintOrder

MessageKind = Literal["ready", "refused", "shown", "order"]
"""Kinds of messages of the page: it is served at a port, or cannot be for a reason, has
shown an update, so that another may be sent, or sends an order."""
