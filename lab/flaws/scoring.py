"""Score the touches of a pipeline against true contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from eskin.live import UNKNOWN, Detection
from eskin.recording import NONE
from eskin.units import NS_PER_S

CONTACT_FORCE = 0.2
"""True force on all taxels from which there is contact [N]."""
STRONG_FORCE = 1.0
"""Peak force from which a touch must be found [N]."""
ONSET_SECONDS, END_SECONDS = 0.1, 0.3
"""Largest errors of the onset and of the end of a touch that is found [s]."""
NEAR = 0.15
"""Largest distance of a touch from the centre of the true force [m]."""


@dataclass(frozen=True, eq=False)
class TrueContact:
    """A true contact is the force of one touch of a person over time."""

    gesture: str
    """What a recogniser should answer."""
    stamps: Int[np.ndarray, "scan"]
    """Stamps of its scans, increasing [ns]."""
    force: Float[np.ndarray, "scan"]
    """Force on all taxels, mean over the period of the scan [N]."""
    centre: Float[np.ndarray, "scan 3"]
    """Centre of the force in the world [m]; NaN without force."""

    @property
    def pressed(self) -> np.ndarray:
        """Tell for each scan whether there is contact."""
        return self.force > CONTACT_FORCE

    @property
    def onset(self) -> int:
        """Stamp of the first scan with contact [ns]."""
        return int(self.stamps[self.pressed][0])

    @property
    def end(self) -> int:
        """Stamp of the last scan with contact [ns]."""
        return int(self.stamps[self.pressed][-1])

    @property
    def peak(self) -> float:
        """Largest force [N]."""
        return float(self.force.max())

    @property
    def presses(self) -> int:
        """Number of times that contact began."""
        before = np.concatenate([[False], self.pressed[:-1]])
        return int(np.sum(self.pressed & ~before))


@dataclass(frozen=True, eq=False)
class Sample:
    """A sample is what the pipeline says of an open touch at one scan."""

    stamp: int
    """Stamp of the scan [ns]."""
    force: float
    """Force now [N]."""
    p_world: Float[np.ndarray, "3"]
    """Place of its strongest contact [m]."""
    contacts: int
    """Number of times that it made contact."""
    answer: str
    """Most probable class."""


@dataclass(eq=False)
class Trail:
    """A trail is one touch of the pipeline over time."""

    id: int
    onset: int = 0
    """Onset as last stated [ns]."""
    last: int = 0
    """Last contact as last stated [ns]."""
    merged_into: int = 0
    """Id of the touch that it was merged into; 0 without."""
    samples: list[Sample] = field(default_factory=list)

    def find_sample(self, stamp: int) -> Sample | None:
        """Return the last sample up to a stamp [ns]."""
        found = [sample for sample in self.samples if sample.stamp <= stamp]
        return found[-1] if found else None


@dataclass(frozen=True)
class TouchScore:
    """A score says how one true contact was found."""

    gesture: str
    """What a recogniser should answer."""
    peak: float
    """Largest true force [N]."""
    presses: int
    """Number of true presses."""
    onset_error: float | None
    """Onset of the touch that covers it, less the true one [s]; None without one."""
    end_error: float | None
    """Last contact of that touch, less the true one [s]."""
    contacts: int
    """Number of contacts of that touch until shortly after the true end."""
    extra: int
    """Number of other touches that began meanwhile."""
    forced: str
    """Most probable class of that touch shortly after the true end."""
    live: str
    """First gesture that was detected; `unknown` or `none` without one."""

    @property
    def is_onset_found(self) -> bool:
        """Tell whether the onset is found in time."""
        return self.onset_error is not None and abs(self.onset_error) <= ONSET_SECONDS

    @property
    def is_end_found(self) -> bool:
        """Tell whether the end is found in time."""
        return self.end_error is not None and abs(self.end_error) <= END_SECONDS

    @property
    def is_one_touch(self) -> bool:
        """Tell whether its presses are the contacts of one touch, from the first on."""
        return self.is_onset_found and self.contacts == self.presses


def find_root(number: int, trails: Mapping[int, Trail]) -> int:
    """Return the id of the touch that a touch was merged into at last."""
    while trails[number].merged_into in trails:
        number = trails[number].merged_into
    return number


def find_cover(truth: TrueContact, trails: Mapping[int, Trail]) -> Trail | None:
    """Return the touch that covers a true contact.

    It is the one with the largest impulse near the true force while there is contact,
    with that of touches that were merged into it.
    """
    places = {
        int(stamp): centre
        for stamp, centre, pressed in zip(
            truth.stamps, truth.centre, truth.pressed, strict=True
        )
        if pressed
    }
    impulses: dict[int, float] = {}
    for trail in trails.values():
        gained = sum(
            sample.force
            for sample in trail.samples
            if sample.stamp in places
            and np.linalg.norm(sample.p_world - places[sample.stamp]) <= NEAR
        )
        root = find_root(trail.id, trails)
        impulses[root] = impulses.get(root, 0.0) + gained
    best = max(impulses, key=lambda key: impulses[key], default=None)
    if best is None or impulses[best] <= 0.0:
        return None
    return trails[best]


def find_live_answer(detections: Sequence[Detection]) -> str:
    """Return the first gesture that was detected, else `unknown` or `none`."""
    names = [one.gesture for one in detections if one.gesture != NONE]
    gestures = [name for name in names if name != UNKNOWN]
    return (gestures or names or [NONE])[0]


def score_touch(
    truth: TrueContact, trails: Mapping[int, Trail], detections: Sequence[Detection]
) -> TouchScore:
    """Score what the pipeline and the recogniser said of one true contact.

    Args:
        truth: true contact.
        trails: all touches of the pipeline that were open in its time, by id.
        detections: detections from its onset to the next touch.
    """
    cover = find_cover(truth, trails)
    after = truth.end + round(END_SECONDS * NS_PER_S)
    sample = cover.find_sample(after) if cover else None
    extra = {
        trail.id
        for trail in trails.values()
        if trail.onset >= truth.onset
        and cover
        and find_root(trail.id, trails) != cover.id
    }
    return TouchScore(
        gesture=truth.gesture,
        peak=truth.peak,
        presses=truth.presses,
        onset_error=(cover.onset - truth.onset) / NS_PER_S if cover else None,
        end_error=(cover.last - truth.end) / NS_PER_S if cover else None,
        contacts=sample.contacts if sample else 0,
        extra=len(extra),
        forced=sample.answer if sample else NONE,
        live=find_live_answer(detections),
    )
