"""This module defines the arrays and tuples that the tracking kernels read and write.

Links and patches are indices into `robot.links` and `skin.patches`; ids count from 1,
and 0 is none; a span is the begin and the end of a part of another array. Records of a
reading are never written to once the reading has been processed.
"""

from typing import NamedTuple

import numpy as np

from eskin.skin import MountedSkin
from eskin.structref_kernels import Packed
from eskin.touch.adjacency import Adjacency

NO_INDEX = -1
"""Index of no contact, track or touch."""

SPAN = ("i8", 2)
VECTOR = ("f8", 3)

ONGOING, ENDED, PAST = 0, 1, 2
"""Phases of a track: with contact or waiting for it, ended with this reading, and
ended before, remembered while its touch may still be joined."""

LOAD = np.dtype([("taxel", "i8"), ("pressure", "f8"), ("onset", "i8")])
"""An active taxel, its pressure [kPa], and since when it has been active [ns]."""

CONTACT = np.dtype(
    [
        ("stamp", "i8"),
        ("force", "f8"),
        ("area", "f8"),
        ("peak", "f8"),
        ("p_world", *VECTOR),
        ("n_world", *VECTOR),
        ("p_link", *VECTOR),
        ("link", "i8"),
        ("patch", "i8"),
        ("loads", *SPAN),
    ]
)
"""A `Contact`, the stamp of its reading, and the span of its loads."""

TRACK = np.dtype(
    [
        ("id", "i8"),
        ("onset", "i8"),
        ("last", "i8"),
        ("parent", "i8"),
        ("merged_into", "i8"),
        ("phase", "i8"),
        ("touch", "i8"),
        ("contact", "i8"),
    ]
)
"""A `Track`, the id of its touch, and the index of its latest contact."""

TOUCH = np.dtype(
    [
        ("id", "i8"),
        ("onset", "i8"),
        ("last", "i8"),
        ("impulse", "f8"),
        ("peak_force", "f8"),
        ("peak", "f8"),
        ("link", "i8"),
        ("start", *VECTOR),
        ("latest", *VECTOR),
        ("contact", "i8"),
        ("merged_into", "i8"),
        ("closed", "i8"),
        ("force", "f8"),
        ("contacts", "i8"),
        ("farthest", "f8"),
        ("loads", *SPAN),
        ("before", *SPAN),
        ("tracks", *SPAN),
    ]
)
"""A `Touch`, and what only the recogniser needs.

`contact` is the index of the strongest of its latest contacts; `force` its force now
[N]; `contacts` how often it has made contact; `farthest` the greatest distance of its
centre from where it began [m]. `loads` is the span of its loads now, `before` of those
at the reading before, including those of touches merged into it since; `tracks` is the
span of the ids of its tracks, ascending.
"""


class TouchRecord(NamedTuple):
    """A record has the values of one TOUCH, in the order of its fields."""

    id: int
    onset: int
    last: int
    impulse: float
    peak_force: float
    peak: float
    link: int
    start: np.ndarray
    latest: np.ndarray
    contact: int
    merged_into: int
    closed: int
    force: float
    contacts: int
    farthest: float
    loads: np.ndarray
    before: np.ndarray
    tracks: np.ndarray


class TouchRecords(NamedTuple):
    """Records describe all contacts, tracks and touches at one instant."""

    contacts: np.ndarray
    """(contact) CONTACT: those now, then older ones that others still refer to."""
    tracks: np.ndarray
    """(track) TRACK: ongoing, ended with this reading, past; each by id."""
    touches: np.ndarray
    """(touch) TOUCH: open ones by id, then those closed with this reading."""
    loads: np.ndarray
    """(load) LOAD: the spans of contacts and touches, which may share some."""
    members: np.ndarray
    """(track) ids of tracks: the spans of touches."""


class TouchStatus(NamedTuple):
    """A status holds what is needed of every touch at every reading."""

    id: int
    onset: int
    last: int
    merged_into: int
    closed: int


class TrackingResult(NamedTuple):
    """A result holds the touches of one reading in short, and a reference to all."""

    packed: Packed
    """Reference to the `TouchRecords`."""
    open: tuple[TouchStatus, ...]
    """Touches that are open, by id."""
    closed: tuple[TouchStatus, ...]
    """Touches that closed with this reading."""


NO_TOUCHES = TouchRecords(
    np.empty(0, CONTACT),
    np.empty(0, TRACK),
    np.empty(0, TOUCH),
    np.empty(0, LOAD),
    np.empty(0, np.int64),
)
"""Records of a skin that nobody touches."""

TAXEL_GEOMETRY = np.dtype(
    [
        ("position", *VECTOR),
        ("normal", *VECTOR),
        ("area", "f8"),
        ("reach", "f8"),
        ("link", "i8"),
        ("patch", "i8"),
        ("rank", "i8"),
        ("neighbours", *SPAN),
    ]
)
"""A taxel in the frame of its link: position [m], outward normal, area [m2], distance
within which it connects [m], index of its link and of its patch, rank by patch, row and
column, and the span of its neighbours on the same link."""

TAXEL_STATE = np.dtype(
    [
        ("active_at", "f8"),
        ("peak", "f8"),
        ("onset", "i8"),
        ("held", "i8"),
        ("slot", "i8"),
    ]
)
"""State of a taxel: when it was last active [s], its recent peak at that time [kPa],
since when it was active [ns], whether it has not been released since; and -1, in whose
place kernels write the index of the taxel among others for a while."""

HELD, NEXT_TRACK, NEXT_TOUCH = 0, 1, 2
"""Indices of `TrackerState.counts`: the number of held taxels, and the next ids."""


class TrackerState(NamedTuple):
    """Arrays that hold what the tracker updates at every reading."""

    taxels: np.ndarray
    """(taxel) TAXEL_STATE."""
    held: np.ndarray
    """(taxel) held taxels come first."""
    counts: np.ndarray
    """(3) see `HELD`, `NEXT_TRACK`, `NEXT_TOUCH`."""


class TrackingParameters(NamedTuple):
    """Parameters of the tracking kernels have the names of the configurations' fields.

    See `ContactConfig`, `TrackConfig` and `TouchConfig`. `pause_ns` is
    `TouchConfig.pause_seconds` in ns; `calibrated` tells whether distances on the skin
    mean anything.
    """

    on: float
    off: float
    on_share: float
    off_share: float
    fade_seconds: float
    hold_seconds: float
    gate: float
    speed: float
    coast_seconds: float
    gap_seconds: float
    near: float
    pause_ns: int
    beside: float
    calibrated: bool


class TrackerContext(NamedTuple):
    """A context holds what is the same at every reading."""

    parameters: TrackingParameters
    """Thresholds, distances and times."""
    geometry: np.ndarray
    """(taxel) TAXEL_GEOMETRY."""
    neighbours: np.ndarray
    """(pair) neighbours of all taxels, to which `geometry` has the spans."""
    state: TrackerState
    """State of the taxels; updated."""


class KernelReading(NamedTuple):
    """A reading as the kernels take it."""

    stamp: int
    """Time at which it was taken [ns]."""
    elapsed: int
    """Time since the reading before [ns]; 0 at the first."""
    now: float
    """Time at which it was taken, since the first reading [s]."""
    previous: float
    """Time of the reading before, or its own at the first [s]."""
    pressure: np.ndarray
    """(taxel) pressure [kPa]."""
    valid: np.ndarray
    """(taxel) whether the pressure can be trusted."""
    T_world_link: np.ndarray
    """(link, 4, 4) poses of the robot's links."""


def build_taxel_geometry(mounted: MountedSkin, adjacency: Adjacency) -> np.ndarray:
    """Build the TAXEL_GEOMETRY of every taxel of a skin."""
    skin = mounted.skin
    geometry = np.empty(skin.count, TAXEL_GEOMETRY)
    geometry["position"], geometry["normal"] = skin.positions, skin.normals
    geometry["area"], geometry["reach"] = skin.areas, adjacency.reach
    geometry["link"], geometry["patch"] = mounted.taxel_link_index, skin.patch_index
    order = np.lexsort((skin.columns, skin.rows, skin.patch_index))
    geometry["rank"][order] = np.arange(skin.count)
    geometry["neighbours"][:, 0] = adjacency.starts[:-1]
    geometry["neighbours"][:, 1] = adjacency.starts[1:]
    return geometry


def build_tracker_state(count: int) -> TrackerState:
    """Build the state of a skin that was never touched."""
    taxels = np.zeros(count, TAXEL_STATE)
    taxels["active_at"] = -np.inf
    taxels["slot"] = -1
    return TrackerState(taxels, np.empty(count, np.int64), np.array([0, 1, 1]))
