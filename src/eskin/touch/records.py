"""What is known of touch at one instant, as arrays that compiled code reads.

Links and patches are places in `robot.links` and `skin.patches`; ids count from 1, and
0 is none; a span is the first and the end of a part of another array. Nothing is ever
written to these arrays once a reading has been followed.
"""

from typing import NamedTuple

import numpy as np

from eskin.structref_kernels import Packed

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


class TouchRow(NamedTuple):
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


class TouchBrief(NamedTuple):
    """What is looked at of every touch at every reading."""

    id: int
    onset: int
    last: int
    merged_into: int
    closed: int


class Followed(NamedTuple):
    """The touches of one reading: what everybody asks for, and a handle on the rest."""

    packed: Packed
    """`TouchRecords`."""
    going: tuple[TouchBrief, ...]
    """Touches that are open, by id."""
    over: tuple[TouchBrief, ...]
    """Those that closed with this reading."""


NOTHING = TouchRecords(
    np.empty(0, CONTACT),
    np.empty(0, TRACK),
    np.empty(0, TOUCH),
    np.empty(0, LOAD),
    np.empty(0, np.int64),
)
"""Nobody touches the skin."""
