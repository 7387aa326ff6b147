"""This module defines the arrays and tuples that the compiled tracking kernels read and write."""

from typing import NamedTuple

import numpy as np

from eskin.skin import MountedSkin
from eskin.structref_kernels import Packed
from eskin.touch.adjacency import Adjacency

SPAN = ("i8", 2)
VECTOR = ("f8", 3)

GOING, ENDED, PAST = 0, 1, 2
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
"""A `Contact`, the stamp of its reading, and the span of its taxels."""

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
"""A `Track`, the id of its touch, and the place of its latest contact."""

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
"""A `Touch`, and what only the recogniser asks for.

`contact` is the place of the strongest of its latest contacts; `force` what it presses
now [N]; `contacts` how often it has made contact; `farthest` the greatest distance of
its centre from where it began [m]. `loads` is the span of its taxels now, `before` of
those at the reading before, with the pressures of then and of the touches that it has
taken over since; `tracks` is the span of the ids of its tracks, ascending.
"""


class TouchRecord(NamedTuple):
    """The values of one TOUCH, in the order of its fields."""

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
    """All contacts, tracks and touches at one instant."""

    contacts: np.ndarray
    """(contact) CONTACT: those now, then older ones that others still refer to."""
    tracks: np.ndarray
    """(track) TRACK: going on, ended with this reading, past; each by id."""
    touches: np.ndarray
    """(touch) TOUCH: open ones by id, then those closed with this reading."""
    loads: np.ndarray
    """(load) LOAD: the spans of contacts and touches, which may share some."""
    members: np.ndarray
    """(track) ids of tracks: the spans of touches."""


class TouchStatus(NamedTuple):
    """What is looked at of every touch at every reading."""

    id: int
    onset: int
    last: int
    merged_into: int
    closed: int


class TrackingResult(NamedTuple):
    """The touches of one reading: what everybody asks for, and a handle on the rest."""

    packed: Packed
    """`TouchRecords`."""
    open: tuple[TouchStatus, ...]
    """Touches that are open, by id."""
    closed: tuple[TouchStatus, ...]
    """Those that closed with this reading."""


NO_TOUCHES = TouchRecords(
    np.empty(0, CONTACT),
    np.empty(0, TRACK),
    np.empty(0, TOUCH),
    np.empty(0, LOAD),
    np.empty(0, np.int64),
)
"""Nobody touches the skin."""

SITE = np.dtype(
    [
        ("position", "f8", 3),
        ("normal", "f8", 3),
        ("area", "f8"),
        ("reach", "f8"),
        ("link", "i8"),
        ("patch", "i8"),
        ("rank", "i8"),
        ("neighbours", "i8", 2),
    ]
)
"""A taxel in the frame of its link: position [m], outward normal, area [m2], how far it
connects [m], its link in `robot.links`, its patch, its place by patch, row and column,
and the span of its neighbours on the same link."""

TAXEL = np.dtype(
    [
        ("active_at", "f8"),
        ("peak", "f8"),
        ("onset", "i8"),
        ("held", "i8"),
        ("place", "i8"),
    ]
)
"""How a taxel was: when it was last active [s], its recent peak then [kPa], since when
it was active [ns], whether it has not been released since; and -1, which kernels use
to find the taxel among others."""

HELD, NEXT_TRACK, NEXT_TOUCH = 0, 1, 2
"""What is counted: taxels that are held, and the ids to be given next."""


class Memory(NamedTuple):
    """What is written to at every reading; its cost follows the touch."""

    taxels: np.ndarray
    """(taxel) TAXEL."""
    held: np.ndarray
    """(taxel) those that are held, in front."""
    counts: np.ndarray
    """(3) see `HELD`, `NEXT_TRACK`, `NEXT_TOUCH`."""


def sites_of(mounted: MountedSkin, adjacency: Adjacency) -> np.ndarray:
    """Every taxel of a skin as a SITE."""
    skin = mounted.skin
    sites = np.empty(skin.count, SITE)
    sites["position"], sites["normal"] = skin.positions, skin.normals
    sites["area"], sites["reach"] = skin.areas, adjacency.reach
    sites["link"], sites["patch"] = mounted.taxel_link_index, skin.patch_index
    order = np.lexsort((skin.columns, skin.rows, skin.patch_index))
    sites["rank"][order] = np.arange(skin.count)
    sites["neighbours"][:, 0] = adjacency.starts[:-1]
    sites["neighbours"][:, 1] = adjacency.starts[1:]
    return sites


def fresh_memory(count: int) -> Memory:
    """The memory of a skin that was never touched."""
    taxels = np.zeros(count, TAXEL)
    taxels["active_at"] = -np.inf
    taxels["place"] = -1
    return Memory(taxels, np.empty(count, np.int64), np.array([0, 1, 1]))


class Rules(NamedTuple):
    """The configuration of contacts, tracks and touches as the kernels want it."""

    on: float
    """Pressure from which a taxel becomes active [kPa]."""
    off: float
    """Pressure from which it stays active [kPa]."""
    on_share: float
    """Part of the recent peak that goes with `on`."""
    off_share: float
    """Part of the recent peak that goes with `off`."""
    fade: float
    """Half-life of the recent peak [s]."""
    hold: float
    """How long a taxel not received is held [s]."""
    gate: float
    """Distance that a contact may jump at once [m]."""
    speed: float
    """Speed by which that grows [m/s]."""
    coast: float
    """How long a track waits [s]."""
    gap: float
    """Time between readings that ends every track [ns]."""
    near: float
    """How far a track may begin from where one ended [m]."""
    pause: int
    """How long after it, and when a touch closes [ns]."""
    beside: float
    """How far contacts of one touch may be apart [m]."""
    calibrated: bool
    """Whether distances mean anything."""


class Instant(NamedTuple):
    """A reading as the kernels want it."""

    stamp: int
    """When it was taken [ns]."""
    elapsed: int
    """Time since the reading before [ns]; 0 at the first."""
    now: float
    """When it was taken, since the first reading [s]."""
    before: float
    """When the reading before was, or itself [s]."""
    pressure: np.ndarray
    """(taxel) [kPa]."""
    valid: np.ndarray
    """(taxel) whether that is to be believed."""
    T_world_link: np.ndarray
    """(link, 4, 4) poses of the robot's links."""
