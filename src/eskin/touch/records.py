"""This module defines what the tracker reads, keeps and returns.

Links and patches are indices into `robot.links` and `skin.patches`. Ids count from 1; 0
is none. The records of a reading are not changed once it has been processed.
"""

import math
from collections import namedtuple
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
from annotated_types import Interval
from jaxtyping import Int
from pydantic import Field

from eskin.files import Distance, Pause, Pressure, Share
from eskin.touch.adjacency import MICROMETRE
from eskin.touch.taxels import Instant, TaxelPlaces

NO_INDEX = -1
"""Index of no contact, track or touch."""


Vector = tuple[float, float, float]


class ContactRecord(NamedTuple):
    """A connected set of active taxels at one instant; see `Contact`."""

    stamp: int
    """Stamp of its reading [ns]."""
    place: int
    """Its place among the contacts of its reading."""
    taxels: Int[np.ndarray, "active"]
    """Indices of its taxels, ordered by patch, row and column."""
    link: int
    """Link of the most loaded taxel."""
    patch: int
    """Patch of the most loaded taxel."""
    onset: int
    """Earliest stamp from which one of its taxels is active [ns]."""
    force: float
    """Sum of pressure times area [N]."""
    area: float
    """Sum of the taxels' areas [m2]."""
    peak: float
    """Greatest pressure [kPa]."""
    evidence: float
    """Evidence of this reading that it is no noise; see `TouchConfig.confirm_llr`."""
    p_world: Vector
    """Centre, weighted by force [m]."""
    n_world: Vector
    """Mean outward normal, weighted by force; unit, or zero where normals cancel."""
    p_link: Vector
    """Centre in the frame of `link` [m]."""

    @property
    def cell(self) -> float:
        """Mean area of its taxels [m2]."""
        return self.area / max(len(self.taxels), 1)


NO_TAXELS = np.empty(0, np.int64)
ZERO = (0.0, 0.0, 0.0)
NO_CONTACT = ContactRecord(
    stamp=0,
    place=0,
    taxels=NO_TAXELS,
    link=0,
    patch=0,
    onset=0,
    force=0.0,
    area=0.0,
    peak=0.0,
    evidence=0.0,
    p_world=ZERO,
    n_world=ZERO,
    p_link=ZERO,
)
"""A contact without taxels."""


@dataclass(eq=False)
class TrackRecord:
    """A contact through time; see `Track`."""

    id: int
    onset: int
    """Stamp of its first reading [ns]."""
    last: int
    """Stamp of its last reading with contact [ns]."""
    contact: ContactRecord
    """Contact at `last`."""
    parent: int = 0
    """Id of the track that it split off from."""
    merged_into: int = 0
    """Id of the track with which it was merged."""
    ended: bool = False
    """Whether its contact has ended."""
    touch: int = 0
    """Id of its touch, which may have closed."""
    evidence: float = 0.0
    """Evidence that it is no noise, which fades."""


@dataclass(eq=False)
class TouchRecord:
    """All tracks of one gesture, with values for the recogniser; see `Touch`."""

    id: int
    onset: int
    """Stamp of its first contact [ns]."""
    last: int
    """Stamp of its last contact so far [ns]."""
    merged_into: int = 0
    """Id of the touch into which it was merged."""
    closed: bool = False
    """Whether no further track can join it."""
    confirmed: bool = True
    """Whether there has been enough evidence that it is no noise."""
    contact: ContactRecord = NO_CONTACT
    """Strongest of its latest contacts."""
    link: int = 0
    """Link of its first contact."""
    start: Vector = ZERO
    """Centre of its first contact in the frame of `link` [m]."""
    latest: Vector = ZERO
    """Force-weighted centre of its latest contacts in the frame of `link` [m]."""
    settled_at: int = 0
    """Stamp at which `settled` was set [ns]."""
    tracks: tuple[int, ...] = ()
    """Ids of its tracks, and of the tracks merged into it, ascending."""
    taxels: Int[np.ndarray, "active"] = field(default_factory=NO_TAXELS.copy)
    """Indices of its active taxels now; none once it has closed."""
    before: Int[np.ndarray, "earlier"] = field(default_factory=NO_TAXELS.copy)
    """Taxels in the previous reading, and taxels of touches merged into it since."""
    held: Int[np.ndarray, "pressed"] = field(default_factory=NO_TAXELS.copy)
    """Indices of its taxels that are still pressed, though their contact has ended."""
    contacts: int = 1
    """Number of times that it made contact."""
    impulse: float = 0.0
    """Integral of its force over time [N s]."""
    peak_force: float = 0.0
    """Greatest force of all its contacts at one instant [N]."""
    peak: float = 0.0
    """Greatest pressure on one taxel [kPa]."""
    force: float = 0.0
    """Force now [N]."""
    farthest: float = 0.0
    """Largest distance of its centre from its start [m]."""
    settled: float = 0.0
    """Greatest force until `settled_at` [N]."""
    evidence: float = 0.0
    """Evidence that it is no noise."""


AnyRecord = TypeVar("AnyRecord", TrackRecord, TouchRecord)


def copy_record(record: AnyRecord) -> AnyRecord:
    """Return a copy of a record that shares its values, much faster than `copy`."""
    new = object.__new__(type(record))
    new.__dict__.update(record.__dict__)
    return new


class TrackingResult(NamedTuple):
    """A result holds the contacts, tracks and touches of one instant."""

    contacts: tuple[ContactRecord, ...] = ()
    """Contacts of this reading."""
    tracks: tuple[TrackRecord, ...] = ()
    """Ongoing tracks by id, then those that ended with this reading by id."""
    open: tuple[TouchRecord, ...] = ()
    """Open touches, by id."""
    closed: tuple[TouchRecord, ...] = ()
    """Touches that closed with this reading."""
    held: tuple[TouchRecord, ...] = ()
    """Confirmed touches that have closed, some taxels of which are still pressed."""


NO_TOUCHES = TrackingResult()
"""The result of an untouched skin."""


@dataclass(frozen=True)
class ContactConfig:
    """Thresholds define when a taxel is active, and when two belong to one contact."""

    on: Pressure = 0.7
    """Pressure from which a taxel becomes active [kPa]."""
    off: Pressure = 0.5
    """Pressure from which an active taxel stays active [kPa]."""
    peak_share: Share = 0.2
    """Fraction of the greatest pressure of its contact that an active taxel reaches."""
    dropout_seconds: Annotated[Pause, Field(alias="hold_seconds")] = 0.1
    """Time for which a taxel that is not received still counts as pressed, and for
    which a track goes on while most of its taxels are not received [s]."""
    reach: Annotated[float, Interval(ge=0.0, le=4.0)] = 1.6
    """Distance within which active taxels connect, in units of the local spacing;
    pairs of taxels grow with its square."""
    least_reach: Annotated[float, Interval(ge=0.0, le=0.05)] = 0.018
    """Smallest such distance [m], so that they connect across seams of patches."""

    def with_floor(self, floor: float) -> "ContactConfig":
        """Return a copy with `on` at least a floor [kPa], and `off` in proportion."""
        factor = max(1.0, floor / self.on)
        return replace(self, on=self.on * factor, off=self.off * factor)


@dataclass(frozen=True)
class TrackConfig:
    """Limits define how far a contact may move between two readings."""

    gate: Distance = 0.03
    """Distance that the centre may move, even without time in between [m]."""
    speed: Annotated[float, Interval(ge=0.0, le=100.0)] = 1.0
    """Increase of that distance with the time between readings [m/s]."""


@dataclass(frozen=True)
class TouchConfig:
    """Limits define which tracks belong to one touch."""

    max_gap: Annotated[Distance, Field(alias="near")] = 0.08
    """Largest distance from the end of a track to the start of the next [m], in the
    frame of the link of the first."""
    pause_seconds: Pause = 0.36
    """Largest time between the two, time without contact after which a touch closes,
    and without a reading after which all tracks end [s]; 99 % of the gaps of double
    pats are shorter. A touch without evidence closes as its contact ends."""
    max_separation: Annotated[Distance, Field(alias="beside")] = 0.1
    """Largest distance between simultaneous contacts, at their nearest taxels [m]."""
    hand: Distance = 0.19
    """Length of a hand [m], in place of both distances between contacts whose taxels
    are each as large as a fingertip: what lies between such cells is not felt."""
    restart: Annotated[float, Interval(ge=1.0, le=math.inf)] = 5.0
    """Force at which a touch begins anew, and with which a younger touch outlives an
    older one with which it merges, in units of the greatest force of the first so
    far."""
    settle_seconds: Pause = 0.15
    """Time after which a force counts for that [s]."""
    confirm_llr: Annotated[float, Interval(ge=0.0, le=10.0), Field(alias="enough")] = (
        5.0
    )
    """Evidence from which a touch is confirmed: the sum over readings and taxels of the
    natural logarithm of the pressure in units of what may be noise."""
    least_evidence: Annotated[float, Interval(ge=0.0, le=10.0)] = 1.0
    """Such evidence of a track alone from which it may be of one touch with others, and
    be paired with contacts at a distance."""
    max_taxel_llr: Annotated[
        float, Interval(ge=2.0, le=1000.0), Field(alias="most")
    ] = 3.0
    """Largest evidence of one taxel in one reading."""
    min_rise: Annotated[float, Interval(ge=0.0, le=0.3), Field(alias="moves")] = 0.12
    """Smallest rise of a single pressed taxel, above what it was before, that is
    evidence, in units of its pressure."""


FINGERTIP = (0.02 - MICROMETRE) ** 2
"""Area of the skin that a fingertip covers [m2]: a square of 20 mm, less what a mean of
such areas is rounded by."""

CONFIGS = (ContactConfig, TrackConfig, TouchConfig)
TrackingParameters = namedtuple(
    "TrackingParameters",
    [one.name for config in CONFIGS for one in fields(config)] + ["calibrated"],
)
"""Parameters of the tracking kernels: the fields of their configurations, and
`Skin.calibrated`."""


def build_tracking_parameters(
    contacts: ContactConfig,
    tracks: TrackConfig,
    touches: TouchConfig,
    calibrated: bool,
) -> TrackingParameters:
    """Build the parameters of the tracking kernels."""
    values = vars(contacts) | vars(tracks) | vars(touches)
    # Equal distances stay equal where the pose rounds them.
    for name in ("max_gap", "max_separation", "hand"):
        values[name] += MICROMETRE
    return TrackingParameters(**values, calibrated=calibrated)


RECENT = 8
"""Number of pressures of each taxel that are kept to see it fall."""


RELEASES = 64
"""Number of the latest releases whose median tells how fast the sensor falls."""


class TrackerContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between readings."""

    parameters: TrackingParameters
    """Thresholds, distances and times."""
    places: TaxelPlaces
    """Where each taxel is, and to what it belongs."""
    links: np.ndarray
    """(taxel) indices of their links in the robot's order."""
    taxels: np.ndarray
    """(taxel) TAXEL, which is updated."""
    pressed: np.ndarray
    """(taxel) indices of the pressed taxels, then unused space."""
    pressed_count: np.ndarray
    """(1) number of the pressed taxels."""
    recent: np.ndarray
    """(`RECENT`, taxel) pressures of pressed taxels in turn [kPa], else 0."""
    recent_times: np.ndarray
    """(`RECENT`) times of these pressures [s]."""
    slot: np.ndarray
    """(1) index of the latest of these."""
    measured_at: np.ndarray
    """(1) time of the latest reading that did not repeat the one before [s]."""
    release_rates: np.ndarray
    """(`RELEASES`) rates at which taxels fell that were let go, in turn [1/s]."""
    release_rate: np.ndarray
    """(1) median of these rates [1/s]."""
    releases: np.ndarray
    """(1) number of releases so far."""


class KernelReading(NamedTuple):
    """A reading is passed to the kernels in this form."""

    instant: Instant
    """Its time."""
    pressure: np.ndarray
    """(taxel) pressure [kPa]."""
    valid: np.ndarray
    """(taxel) whether the pressure is valid."""
    T_world_link: np.ndarray
    """(link, 4, 4) poses of the robot's links."""
