"""This module defines the state of each taxel and patch, and how time passes.

Three records hold what is known of a taxel: `TAXEL_CONSTANTS`, which a calibration
gives; `TaxelPlaces`, which says where it is and what it belongs to; and `TAXEL`, its
state, which every reading updates. The kernels that do so are, in their order, those of
outages, rest, noise, faults, crosstalk and contacts. Their contexts hold in addition
what is kept of several readings: the samples of the tare, and the latest pressures.
"""

import math
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.reading import check_order
from eskin.touch.taxel_kernels import NEVER
from eskin.units import NS_PER_S, seconds_between

Taxels = Int[np.ndarray, "some"]
Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]


def build_dtype(integers: str, reals: str) -> np.dtype:
    """Build the type of records from the names of their fields of each kind."""
    kinds = ((integers, "i8"), (reals, "f8"))
    return np.dtype([(name, kind) for names, kind in kinds for name in names.split()])


TAXEL_CONSTANTS = build_dtype(
    "", "gain contact clear least_noise start_noise near_rest"
)
"""Constants of a taxel: its gain [kPa/count]; the counts above rest at which contact
begins, at which it is clear, and that may be noise at least; the calibrated standard
deviation of its noise [counts], 0 where it was not measured; and the counts from a
known rest at which it may be untouched."""

TAXEL = build_dtype(
    integers=" ".join(
        [
            "counts accepted code sample_count",
            "onset pressed clear released changed moved touch scratch_index",
        ]
    ),
    reals=" ".join(
        [
            "first_received last_received last_used",
            "rest known_rest above bound confirmed peak margin low low_since",
            "touched_since last_touched steady_level steady_since next_sample",
            "first second third fourth noise wander noise_limit band floor",
            "suspicion flat_since flat_level flat_step last_doubted",
            "last_changed last_negative last_below_full last_nonzero last_zero least",
            "last_unpressed unanswered last_sound since last_found",
            "pressed_at latest smooth highest strongest lowest fastest risen_at",
        ]
    ),
)
"""State of a taxel. Times are in seconds since the first reading.

`first_received`, `last_received`, `last_used`: time of the first data since the taxel
is known, of the latest, and of the latest while it had no fault. `counts`: latest
counts; `accepted`: the latest of no outage; `first` to `fourth`: the latest four, NaN
where they are not known.

Rest: `rest` [counts]; `known_rest`, that before the latest silence, or the calibrated
one, NaN where there is none; `above`, the counts above rest at the latest scan;
`bound`, those of them that touched taxels of its lines may add; `confirmed`, the
lesser of those of two scans if they are at most `SHORTEST_PRESS` apart; `peak`, the
recent peak of `confirmed` of it and its neighbours, which fades; `margin`, the counts
above rest from which it may be touched; `low` and `low_since`, the counts of the latest
scan where they were below rest, and since when they are; `touched_since`, infinite
while it is not touched; `last_touched`, when it or a neighbour was; `steady_level` and
`steady_since`, the counts near which the latest ones stayed, and since when;
`sample_count` and `next_sample`, the samples taken for the tare, and when the next one
is due.

Noise: `noise` and `wander`, its standard deviation from scan to scan and about rest
[counts]; `noise_limit`, the counts above rest that may be noise; `band`, the counts
from which it is away from rest, for faults; `floor`, the pressure that may be noise
[kPa].

Faults: `suspicion`, how clear the signs of a fault are; `flat_since`, `flat_level`,
`flat_step`: since when it has been flat after a lone step, at which counts, after which
step; `last_doubted`, when it was last doubtful; `code`, its fault, `NO_FAULT` for none;
`since` and `last_found`, since when it is faulty, and when a sign of it was last found;
`last_sound`, when it was last no noisy taxel; `last_changed`, `last_negative`,
`last_below_full`, `last_nonzero`, `last_zero`: when its counts last did so; `least`,
its smallest counts above zero; `last_unpressed` and `unanswered`, when no neighbour was
last pressed, and for how long it did not respond while they were.

Contact: `pressed`, whether something presses it; `clear`, whether clearly more than
what may be noise; `pressed_at`, when something last did;
`onset`, the stamp since which it is in contact [ns]; `released`, whether its contact
has ended although it has not been at rest since; `latest`, its latest pressure;
`smooth`, the same without noise; `highest`, the greatest since it is pressed, and
`strongest`, the greatest smooth one, which fades; `lowest`, the smallest smooth one
since its contact ended [kPa]; `fastest`, the greatest rate at which it fell [1/s];
`moved` and `changed`, whether it rose at this reading, and at the one before;
`risen_at`, when it last rose alone; `touch`, the touch of the latest contact that it
was in, 0 for none; `scratch_index`, a temporary variable, -1 between
readings."""

PATCH = build_dtype(
    "may_press only_zeros outcome side",
    "first_seen last_seen refused_since turned_at",
)
"""State of a patch: the time of its first data, or of the first after a long silence,
and of the latest [s]; since when its data is refused, infinite while it is used;
whether a hand may have caused the data that is refused; whether all its counts were
zero so far; the outcome of the check of the latest scan; and on which side of rest a
part of it was, 1 above, -1 below, 0 if it is not known, and since when [s]."""


class Instant(NamedTuple):
    """An instant is the time of a reading.

    It tells how old all else is. Taxels and patches hold times in seconds since the
    first reading, whose age is `now` less the time; contacts, tracks and touches hold
    stamps.
    """

    stamp: int
    """Time at which it was taken [ns]."""
    now: float
    """Time since the first reading [s]."""
    previous: float
    """Time of the previous reading since the first [s]; that of this one if it is the
    first."""
    elapsed: float
    """Time since the previous reading [s]; 0 at the first."""
    previous_stamp: int
    """Stamp of the previous reading [ns]; that of this one if it is the first."""
    first_stamp: int
    """Stamp of the first reading [ns]."""

    def seconds_since(self, stamp: int) -> float:
        """Return the time from a stamp to this reading [s]."""
        return seconds_between(stamp, self.stamp)

    def stamp_at(self, time: float) -> int:
        """Return the stamp [ns] of a time since the first reading [s]."""
        return self.first_stamp + round(time * NS_PER_S)


@final
class ReadingClock:
    """A clock turns stamps into the time since the first reading; stateful."""

    def __init__(self) -> None:
        """Start before the first reading."""
        self.latest: Instant | None = None

    def advance_to(self, stamp: int) -> Instant:
        """Advance to a reading of a stamp [ns].

        Raises:
            ReadingError: It is not later than the latest one.
        """
        first = stamp
        last = stamp
        if self.latest is not None:
            first = self.latest.first_stamp
            last = self.latest.stamp
            check_order(last, stamp)
        self.latest = Instant(
            stamp=stamp,
            now=seconds_between(first, stamp),
            previous=seconds_between(first, last),
            elapsed=seconds_between(last, stamp),
            previous_stamp=last,
            first_stamp=first,
        )
        return self.latest


class TaxelPlaces(NamedTuple):
    """Places say where each taxel is on its link, and to what it belongs."""

    positions: Float[np.ndarray, "taxel 3"]
    """Positions in the frames of the links [m]."""
    normals: Float[np.ndarray, "taxel 3"]
    """Outward normals in the frames of the links; unit."""
    areas: Float[np.ndarray, "taxel"]
    """Areas [m2]."""
    adjacency: Adjacency
    """Neighbours on the same link. They are those beside a taxel, but for the tracker
    those that its contacts connect, by a reach that its configuration gives."""
    patches: TaxelGroups
    rows: TaxelGroups
    columns: TaxelGroups

    @classmethod
    def build(cls, skin: Skin) -> "TaxelPlaces":
        """Build the places of the taxels of a skin."""
        return cls(
            positions=np.array(skin.positions, np.float64),
            normals=np.array(skin.normals, np.float64),
            areas=np.array(skin.areas, np.float64),
            adjacency=Adjacency.build(skin),
            patches=TaxelGroups.build(skin, np.asarray(skin.patch_index)),
            rows=TaxelGroups.build(skin, np.asarray(skin.rows)),
            columns=TaxelGroups.build(skin, np.asarray(skin.columns)),
        )


def build_taxels(count: int) -> np.ndarray:
    """Build the state (taxel) of a skin, which `begin_taxels` begins."""
    taxels = np.zeros(count, TAXEL)
    taxels["scratch_index"] = -1
    taxels["last_doubted"] = NEVER
    return taxels


def build_patches(count: int) -> np.ndarray:
    """Build the state (patch) of a skin of which no data has been received."""
    patches = np.zeros(count, PATCH)
    for name in ("first_seen", "last_seen"):
        patches[name] = NEVER
    patches["refused_since"] = math.inf
    patches["only_zeros"] = True
    return patches
