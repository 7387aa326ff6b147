"""Follow the touches of a front end in a stream, and score how they begin and end."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from eskin.learn.events import ScoredStream, TrueEvent, score_events
from eskin.learn.events.matching import MatchConfig, match_stream
from eskin.touch import TouchState
from eskin.units import NS_PER_S

NEAR = 0.1
"""Largest distance of a contact from the true touch that it belongs to [m]."""
TAKES_PART = 0.1
"""Time with a true touch from which a touch takes part in it [s], or half of it."""
COVERS = 0.5
"""Share of a true touch from which a touch covers it."""
GAP = 2.5
"""Median periods without true contact that make a gap."""

Figures = dict[str, list[float]]
"""Numbers of a stream, by their names."""


@dataclass(eq=False)
class Followed:
    """A followed touch is one touch of the front end, and the true ones it belongs to.

    It has the contacts of touches that were merged into it.
    """

    id: int
    shown: int
    """Stamp at which it was first shown [ns]."""
    last: int = 0
    """Last contact as last stated [ns]."""
    closed: int = 0
    """Stamp at which it closed [ns]; 0 before."""
    merged_into: int = 0
    """Id of the touch that it was merged into; 0 without."""
    members: set[int] = field(default_factory=set)
    """Its own id and those of the touches that were merged into it."""
    contacts: list[tuple[int, np.ndarray, float]] = field(default_factory=list)
    """Stamp [ns], place [m] and force [N] of its strongest contact at each reading."""


@final
class Follower:
    """A follower keeps the confirmed touches of all readings.

    Attributes:
        touches: touches by their ids, in the order in which they were shown.
    """

    def __init__(self) -> None:
        """Start before the first reading."""
        self.touches: dict[int, Followed] = {}

    def push(self, state: TouchState) -> None:
        """Add the touches of the next reading."""
        stamp = state.reading.stamp
        for touch in (*state.touches, *state.closed_touches):
            kept = self.touches.setdefault(touch.id, Followed(touch.id, stamp))
            kept.last = touch.last
            kept.merged_into = touch.merged_into or 0
            if touch.closed:
                kept.closed = stamp
            if touch.last == stamp:
                contact = touch.contact
                kept.contacts.append((stamp, contact.p_world, contact.force))

    def finish(self, stamp: int) -> list[Followed]:
        """Return the touches that were not merged into others; close the open ones."""
        whole: dict[int, Followed] = {}
        for touch in self.touches.values():
            root = self.find_root(touch)
            kept = whole.setdefault(root.id, Followed(root.id, root.shown, root.last))
            kept.shown = min(kept.shown, touch.shown)
            kept.closed = root.closed or stamp
            kept.contacts += touch.contacts
            kept.members.add(touch.id)
        return list(whole.values())

    def find_root(self, touch: Followed) -> Followed:
        """Return the touch that a touch was merged into at last."""
        while touch.merged_into in self.touches:
            touch = self.touches[touch.merged_into]
        return touch


@dataclass(frozen=True)
class Part:
    """A part is what one touch has of one true touch."""

    touch: int
    """Index of the touch."""
    event: int
    """Index of the true touch."""
    first: int
    """First reading at which both are in contact [ns]."""
    last: int
    """Last one [ns]."""
    readings: int
    """Number of them."""
    impulse: float
    """Sum of the forces of the touch in them [N]."""


def find_parts(events: Sequence[TrueEvent], touches: Sequence[Followed]) -> list[Part]:
    """Assign each contact of a touch to the nearest true touch with force."""
    places: dict[int, list[tuple[int, np.ndarray]]] = {}
    for number, event in enumerate(events):
        for stamp, place in zip(event.stamps.tolist(), event.path, strict=True):
            places.setdefault(stamp, []).append((number, place))
    parts: list[Part] = []
    for index, touch in enumerate(touches):
        shared: dict[int, dict[int, float]] = {}
        for stamp, place, force in touch.contacts:
            near = [
                (float(np.linalg.norm(place - true)), number)
                for number, true in places.get(stamp, ())
            ]
            distance, number = min(near, default=(np.inf, -1))
            if distance <= NEAR:
                by_stamp = shared.setdefault(number, {})
                by_stamp[stamp] = by_stamp.get(stamp, 0.0) + force
        for number, by_stamp in shared.items():
            first = min(by_stamp)
            last = max(by_stamp)
            impulse = sum(by_stamp.values())
            parts.append(Part(index, number, first, last, len(by_stamp), impulse))
    return parts


def find_taking_part(
    events: Sequence[TrueEvent], parts: Sequence[Part], period: float
) -> list[Part]:
    """Return the parts that are long enough to count."""
    least = TAKES_PART / period
    return [
        part
        for part in parts
        if part.readings >= min(least, 0.5 * len(events[part.event].stamps))
    ]


def classify_event(
    event: TrueEvent, parts: Sequence[Part], period: float
) -> tuple[bool, bool]:
    """Tell whether touches that follow each other share a true touch.

    The first answer is of a boundary in unbroken true contact; the second of one at a
    gap of it, as between two pats.
    """
    cut = parted = False
    ordered = sorted(parts, key=lambda part: part.first)
    for one, next_one in zip(ordered, ordered[1:], strict=False):
        if next_one.first <= one.last:
            continue
        within = (event.stamps >= one.last) & (event.stamps <= next_one.first)
        gaps = np.diff(event.stamps[within]) / NS_PER_S
        if len(gaps) and gaps.max() > GAP * period:
            parted = True
        else:
            cut = True
    return cut, parted


def is_joined(
    events: Sequence[TrueEvent], number: int, parts: Sequence[Part], period: float
) -> bool:
    """Tell whether a touch that covers a true touch covers another, earlier one."""
    event = events[number]
    covering = {
        (part.touch, part.event)
        for part in parts
        if part.readings >= COVERS * len(events[part.event].stamps)
    }
    return any(
        events[other].end < event.onset and (touch, number) in covering
        for touch, other in covering
    )


def score_stream(
    stream: ScoredStream, touches: Sequence[Followed], vocabulary: Sequence[str]
) -> Figures:
    """Return the figures of a stream, lists of one number where they are counts."""
    events = stream.events
    score = score_events([stream], vocabulary)
    total = score.total
    period = find_period(events)
    parts = find_parts(events, touches)
    taking_part = find_taking_part(events, parts, period)
    cut = parted = joined = 0
    for number, event in enumerate(events):
        own = [part for part in taking_part if part.event == number]
        is_cut, is_parted = classify_event(event, own, period)
        cut += is_cut
        parted += is_parted
        joined += is_joined(events, number, taking_part, period)
    main = find_main(parts)
    extra = [touch for n, touch in enumerate(touches) if n not in main.values()]
    during = [any(e.onset <= t.shown <= e.end for e in events) for t in extra]
    ends = list(measure_ends(events, touches, taking_part))
    poke = score.delays.get("poke")
    return {
        "touches": [len(events)],
        "felt": [len({part.event for part in taking_part})],
        "matched": [total.matched],
        "missed": [total.missed],
        "false": [total.false],
        "false, of no true touch": [count_stray(stream, touches, main)],
        "opened beside": [sum(during)],
        "opened after": [len(extra) - sum(during)],
        "cut": [cut],
        "parted": [parted],
        "joined": [joined],
        "poke": [] if poke is None else poke.after_end.tolist(),
        "latency": score.all_delays.after_end.tolist(),
        "late": [late for late, _ in ends],
        "closed": [closed for _, closed in ends],
    }


def find_period(events: Sequence[TrueEvent]) -> float:
    """Return the median time between readings with true contact [s]."""
    steps = [np.diff(event.stamps) for event in events]
    return float(np.median(np.concatenate(steps))) / NS_PER_S


def find_main(parts: Sequence[Part]) -> dict[int, int]:
    """Return the touch with the largest impulse of each true touch that is felt."""
    main: dict[int, Part] = {}
    for part in parts:
        if part.event not in main or part.impulse > main[part.event].impulse:
            main[part.event] = part
    return {event: part.touch for event, part in main.items()}


def count_stray(
    stream: ScoredStream, touches: Sequence[Followed], main: dict[int, int]
) -> int:
    """Count false detections of gestures by touches that are the main one of none."""
    places = {each: n for n, touch in enumerate(touches) for each in touch.members}
    matched = match_stream(stream, MatchConfig())
    false = [stream.detections[n] for n in matched.false_detections]
    used = set(main.values())
    return sum(places.get(found.touch) not in used for found in false)


def measure_ends(
    events: Sequence[TrueEvent], touches: Sequence[Followed], parts: Sequence[Part]
) -> Iterator[tuple[float, float]]:
    """Yield by how much each touch ends, and closes, after its last true touch [s]."""
    for index, touch in enumerate(touches):
        ends = [events[part.event].end for part in parts if part.touch == index]
        if ends:
            end = max(ends)
            yield (touch.last - end) / NS_PER_S, (touch.closed - end) / NS_PER_S
