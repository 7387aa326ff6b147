"""This module keeps what commands depend on for each touch, until it has closed."""

import math
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.command.command_map import CommandMap, Rule
from eskin.command.reasons import Problem
from eskin.command.skin_monitor import SkinMonitorConfig
from eskin.live import Detection
from eskin.reasons import Reason
from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.touch import Calibration, TouchRecord
from eskin.units import NS_PER_S

PA_PER_KPA = 1000.0
FULL_SHARE = 0.8
"""Share of full scale above rest from which a taxel reads nearly full scale; rest lies
at up to a fifth of it."""


@dataclass(eq=False)
class CommandedTouch:
    """A commanded touch is a touch with all that it has commanded."""

    id: int
    """Id of the touch."""

    onset: int | None = None
    """First contact [ns since the epoch]; None before it is felt."""

    last: int = 0
    """Stamp of the latest reading in which it pressed the skin [ns since the epoch]."""

    quiet_since: int | None = None
    """Stamp of the latest contact, until it was first felt, of any touch that began
    before it [ns since the epoch]; None before it is felt."""

    patch: str = ""
    """Patch of its strongest contact; empty before it is felt."""

    duration: float = 0.0
    """Time from its onset to its latest contact [s]."""

    force: float = 0.0
    """Its latest force [N]."""

    detected_force: float = math.inf
    """Greatest force until it was last detected [N]; infinite before."""

    detected_area: float = math.inf
    """Its area at full scale then [m2]."""

    full_area: float = 0.0
    """Area of its taxels that read nearly full scale [m2]."""

    light_since: int = 0
    """Stamp since which it is light [ns since the epoch]."""

    lasts: bool = False
    """Whether it has been light for so long that its duration does not count."""

    excess: Reason | None = None
    """In what it has exceeded the limits of force at some time; None if never."""

    probabilities: Float[np.ndarray, "class"] = field(
        default_factory=lambda: np.zeros(0)
    )
    """Its latest probabilities, in the order of the vocabulary; empty before."""

    stop_chance: float = 0.0
    """Probability that it is a gesture that stops a working arm, where it is."""

    stop_required: float = 1.0
    """Probability of these from which the arm pauses."""

    told: bool = False
    """Whether it was told that it has pressed the skin for long."""

    decided: bool = False
    """Whether the recogniser has said what it is, be it nothing or unknown."""

    blocked: bool = False
    """Whether it commands nothing more: the arm was stopped for it, or it has taken
    over a touch that has commanded."""

    asked: set[int] = field(default_factory=set)
    """Onsets with which it has commanded or asked to; where contact never ends, a touch
    is detected again with another one."""

    closed: bool = False
    """Whether it has closed."""

    heir: "CommandedTouch | None" = None
    """Touch that it has merged into, if any."""

    is_held: bool = False
    """Whether something still presses its taxels, though it has closed."""

    clashes: bool = False
    """Whether two that have commanded or asked to have merged into it."""

    @property
    def is_present(self) -> bool:
        """Whether it is open, or something still presses its taxels."""
        return self.is_held or not self.closed

    def has_commanded(self, onset: int) -> bool:
        """Return whether it has commanded or asked to; each touch does so once."""
        return self.blocked or onset in self.asked

    def begin(self, onset: int, stamp: int, quiet_since: int) -> None:
        """Update from the first reading in contact since an onset.

        Args:
            onset: time at which it began [ns since the epoch].
            stamp: stamp of the reading [ns since the epoch].
            quiet_since: stamp of the latest contact of any touch that began before it
                [ns since the epoch].
        """
        if self.quiet_since is None:
            self.quiet_since = quiet_since
        elif self.onset is not None and onset > self.onset:
            # It never left the skin, and is another gesture now.
            self.quiet_since = max(self.last, quiet_since)
        if self.onset is None:
            self.light_since = stamp
        self.onset = onset

    def feel(
        self, row: TouchRecord, patch: str, stamp: int, config: SkinMonitorConfig
    ) -> None:
        """Update from a reading in which it is in contact.

        Args:
            row: its record.
            patch: patch of its strongest contact.
            stamp: stamp of the reading [ns since the epoch].
            config: says until when a touch is light.
        """
        self.patch = patch
        self.force = row.force
        self.press(stamp, config)

    def press(self, stamp: int, config: SkinMonitorConfig) -> None:
        """Update how long and how hard it has pressed, until a stamp [ns]."""
        self.last = stamp
        if self.force > config.light_force:
            self.light_since = stamp
        if self.onset is not None:
            self.duration = (stamp - self.onset) / NS_PER_S
        self.lasts = stamp - self.light_since > config.light_seconds * NS_PER_S
        self.excess = self.excess or self.find_excess(config)

    def find_excess(self, config: SkinMonitorConfig) -> Reason | None:
        """Return in what it exceeds the limits of force now; None within them.

        Every touch has them, recognised or not.
        """
        grown = config.max_growth * max(self.detected_force, config.least_force)
        filled = config.max_growth * max(self.detected_area, config.least_full_area)
        if self.force > config.max_force:
            return Problem.STRONG_TOUCH.reason(force=self.force)
        if self.force > grown:
            return Problem.GROWN_FORCE.reason(force=self.force)
        if self.full_area > filled:
            area = 1e4 * self.full_area
            return Problem.GROWN_AREA.reason(square_centimetres=area)
        return None

    def is_long(self, config: SkinMonitorConfig) -> bool:
        """Return whether it has lasted for so long that the arm is paused."""
        return not self.lasts and self.duration > config.pause_seconds

    def merge(self, heir: "CommandedTouch") -> None:
        """Let the touch that it merges into inherit its record."""
        heir.decided |= self.decided
        heir.excess = heir.excess or self.excess
        heir.light_since = max(heir.light_since, self.light_since)
        heir.last = max(heir.last, self.last)
        if self.onset is not None and (heir.onset is None or self.onset < heir.onset):
            heir.quiet_since = self.quiet_since
        self.heir = heir
        heir.detected_force = min(heir.detected_force, self.detected_force)
        heir.detected_area = min(heir.detected_area, self.detected_area)
        if self.blocked or self.asked:
            heir.clashes |= self.clashes or heir.blocked or bool(heir.asked)
            heir.blocked = True


@dataclass(eq=False)
class CommandRequest:
    """A request is an action that a detection asks for, until that is decided."""

    touch: CommandedTouch
    """Touch that asks for it, or that has taken over the touch that did."""

    detection: Detection
    """Detection that asks for it."""

    rule: Rule
    """Rule that maps the detection to an action."""

    action: str
    """Plain action that it asks for."""

    required: float
    """Confidence that the action needs."""

    confidence: float
    """Probability of its gesture at the latest reading of the touch."""

    end: int
    """Stamp of the latest contact of the touch [ns since the epoch]."""

    @property
    def is_confident(self) -> bool:
        """Whether its confidence is high enough."""
        return self.confidence >= self.required


@final
class CommandedTouches:
    """These are the touches of the latest reading, and what they ask for.

    Attributes:
        by_id: each touch by its id.
        requests: actions that are asked for and not decided yet, in their order.
        felt: confirmed touches that press the skin in the latest reading.
        ended: touches that closed with the latest reading and merged into no other.
        latest: stamp of the latest reading [ns since the epoch].
        links: link of each patch.
        left_at: stamp of the latest contact of a touch that has left [ns since the
            epoch].
        stops: gestures that stop a working arm on each patch, by their indices in the
            vocabulary, with the probability from which it is paused.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        commands: CommandMap,
        vocabulary: tuple[str, ...],
        config: SkinMonitorConfig,
        now: int,
    ) -> None:
        """Start without touches at a time [ns since the epoch]."""
        self.config = config
        self.vocabulary = vocabulary
        self.areas = np.asarray(skin.areas)
        full = np.full(skin.count, FULL_SHARE * calibration.full_scale)
        self.full_pressure = calibration.compute_pressure(full)
        self.stops = {
            patch.id: commands.find_stops(vocabulary, patch) for patch in skin.patches
        }
        self.patches = tuple(self.stops)
        self.links = {patch.id: patch.link for patch in skin.patches}
        self.by_id: dict[int, CommandedTouch] = {}
        self.requests: list[CommandRequest] = []
        self.felt: list[CommandedTouch] = []
        self.ended: list[CommandedTouch] = []
        self.latest = now
        self.left_at = now

    def find_touch(self, touch: int) -> CommandedTouch:
        """Return a touch by its id; a new one where it is not known."""
        return self.by_id.setdefault(touch, CommandedTouch(touch))

    def update(self, recognition: RecognitionState) -> None:
        """Update all touches by the next recognition state."""
        state = recognition.state
        self.latest = state.reading.stamp
        held = {row.id for row in state.tracking.held}
        for number, touch in tuple(self.by_id.items()):
            touch.is_held = number in held
            if not touch.is_present:
                self.left_at = max(self.left_at, touch.last)
                del self.by_id[number]
        self.ended = []
        self.felt = []
        merged = {status.id: status.merged_into for status in state.closed}
        known = {number for number, one in self.by_id.items() if not one.closed}
        gone = known - merged.keys() - {one.id for one in state.tracking.open}
        for number in (*merged, *sorted(gone)):
            self.close(number, merged.get(number, 0))
            self.by_id[number].is_held = number in held
        for row in state.tracking.held:
            self.hold(self.find_touch(row.id), row, recognition)
        if state.open:
            for row in state.rows:
                if row.confirmed and not row.closed:
                    patch = self.patches[row.contact.patch]
                    self.update_touch(row, patch, recognition)
        lasts = {status.id: status.last for status in (*state.open, *state.closed)}
        for request in self.requests:
            touch = request.touch.id
            request.end = max(request.end, lasts.get(touch, request.end))
            probabilities = recognition.probabilities.get(touch)
            if probabilities is not None:
                index = self.vocabulary.index(request.detection.gesture)
                request.confidence = float(probabilities[index])

    def close(self, number: int, merged_into: int) -> None:
        """Note that a touch has closed, and what it has merged into; 0 is nothing."""
        touch = self.find_touch(number)
        touch.closed = True
        touch.lasts = False
        if merged_into:
            heir = self.find_touch(merged_into)
            touch.merge(heir)
            for request in self.requests:
                if request.touch is touch:
                    request.touch = heir
        else:
            self.ended.append(touch)

    def update_touch(
        self, row: TouchRecord, patch: str, recognition: RecognitionState
    ) -> None:
        """Update an open touch on a patch by its record and its probabilities."""
        touch = self.find_touch(row.id)
        stops = self.stops[patch]
        probabilities = recognition.probabilities.get(row.id)
        if probabilities is not None:
            touch.probabilities = probabilities
            touch.stop_chance = sum(float(probabilities[index]) for index in stops)
            touch.stop_required = min(stops.values(), default=1.0)
        touch.is_held = bool(len(row.held))
        if touch.is_held and row.last != self.latest:
            self.hold(touch, row, recognition)
        if row.last == self.latest:
            self.measure_full_area(touch, row.taxels, recognition)
            if touch.onset != row.onset:
                quiet_since = self.find_quiet(touch, row.onset)
                touch.begin(row.onset, self.latest, quiet_since)
            touch.feel(row, patch, self.latest, self.config)
            self.felt.append(touch)

    def hold(
        self, touch: CommandedTouch, row: TouchRecord, recognition: RecognitionState
    ) -> None:
        """Update a touch by the taxels that press on without contact."""
        if touch.onset is None:
            touch.onset = row.onset
            touch.light_since = row.onset
            touch.quiet_since = row.onset
        touch.patch = self.patches[row.contact.patch]
        pressure = recognition.state.reading.pressure[row.held]
        touch.force = float(PA_PER_KPA * pressure @ self.areas[row.held])
        self.measure_full_area(touch, row.held, recognition)
        touch.press(self.latest, self.config)
        self.felt.append(touch)

    def measure_full_area(
        self,
        touch: CommandedTouch,
        taxels: Int[np.ndarray, "some"],
        recognition: RecognitionState,
    ) -> None:
        """Measure the area of some taxels of a touch that read nearly full scale."""
        pressure = recognition.state.reading.pressure[taxels]
        is_full = pressure >= self.full_pressure[taxels]
        touch.full_area = float(self.areas[taxels[is_full]].sum())

    def find_quiet(self, touch: CommandedTouch, onset: int) -> int:
        """Return the stamp of the latest contact of any touch that began before [ns].

        Args:
            touch: the touch.
            onset: time at which it began [ns since the epoch].
        """
        lasts = [
            one.last
            for one in self.by_id.values()
            if one is not touch and one.onset is not None and one.onset < onset
        ]
        return max([self.left_at, *lasts])

    @property
    def last_contact(self) -> int:
        """Stamp of the latest contact anywhere [ns since the epoch]."""
        return max([self.left_at, *(one.last for one in self.by_id.values())])

    def find_suspending(self) -> CommandedTouch | None:
        """Return a touch for which a moving arm stands, or None where there is none.

        What is light and lasts slows the arm instead.
        """
        for touch in self.by_id.values():
            if touch.onset is not None and touch.is_present and not touch.lasts:
                return touch
        return None

    def find_lasting(self) -> Reason | None:
        """Return where a touch has been light for too long; None if there is none."""
        patches = [one.patch for one in self.by_id.values() if one.lasts]
        if not patches:
            return None
        seconds = self.config.light_seconds
        return Problem.LASTING_TOUCH.reason(patch=patches[0], seconds=seconds)

    def list_others(self, touch: CommandedTouch) -> list[CommandedTouch]:
        """Return the other touches that are present, however light and long."""
        return [
            one
            for one in self.by_id.values()
            if one is not touch and one.onset is not None and one.is_present
        ]

    def find_stop_chance(self, detection: Detection) -> float | None:
        """Return the chance that an unknown touch is a stop; None if it is too small.

        It is the chance at its latest reading, or the detection's confidence if the
        likeliest gesture stops the arm.
        """
        touch = self.find_touch(detection.touch)
        stops = self.stops[detection.patch]
        least = min(stops.values(), default=1.0)
        required = touch.stop_required if touch.patch else least
        chance = touch.stop_chance
        if detection.likeliest in [self.vocabulary[index] for index in stops]:
            chance = max(chance, detection.confidence)
        return chance if chance >= required else None
