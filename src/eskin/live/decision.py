"""This module decides which gesture of a touch to report, and builds the detection.

Each touch is reported once: as soon as a gesture is certain, at closing at the latest.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.live.model_config import DecisionConfig
from eskin.recording import DetectionRecord
from eskin.recording.records import NONE, UNKNOWN
from eskin.skin import Skin
from eskin.touch import Contact, LinkPoseCache, Touch, TouchRecord, TouchState
from eskin.units import NS_PER_S

AnyTouch = Touch | TouchRecord
"""A touch, or its record at every reading."""


@dataclass(frozen=True, eq=False)
class Decision:
    """A decision reports the gesture of a touch."""

    touch: int
    """Id of the touch."""
    gesture: str
    """One of the vocabulary, or `unknown`."""
    confidence: float
    """Calibrated probability of the likeliest gesture."""
    onset: int
    """When it began [ns since the epoch]."""
    likeliest: str = ""
    """The likeliest gesture where it is unknown."""


@dataclass
class PendingDecision:
    """A pending decision holds what the readings of an open touch have told so far."""

    onset: int
    """When the touch began [ns since the epoch]."""
    gesture: str | None = None
    """Gesture that was reported, if any."""
    leader: int = -1
    """Likeliest class while it is above its threshold, or -1."""
    since: int = 0
    """Stamp since which it is the leader [ns since the epoch]."""
    other_since: int | None = None
    """Stamp since which a class other than the reported one is likeliest."""
    latest: list[float] | None = None
    """Probabilities for the decision at closing."""


@final
class DecisionFilter:
    """A filter turns probabilities into one decision for each touch; it is stateful.

    1. While a touch is open, a gesture other than `none` is reported once its
       probability has been above its threshold for the whole of `dwell_seconds`; the
       threshold may be lower without contact. A touch whose contacts have not spanned
       `brief_seconds` waits: it may be the first pat of two, and what a program has
       done for a poke cannot be taken back. The probabilities that suspend an arm do
       not wait.
    2. When it closes and nothing has been reported, the likeliest class at its last
       reading is reported, even `none`; or `unknown` where that is below `least`, or
       is a gesture while all gestures together are below `deliberate`. Probabilities
       of their own count here: those of a model's closing layer, if it has one.
    3. A touch that merges into another counts as reported if either was reported.
    4. On a skin that is not calibrated, contact may never end, as under a tight sleeve.
       There no touch waits. One ends once another class than the reported one, or
       `none`, has been likeliest for the whole of `dwell_seconds`; another touch begins
       only with contact after that. The decision at closing uses the probabilities at
       its last contact, since later readings may belong to the next touch.
    5. Readings with a probability that is not finite decide nothing.
    """

    def __init__(
        self,
        vocabulary: tuple[str, ...],
        config: DecisionConfig | None = None,
        change_ends: bool = False,
    ) -> None:
        """Start without touches; the fourth rule applies if `change_ends`.

        Raises:
            ValueError: a threshold is of no gesture in the vocabulary.
        """
        self.vocabulary = vocabulary
        self.config = config or DecisionConfig()
        self.thresholds = build_thresholds(vocabulary, self.config)
        self.lifted = [
            threshold if math.isinf(threshold) else min(threshold, self.config.lifted)
            for threshold in self.thresholds
        ]
        self.lift = round(self.config.lift_seconds * NS_PER_S)
        self.brief = 0 if change_ends else round(self.config.brief_seconds * NS_PER_S)
        self.dwell = round(self.config.dwell_seconds * NS_PER_S)
        self.change_ends = change_ends
        self.pending: dict[int, PendingDecision] = {}

    def make_decisions(
        self,
        stamp: int,
        touches: Sequence[AnyTouch],
        closed: Sequence[AnyTouch],
        probabilities: Mapping[int, Float[np.ndarray, "class"]],
        closing: Mapping[int, Float[np.ndarray, "class"]] | None = None,
    ) -> list[Decision]:
        """Return the decisions at the next reading, at a stamp [ns since the epoch].

        Args:
            stamp: stamp of the reading.
            touches: touches that are open.
            closed: touches that have just closed.
            probabilities: probabilities of every open touch while it is open, by its
                id.
            closing: those that count if it closes after this reading; None for the
                same ones.
        """
        closing = probabilities if closing is None else closing
        decisions = self.close(closed)
        for touch in touches:
            pending = self.pending.get(touch.id)
            if pending is None:
                pending = self.pending[touch.id] = PendingDecision(touch.onset)
            # A list, since reading single elements of an array is slower.
            by_class: list[float] = probabilities[touch.id].tolist()
            at_closing: list[float] = closing[touch.id].tolist()
            if not math.isfinite(sum(by_class) + sum(at_closing)):
                continue
            if self.change_ends and self.has_changed(pending, stamp, by_class):
                reset_pending(pending, touch, stamp)
            if touch.last == stamp or not self.change_ends:
                pending.latest = at_closing
            decision = self.update(pending, touch, stamp, by_class)
            if decision is not None:
                decisions.append(decision)
        return decisions

    def has_changed(
        self, pending: PendingDecision, stamp: int, probabilities: list[float]
    ) -> bool:
        """Return whether another class has been likeliest for long enough."""
        leader = self.vocabulary[find_likeliest(probabilities)]
        if leader != NONE and pending.gesture in (None, leader):
            pending.other_since = None
            return False
        if pending.other_since is None:
            pending.other_since = stamp
        return stamp - pending.other_since >= self.dwell

    def update(
        self,
        pending: PendingDecision,
        touch: AnyTouch,
        stamp: int,
        probabilities: list[float],
    ) -> Decision | None:
        """Update the pending decision of a touch, and return it once it is due."""
        leader = find_likeliest(probabilities)
        is_lifted = stamp - touch.last >= self.lift
        threshold = (self.lifted if is_lifted else self.thresholds)[leader]
        certain = probabilities[leader] >= threshold
        if leader != pending.leader or not certain:
            pending.leader = leader if certain else -1
            pending.since = stamp
        dwelt = pending.leader >= 0 and stamp - pending.since >= self.dwell
        is_brief = touch.last - pending.onset < self.brief
        if pending.gesture is not None or not dwelt or is_brief:
            return None
        pending.gesture = self.vocabulary[leader]
        return Decision(touch.id, pending.gesture, probabilities[leader], pending.onset)

    def close(self, closed: Sequence[AnyTouch]) -> list[Decision]:
        """Return the decisions about touches that have closed."""
        decisions = []
        for touch in closed:
            pending = self.pending.pop(touch.id, PendingDecision(touch.onset))
            if touch.merged_into:
                new = PendingDecision(touch.onset)
                target = self.pending.setdefault(touch.merged_into, new)
                target.gesture = target.gesture or pending.gesture
            elif pending.gesture is None and pending.latest is not None:
                decisions.append(self.decide(touch, pending.onset, pending.latest))
        return decisions

    def decide(
        self, touch: AnyTouch, onset: int, probabilities: list[float]
    ) -> Decision:
        """Return the decision about a touch at closing."""
        leader = find_likeliest(probabilities)
        confidence = probabilities[leader]
        gesture = self.vocabulary[leader]
        is_deliberate = gesture == NONE or self.is_deliberate(probabilities)
        if confidence >= self.config.least and is_deliberate:
            return Decision(touch.id, gesture, confidence, onset)
        return Decision(touch.id, UNKNOWN, confidence, onset, gesture)

    def is_deliberate(self, probabilities: list[float]) -> bool:
        """Return whether a touch is a gesture, whichever, and not `none`."""
        if NONE not in self.vocabulary:
            return True
        other = 1.0 - probabilities[self.vocabulary.index(NONE)]
        return other >= self.config.deliberate


def reset_pending(pending: PendingDecision, touch: AnyTouch, stamp: int) -> None:
    """Forget what a touch has told so far: later contact is treated as another touch.

    A touch without contact that was not reported still waits for its closing.
    """
    if pending.gesture is not None or touch.last == stamp:
        pending.onset = stamp
        pending.gesture = None
        pending.latest = None


def find_likeliest(probabilities: list[float]) -> int:
    """Return the first of the classes with the highest probability."""
    return probabilities.index(max(probabilities))


def build_thresholds(
    vocabulary: tuple[str, ...], config: DecisionConfig
) -> list[float]:
    """Return the threshold of each class while a touch is open; infinity for `none`."""
    unknown = sorted(set(config.thresholds) - set(vocabulary))
    if unknown:
        raise ValueError(
            f"threshold of '{unknown[0]}', which the model does not know; allowed are "
            f"{', '.join(vocabulary)}"
        )
    thresholds = dict.fromkeys(vocabulary, config.threshold) | dict(config.thresholds)
    thresholds[NONE] = math.inf
    return [thresholds[name] for name in vocabulary]


RECORD_FIELDS = fields(DetectionRecord)
Heading = Literal["", "toward_tool", "toward_base", "left", "right"]
"""Direction of travel on a link: along it, or across it as seen by who faces the skin
there with the tool above."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A detection reports the gesture of one touch, once, and is never withdrawn."""

    stamp: int
    """When it was reported: the stamp of the latest reading [ns since the epoch]."""
    touch: int
    """Id of the touch."""
    gesture: str
    """One of the model's vocabulary, or `unknown`."""
    confidence: float
    """Calibrated probability of the gesture; if unknown, of the likeliest."""
    onset: int
    """First contact [ns since the epoch]."""
    end: int
    """Latest contact by `stamp` [ns since the epoch]."""
    link: str
    """Link of the most loaded taxel at `end`."""
    patch: str
    """Patch of that taxel."""
    p_world: Float[np.ndarray, "3"]
    """Force-weighted centre of the strongest contact at `end` [m]."""
    n_world: Float[np.ndarray, "3"]
    """Mean outward normal of that contact."""
    direction_world: Float[np.ndarray, "3"]
    """Unit vector of travel at `end`, without the robot's own motion; zero where the
    touch stayed in its place."""
    peak_force: float
    """Greatest force until `stamp` [N]."""
    heading: Heading = ""
    """Direction of travel along or across the link; empty where it has none."""
    likeliest: str = ""
    """Likeliest class where the gesture is `unknown`, perhaps `none`; else empty."""
    taxel: int | None = None
    """Index of the taxel of `patch` that is nearest to the centre of that contact; None
    where it is not known."""

    def record(self) -> DetectionRecord:
        """Return the row that a recording keeps of it."""
        kept = {field.name: getattr(self, field.name) for field in RECORD_FIELDS}
        for name in ("p_world", "n_world", "direction_world"):
            kept[name] = tuple(kept[name].tolist())
        return DetectionRecord(**kept)


MIN_HEADING = 0.5
"""Part of a direction along or across the link from which it counts."""


def find_row(state: TouchState, touch: int) -> TouchRecord:
    """Return the record of a touch with an id."""
    [row] = [row for row in state.rows if row.id == touch]
    return row


@final
class DirectionTracker:
    """A tracker keeps the state of every open touch at its latest contact.

    Directions are needed rarely, so they are computed on request.
    """

    def __init__(self, poses: LinkPoseCache, min_travel: float) -> None:
        """Start without touches; less than `min_travel` [m] has no direction."""
        self.poses = poses
        self.min_travel = min_travel
        self.contacts: dict[int, tuple[TouchState, np.ndarray]] = {}

    def update(self, state: TouchState) -> None:
        """Keep the state of the touches that are in contact at this reading."""
        if not state.tracking.open:
            return
        contact = state, self.poses.get(state.reading.q)
        for touch in state.tracking.open:
            if touch.last == state.reading.stamp:
                self.contacts[touch.id] = contact

    def compute_direction(self, touch: int) -> Float[np.ndarray, "3"]:
        """Return the direction of the touch with that id at its latest contact.

        It is a unit vector in the world, zero where the touch stayed in its place.
        """
        state, T_world_link = self.contacts[touch]
        row = find_row(state, touch)
        return T_world_link[row.link, :3, :3] @ self.compute_travel(row)

    def compute_travel(self, row: TouchRecord) -> Float[np.ndarray, "3"]:
        """Return the direction of a touch in its link's frame, zero if it stayed."""
        travel = np.subtract(row.latest, row.start)
        distance = np.linalg.norm(travel)
        return np.zeros(3) if distance <= self.min_travel else travel / distance

    def find_heading(self, touch: int, n_world: Float[np.ndarray, "3"]) -> Heading:
        """Return along or across which side of its link a touch has travelled.

        `n_world` is the outward normal of the skin at its latest contact.
        """
        state, T_world_link = self.contacts[touch]
        row = find_row(state, touch)
        robot = state.mounted.robot
        axis = robot.find_axis(robot.link_names[row.link])
        n_link = T_world_link[row.link, :3, :3].T @ n_world
        travel = self.compute_travel(row)
        along = float(travel @ axis)
        across = float(travel @ np.cross(axis, n_link))
        if max(abs(along), abs(across)) < MIN_HEADING:
            return ""
        if abs(along) >= abs(across):
            return "toward_tool" if along > 0 else "toward_base"
        return "right" if across > 0 else "left"

    def forget(self, closed: Sequence[AnyTouch]) -> None:
        """Drop touches that have closed."""
        for touch in closed:
            self.contacts.pop(touch.id, None)


def build_detection(
    decision: Decision,
    touch: Touch,
    stamp: int,
    direction_world: Float[np.ndarray, "3"],
    heading: Heading = "",
    taxel: int | None = None,
) -> Detection:
    """Return the detection that reports a decision about a touch at a stamp [ns]."""
    contact = touch.contact
    return Detection(
        stamp=stamp,
        touch=touch.id,
        gesture=decision.gesture,
        confidence=decision.confidence,
        onset=decision.onset,
        end=touch.last,
        link=contact.link,
        patch=contact.patch,
        p_world=contact.p_world,
        n_world=contact.n_world,
        direction_world=direction_world,
        peak_force=touch.peak_force,
        heading=heading,
        likeliest=decision.likeliest,
        taxel=taxel,
    )


def find_central_taxel(contact: Contact, skin: Skin) -> int:
    """Return the taxel of a contact, on its patch, that is nearest to its centre."""
    [patch] = skin.find_patches((contact.patch,))
    own = contact.taxels[skin.patch_index[contact.taxels] == patch]
    distances = np.linalg.norm(skin.positions[own] - contact.p_link, axis=1)
    return int(own[np.argmin(distances)])
