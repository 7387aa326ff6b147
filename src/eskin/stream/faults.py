"""This module tells which parts of a skin are faulty: each in one line, and once."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, final

from eskin.drivers import Event
from eskin.skin import Skin
from eskin.touch import Fault
from eskin.units import NS_PER_S, format_count

REPEAT = 60 * NS_PER_S
"""Shortest time between two events of a part that comes and goes, or of many [ns]."""
SETTLE = 5 * NS_PER_S
"""Time in order after which a fault is told to be over [ns]."""
CHECK = NS_PER_S // 10
"""Time after which it is checked again what is to be told of the same faults [ns]."""
LISTED = 3
"""Number of parts of one kind and patch that are told one by one within `REPEAT`."""

REASONS = {
    "stuck": "frozen at one count",
    "dead": "frozen at zero",
    "negative": "below zero",
    "saturated": "at full scale",
    "noisy": "jumping without a touch",
    "row": "without valid data",
    "column": "without valid data",
    "patch": "silent or without valid data",
}
"""Why a part with a kind of fault is not used."""
WAY_TEXTS = {
    "falling": "counts that fall under pressure; use --falling, or run eskin "
    "calibrate, which finds that by itself: no touch is felt",
    "rising": "counts that rise under pressure; leave out --falling, or run eskin "
    "calibrate, which finds that by itself: no touch is felt",
}
"""What a patch has whose counts go another way than they are taken to."""

Place = tuple[str, str, int | None, int | None, int | None]
"""What kind of part it is; its patch, row, column and taxel."""
Group = tuple[str, str]
"""A kind of part, and the patch in which its parts are; empty for patches."""


@dataclass
class FaultyPart:
    """A part of the skin that is faulty, or was of late, and what was told of it."""

    fault: Fault
    """Its latest fault."""
    since: int
    """Stamp at which its first fault began, since it was last told to be over [ns]."""
    told: int
    """Stamp of the last event, or of its beginning [ns]."""
    is_out: bool = True
    """Whether it is faulty now."""
    ended: int = 0
    """Stamp at which the latest fault ended, where it is not faulty now [ns]."""
    told_kind: str | None = None
    """Kind of the fault that the last event tells of; None where that is over."""
    begun: int = 1
    """Number of faults that began since the last event."""
    flaps: bool = False
    """Whether it has come again soon after it ended."""

    def begin(self, fault: Fault) -> None:
        """Count the beginning of another fault."""
        self.since = self.since if self.is_told else fault.since
        self.is_out = True
        self.begun += 1
        self.flaps = True

    def is_due(self, stamp: int) -> bool:
        """Return whether an event of it is due at a stamp [ns]."""
        if not self.is_told:
            return self.begun > 0
        if self.begun:
            return stamp - self.told >= REPEAT
        if self.is_out:
            is_other = self.fault.kind != self.told_kind
            return is_other and stamp - self.told >= REPEAT
        return stamp - self.ended >= (REPEAT if self.flaps else SETTLE)

    @property
    def is_told(self) -> bool:
        """Whether the last event says that it is faulty."""
        return self.told_kind is not None

    @property
    def is_old(self) -> bool:
        """Whether all that there was to tell of it is told."""
        now = self.fault.kind if self.is_out else None
        return not self.begun and now == self.told_kind

    @property
    def kind(self) -> Literal["fault", "mended"]:
        """Kind of the event that is due."""
        return "fault" if self.is_out or self.begun else "mended"

    @property
    def is_repeated(self) -> bool:
        """Whether it came and went since the last event."""
        return self.begun > (0 if self.is_told or not self.is_out else 1)

    def mark(self, stamp: int) -> None:
        """Note that its event has been told at a stamp [ns]."""
        self.told_kind = self.fault.kind if self.kind == "fault" else None
        self.flaps &= self.is_told
        self.begun = 0
        self.told = stamp


@dataclass
class EventBudget:
    """A budget limits how many events a group of parts has within `REPEAT`."""

    single: list[int] = field(default_factory=list)
    """Stamps of events of one part each, within `REPEAT` [ns]."""
    together: int | None = None
    """Stamp of the last event of many parts [ns]."""

    def choose(self, stamp: int, count: int) -> Literal["single", "together", "wait"]:
        """Choose how a number of parts that are due at a stamp [ns] are told."""
        self.single = [each for each in self.single if stamp - each < REPEAT]
        if self.together is not None and stamp - self.together < REPEAT:
            return "wait"
        if len(self.single) + count > LISTED:
            self.together = stamp
            return "together"
        self.single += [stamp] * count
        return "single"


@final
class FaultReporter:
    """A reporter turns lists of current faults into events, few of them; stateful.

    The event of a fault is told when it begins, and another once the part has been in
    order for `SETTLE`. A part that comes and goes has one event in `REPEAT`, with the
    number of times; so have parts of a patch of which more than `LISTED` fail.

    Attributes:
        parts: parts that are faulty, or were within the last `REPEAT`.
    """

    def __init__(self, skin: Skin) -> None:
        """Start with a skin without faults."""
        self.skin = skin
        self.parts: dict[Place, FaultyPart] = {}
        self.budgets: dict[tuple[str, Group], EventBudget] = {}
        self.known: tuple[Fault, ...] = ()
        self.last = 0

    def report_faults(self, stamp: int, faults: Sequence[Fault]) -> list[Event]:
        """Return the events of a reading with some stamp [ns] and faults.

        A fault that becomes part of a larger one, such as a taxel whose row fails, does
        not count as over.
        """
        faults = tuple(faults)
        if faults == self.known and (not self.parts or stamp - self.last < CHECK):
            return []
        self.known = faults
        self.last = stamp
        self.update(stamp, faults)
        return self.tell([part for part in self.parts.values() if part.is_due(stamp)])

    def finish(self) -> list[Event]:
        """Return the events of all that is not told yet, at the end of the readings."""
        self.budgets.clear()
        return self.tell([part for part in self.parts.values() if not part.is_old])

    def update(self, stamp: int, faults: tuple[Fault, ...]) -> None:
        """Note which parts are faulty at a stamp [ns], and forget old ones."""
        now = {find_place(fault): fault for fault in faults}
        for place, fault in now.items():
            part = self.parts.get(place)
            if part is None:
                self.parts[place] = FaultyPart(fault, fault.since, stamp)
                continue
            if not part.is_out:
                part.begin(fault)
            part.fault = fault
        larger = [fault for fault in faults if fault.taxel is None]
        for place, part in list(self.parts.items()):
            if place in now:
                continue
            if any(covers(fault, part.fault) for fault in larger):
                if not part.is_told:
                    del self.parts[place]
                continue
            if part.is_out:
                part.is_out = False
                part.ended = stamp
            if part.is_old and stamp - part.ended >= REPEAT:
                del self.parts[place]

    def tell(self, due: list[FaultyPart]) -> list[Event]:
        """Return the events of parts that are due: of each, or of all of a group."""
        groups: dict[tuple[str, Group], list[FaultyPart]] = {}
        for part in sorted(due, key=lambda part: part.kind, reverse=True):
            key = part.kind, find_group(part.fault)
            groups.setdefault(key, []).append(part)
        events = []
        for key, parts in groups.items():
            budget = self.budgets.setdefault(key, EventBudget())
            way = budget.choose(self.last, len(parts))
            if way == "single":
                events += [self.build_event([part]) for part in parts]
            elif way == "together":
                events.append(self.build_event(self.gather(parts)))
        return events

    def gather(self, due: list[FaultyPart]) -> list[FaultyPart]:
        """Return the parts that are due and, of faults, others of their group."""
        if due[0].kind == "mended":
            return due
        group = find_group(due[0].fault)
        return [
            part
            for part in self.parts.values()
            if find_group(part.fault) == group and (part.is_out or part.begun)
        ]

    def build_event(self, parts: list[FaultyPart]) -> Event:
        """Build the event of one part, or of many of a group, which are then told."""
        text = describe_event(parts, self.last, self.skin)
        one = parts[0].fault
        kind = parts[0].kind
        if kind == "mended" and (left := self.find_covered(parts)):
            text += f", except {describe_places(left, self.skin)}"
        for part in parts:
            part.mark(self.last)
        if len(parts) == 1:
            return Event(
                self.last, kind, text, one.patch, one.row, one.column, one.taxel
            )
        return Event(self.last, kind, text, find_group(one)[1] or None)

    def find_covered(self, parts: list[FaultyPart]) -> list[Fault]:
        """Return the faults that larger parts include which are in order again."""
        return [
            part.fault
            for part in self.parts.values()
            if part.is_out and any(covers(larger.fault, part.fault) for larger in parts)
        ]


def find_place(fault: Fault) -> Place:
    """Return the place of a fault; the kind of a taxel's fault may change."""
    kind = fault.kind if fault.taxel is None else "taxel"
    return kind, fault.patch, fault.row, fault.column, fault.taxel


def find_group(fault: Fault) -> Group:
    """Return the parts among which a fault is told."""
    if fault.taxel is not None:
        return "taxel", fault.patch
    return fault.kind, fault.patch if fault.kind in ("row", "column") else ""


def covers(fault: Fault, other: Fault) -> bool:
    """Return whether a fault of a line or patch includes another."""
    if fault.patch != other.patch:
        return False
    if fault.kind in ("row", "column"):
        line = "row" if fault.kind == "row" else "column"
        return other.taxel is not None and getattr(fault, line) == getattr(other, line)
    return fault.kind == "patch"


def describe_way(faults: Sequence[Fault]) -> str:
    """Describe that counts go another way under pressure; empty where they do not."""
    texts = [
        f"patch '{fault.patch}' has {WAY_TEXTS[fault.kind]}"
        for fault in faults
        if fault.kind in WAY_TEXTS
    ]
    return "".join(texts[:1])


def describe_place(fault: Fault, skin: Skin) -> str:
    """Describe which taxel, row, column or patch of a skin a fault is of."""
    patch = skin.patches[skin.find_patches((fault.patch,))[0]]
    place = f"patch '{patch.id}'"
    if cell := patch.describe_cell(fault.row, fault.column):
        place = f"{cell} of {place}"
    return place if fault.taxel is None else f"taxel {fault.taxel} ({place})"


def describe_places(faults: Sequence[Fault], skin: Skin) -> str:
    """Describe the places of faults, many of a kind and patch by their number."""
    groups: dict[Group, list[Fault]] = {}
    for fault in faults:
        groups.setdefault(find_group(fault), []).append(fault)
    texts = []
    for several in groups.values():
        if len(several) > LISTED:
            texts.append(describe_group(several))
        else:
            texts += [describe_place(fault, skin) for fault in several]
    return ", ".join(texts)


def describe_group(faults: Sequence[Fault]) -> str:
    """Describe several faults of a group."""
    noun, patch = find_group(faults[0])
    if patch:
        return f"{format_count(len(faults), noun)} of patch '{patch}'"
    names = ", ".join(f"'{fault.patch}'" for fault in faults[:LISTED])
    more = len(faults) - LISTED
    names += f" and {more} more" if more > 0 else ""
    return f"{len(faults)} patches ({names})"


def describe_event(parts: list[FaultyPart], stamp: int, skin: Skin) -> str:
    """Describe what has happened to one part, or to many of a group."""
    faults = [part.fault for part in parts]
    is_one = len(parts) == 1
    what = describe_place(faults[0], skin) if is_one else describe_group(faults)
    if faults[0].kind in WAY_TEXTS and parts[0].kind == "fault":
        return f"{what} {'has' if is_one else 'have'} {WAY_TEXTS[faults[0].kind]}"
    verb = "is" if is_one else "are"
    whose = "its" if is_one else "their"
    if parts[0].kind == "mended":
        passed = max(part.ended for part in parts) - min(part.since for part in parts)
        return f"{what} {verb} in order again after {format_seconds(passed)}"
    if any(part.is_repeated for part in parts):
        when = " at times"
        times = format_count(sum(part.begun for part in parts), "time")
        passed = stamp - min(part.told for part in parts)
        how = f"{times} in {format_seconds(passed)}"
    else:
        when = " again" if all(part.flaps for part in parts) else ""
        how = f"for {format_seconds(stamp - min(fault.since for fault in faults))}"
    return (
        f"{what} {verb} faulty and not used{when}: {describe_reasons(faults)} {how}; "
        f"check {whose} lines and plug"
    )


def describe_reasons(faults: Sequence[Fault]) -> str:
    """Describe why parts are not used, and how many where the reasons differ."""
    counts = Counter(REASONS[fault.kind] for fault in faults).most_common()
    if len(counts) == 1:
        return counts[0][0]
    return ", ".join(f"{reason} ({count})" for reason, count in counts)


def format_seconds(nanoseconds: int) -> str:
    """Return a time [ns] in seconds, minutes or hours, whichever is readable."""
    seconds = nanoseconds / NS_PER_S
    if seconds < 1:
        return f"{max(seconds, 0.1):.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"
