"""This module guides a person who presses a skin, and measures its calibration so.

A guide measures rest first, then asks for presses.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from enum import unique
from typing import Generic, Literal, TypeVar, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.calibration.gains import (
    FingertipPress,
    GainEstimate,
    estimate_gains,
)
from eskin.calibration.rest import (
    MIN_SAMPLES,
    RestEstimate,
    estimate_rest,
    find_resting_hand,
)
from eskin.reasons import Cause, Reason
from eskin.skin import MountedSkin, Skin
from eskin.skin.wiring import find_nearest_taxel
from eskin.touch import (
    Adjacency,
    Calibration,
    Contact,
    Fault,
    FaultConfig,
    FrontEnd,
    PressDetector,
    Scan,
    TouchPipeline,
    TouchState,
)
from eskin.touch.faults import TAXEL_KINDS
from eskin.touch.touches import MIN_PRESS_FORCE, MIN_PRESS_SECONDS
from eskin.units import NS_PER_S, format_count

PLACES = ((0.5, 0.5), (0.25, 0.25), (0.75, 0.75), (0.25, 0.75), (0.75, 0.25))
"""Rows and columns of the presses that are asked for, as fractions of a patch's grid.
"""
STUCK_SHARE = 0.8
"""Share of the time at rest for which a stuck taxel keeps its counts."""
TOUCH_PRESSURE = 2.0
"""Pressure on a taxel that is touched during rest, and below rest where a hand has been
lifted [kPa]: drift and noise stay below."""
RESTLESS = 0.02
"""Share of the scans at rest in which a taxel may seem touched."""
MAX_RESTLESS = 0.3
"""Share of such taxels from which the whole skin is noisy, and none is left out."""
TOUCH_TAXELS = 2
"""Number of such taxels from which a contact is a touch and no noisy taxel."""
LIFTED_TAXELS = 3
"""Number of taxels of a patch below rest from which a hand has been lifted."""
APART = 1.0
"""Time without touch after which another one is told [s]."""
TOP = 0.9
"""Share of the greatest force above which scans of a press are averaged."""
TIP_LEVEL = 0.2
"""Share of the greatest pressure at which the width of a press is measured."""
MAX_TIP_AREA = 8e-4
"""Largest area above that pressure that one fingertip presses [m2]."""
MAX_TIP_TRAVEL = 0.015
"""Largest distance that a fingertip moves during a press [m]."""
BITS = (10, 12, 14)
"""Bits of converters that counts which need no more may come from."""


Press = TypeVar("Press")


@unique
class PressRefusal(Cause):
    """A refusal of a press is why it is not used."""

    WIDE = ("that was wider than one fingertip", "press with one fingertip")
    MOVED = ("the finger moved", "keep it in its place for a second")
    FAULTY_TAXEL = (
        "a taxel beside it is faulty",
        "press elsewhere on the patch, or leave the patch out",
    )
    OTHER_PATCH = ("felt on patch '{patch}'", "press the patch that is asked for")


@dataclass(frozen=True)
class GuideEvent:
    """An event is what a scan has led to."""

    kind: Literal["touched", "awaited", "rested", "pressed", "refused", "turned"]
    """`touched`: rest begins again, since the skin is touched; `awaited`: the time at
    rest is over, but more scans are needed; `rested`: rest is measured; `pressed`: a
    press was measured; `refused`: one was not; `turned`: counts go the other way under
    pressure, and all presses so far are forgotten."""
    text: str = ""
    """Reason for which rest begins again, goes on, or a press is refused; the way of
    counts."""
    taxel: int | None = None
    """Taxel of greatest pressure of a press."""


@dataclass(frozen=True)
class PressRequest:
    """A request tells where to press, and how hard."""

    name: str
    """Name by which it can be left out: of its patch, or of its point."""
    taxel: int
    """Taxel nearest to the place."""
    p_link: tuple[float, float, float]
    """The place in the frame of the taxel's link [m]."""
    force: float | None = None
    """Force [N]; None for a usual press."""


class PressSummary:
    """A summary collects the strongest contact of each scan of a press."""

    def __init__(self) -> None:
        """Start without a scan."""
        self.contacts: list[Contact] = []
        self.pressures: list[np.ndarray] = []  # of all taxels [kPa]

    def add_state(self, state: TouchState) -> None:
        """Add the next scan."""
        self.contacts.append(max(state.contacts, key=lambda each: each.force))
        self.pressures.append(state.reading.pressure)

    def find_firm(self, share: float = TOP) -> Int[np.ndarray, "scan"]:
        """Find the scans with a share of the greatest force or more."""
        forces = np.array([contact.force for contact in self.contacts])
        return np.flatnonzero(forces >= share * forces.max())

    @property
    def taxels(self) -> Int[np.ndarray, "some"]:
        """Taxels of the contact at the greatest force."""
        return self.contacts[self.find_firm(1.0)[0]].taxels

    def measure_area(self, skin: Skin) -> float:
        """Return the area above `TIP_LEVEL` at the greatest force [m2]."""
        pressure = self.pressures[self.find_firm(1.0)[0]][self.taxels]
        wide = self.taxels[pressure >= TIP_LEVEL * pressure.max()]
        return float(skin.areas[wide].sum())

    def measure_travel(self) -> float:
        """Return the way of the centre while the force is more than half [m]."""
        firm = self.find_firm(0.5)
        first, last = self.contacts[firm[0]], self.contacts[firm[-1]]
        return float(np.linalg.norm(last.p_link - first.p_link))

    def compute_counts(self, calibration: Calibration) -> Float[np.ndarray, "some"]:
        """Return the mean counts above rest of `taxels` in the firm scans."""
        pressed = replace(
            calibration, gain=calibration.gain[self.taxels], noise=None, rest=None
        )
        above = [
            pressed.compute_counts(self.pressures[n][self.taxels])
            for n in self.find_firm()
        ]
        return np.mean(above, axis=0)

    def sum_pressure(self) -> Float[np.ndarray, "taxel"]:
        """Return the sum of the pressures in contact in the firm scans [kPa]."""
        total = np.zeros(len(self.pressures[0]))
        for n in self.find_firm():
            taxels = self.contacts[n].taxels
            total[taxels] += self.pressures[n][taxels]
        return total


class PressGuide(ABC, Generic[Press]):
    """A guide measures rest, then asks for presses until it has all of them.

    It is pushed scan by scan, from a device or a recording, and knows neither terminal
    nor page.

    Attributes:
        mounted: the skin on its robot.
        assumed: calibration with which presses are felt; its way is that of the counts.
        phase: the measurement that goes on.
        presses: presses so far.
        rest_seconds: time without touch that is asked for first [s].
        state: contacts and pressures at the latest scan; None before the first.
        began: stamp of the first scan at rest that holds data; None before.
        samples: number of scans at rest in which each taxel was received.
        refusals: why presses were refused, one reason each.
    """

    def __init__(
        self, mounted: MountedSkin, calibration: Calibration, rest_seconds: float
    ) -> None:
        """Start with rest."""
        self.mounted = mounted
        self.rest_seconds = rest_seconds
        self.phase: Literal["rest", "press", "done"] = "rest"
        self.presses: list[Press] = []
        self.assumed = calibration
        self.pipeline = TouchPipeline(mounted, calibration)
        self.detector = PressDetector()
        self.pressing = PressSummary()
        self.state: TouchState | None = None
        self.began: int | None = None
        self.samples = np.zeros(mounted.skin.count, np.int64)
        self.is_awaited = False
        self.is_restarted = False
        self.refusals: list[Reason] = []
        self.is_turned = False

    @property
    def skin(self) -> Skin:
        """The skin that is pressed."""
        return self.mounted.skin

    @property
    def is_pressed(self) -> bool:
        """Whether a press goes on."""
        return self.detector.since is not None

    @property
    def passed(self) -> float:
        """Time at rest that has passed [s]."""
        if self.state is None or self.began is None:
            return 0.0
        return (self.state.reading.stamp - self.began) / NS_PER_S

    @property
    def rest_share(self) -> float:
        """Share of the rest that is done: of its time, or of the scans it needs."""
        scans, _ = self.find_fewest()
        return min(self.passed / self.rest_seconds, scans / MIN_SAMPLES, 1.0)

    @property
    def progress(self) -> float:
        """Share of the time at rest, or of the presses asked for, that is done."""
        return self.rest_share if self.phase == "rest" else self.press_share

    @property
    @abstractmethod
    def press_share(self) -> float:
        """Share of the presses asked for that is done."""

    @property
    @abstractmethod
    def request(self) -> PressRequest | None:
        """Where to press next; None where no press is missing."""

    def push(self, scan: Scan) -> GuideEvent | None:
        """Process the next scan, and return what it has led to."""
        state = self.state = self.pipeline.push_scan(scan)
        ways = {fault.kind for fault in state.faults} & {"falling", "rising"}
        if ways and not self.is_turned:
            self.turn()
            verb = "fall" if self.assumed.falling else "rise"
            return GuideEvent("turned", f"counts {verb} under pressure")
        if self.phase == "rest":
            return self.push_rest(self.pipeline.front_end.turn(scan), state)
        taxel = self.detector.find_press(state)
        if self.is_pressed:
            self.pressing.add_state(state)
            return None
        ended = self.pressing
        self.pressing = PressSummary()
        if taxel is None or self.phase == "done":
            return None
        refusal = self.find_refusal(ended, taxel)
        if refusal is not None:
            self.refusals.append(refusal)
            return GuideEvent("refused", refusal.what, taxel)
        self.presses.append(self.build_press(ended, taxel))
        self.phase = "done" if self.request is None else "press"
        return GuideEvent("pressed", taxel=taxel)

    def turn(self) -> None:
        """Take counts to go the other way, and ask for the presses so far again."""
        self.is_turned = True
        self.assumed = replace(self.assumed, falling=not self.assumed.falling)
        self.pipeline = TouchPipeline(self.mounted, self.assumed)
        self.detector = PressDetector()
        self.pressing = PressSummary()
        while self.presses:
            self.ask_again(self.presses.pop())
        self.phase = self.phase if self.phase == "rest" else "press"

    def push_rest(self, scan: Scan, state: TouchState) -> GuideEvent | None:
        """Process a scan of the time at rest, until it has passed with enough scans."""
        awaited = self.count_rest(scan)
        if self.rest_share < 1.0:
            return awaited
        self.phase = "press"
        return GuideEvent("rested")

    def count_rest(self, scan: Scan) -> GuideEvent | None:
        """Count a scan at rest; tell once that its time is over but scans are few."""
        if self.began is None and scan.received.any():
            self.began = scan.stamp
        self.samples += scan.received
        is_few = self.passed >= self.rest_seconds and self.rest_share < 1.0
        if not is_few or self.is_awaited:
            return None
        self.is_awaited = True
        text = f"{self.describe_scans()}; rest needs {MIN_SAMPLES}"
        return GuideEvent("awaited", text)

    def restart_count(self) -> None:
        """Forget the time at rest so far."""
        self.began = None
        self.samples[:] = 0
        self.is_awaited = False
        self.is_restarted = True

    def find_fewest(self) -> tuple[int, str]:
        """Find the patch of which fewest scans came at rest, and return how many.

        A patch counts by its taxel that was received most often. One of which nothing
        came, and one that is out as a whole, which is a fault of its own, are not
        waited for. Without any other, the number is 0 and the name empty.
        """
        most = np.zeros(len(self.skin.patches), np.int64)
        np.maximum.at(most, self.skin.patch_index, self.samples)
        faults = () if self.state is None else self.state.faults
        out = {fault.patch for fault in faults if fault.kind == "patch"}
        counted = [
            (int(count), patch.id)
            for count, patch in zip(most, self.skin.patches, strict=True)
            if count and patch.id not in out
        ]
        return min(counted, default=(0, ""))

    def describe_scans(self) -> str:
        """Describe how many scans have come at rest, and at what rate."""
        scans, patch = self.find_fewest()
        if not scans:
            return "no patch that is in order sends"
        rate = (scans - 1) / max(self.passed, 1e-9)
        return (
            f"{format_count(scans, 'scan')} of patch '{patch}' in {self.passed:.1f} s, "
            f"{rate:.2g} a second"
        )

    def check_rested(self) -> None:
        """Raise where rest was not measured.

        Raises:
            ValueError: the skin was touched, or too few scans came.
        """
        if self.phase != "rest":
            return
        if self.is_awaited or not (self.samples.any() or self.is_restarted):
            raise ValueError(
                f"too few scans came while hands were off: {self.describe_scans()}; "
                f"allowed are {MIN_SAMPLES} or more of each patch; check cable and "
                "power, let the device send more often, or wait longer (--wait)"
            )
        raise ValueError(
            f"the skin was not at rest for {self.rest_seconds:g} s; allowed is that "
            "time without touch; take all hands off and begin again"
        )

    @abstractmethod
    def find_refusal(self, press: PressSummary, taxel: int) -> Reason | None:
        """Return why a press on a taxel cannot be used, or None where it can."""

    @abstractmethod
    def build_press(self, press: PressSummary, taxel: int) -> Press:
        """Measure a press on a taxel, which is then no longer asked for."""

    def skip(self) -> None:
        """Leave out the current request, and ignore a press that goes on."""
        self.detector.drop()
        self.leave_out()
        if self.request is None:
            self.phase = "done"

    @abstractmethod
    def leave_out(self) -> None:
        """Ask no more for the current request."""

    def withdraw(self) -> None:
        """Forget the last press and ask for it again; ignore one that goes on."""
        self.detector.drop()
        self.ask_again(self.presses.pop())

    @abstractmethod
    def ask_again(self, press: Press) -> None:
        """Ask for a press again that is forgotten."""


@dataclass(frozen=True)
class GuideConfig:
    """A configuration says how long rest is, and how often and where to press."""

    seconds: float = 5.0
    """Time without touch [s]."""
    presses: int = 5
    """Number of presses of each patch; 0 measures rest alone."""
    patches: tuple[str, ...] = ()
    """Patches to press; all where none is named."""
    forces: tuple[float, ...] = ()
    """Forces of the presses of a patch, one after the other and again [N]; empty where
    they are not known."""
    is_scale_known: bool = False
    """Whether the calibration's full scale is known to be the converter's."""


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A result is a calibration and what was found on the way."""

    calibration: Calibration
    rest: RestEstimate
    faults: tuple[Fault, ...]
    """Faults at the end of rest, whole lines and patches as one."""
    codes: Int[np.ndarray, "taxel"]
    """Index in `TAXEL_KINDS` of the fault of each taxel at the end of rest, or -1."""
    restless: int
    """Number of other taxels that seemed touched at rest; no press uses them."""
    presses: tuple[FingertipPress, ...]
    refusals: tuple[Reason, ...]
    """Why presses that were felt are not used, one reason each."""
    gains: GainEstimate | None
    """Gains; None without a press."""

    def count_taxels(self, kind: str) -> int:
        """Return the number of taxels with a fault of a kind."""
        return int(np.count_nonzero(self.codes == TAXEL_KINDS.index(kind)))


@final
class CalibrationGuide(PressGuide[FingertipPress]):
    """A guide measures rest, then asks for presses until every patch has all of them.

    A press counts for the patch on which it is felt, wherever it was asked for.

    Attributes:
        skipped: patches that are no longer asked for.
        highest: highest count so far.
        largest: largest rise above rest since rest was measured [counts].
        strongest: taxel of that rise.
        firmest: greatest force since then [N].
    """

    def __init__(
        self,
        mounted: MountedSkin,
        calibration: Calibration,
        config: GuideConfig | None = None,
    ) -> None:
        """Start with rest.

        Raises:
            ValueError: the skin has no patch of a name that is configured.
        """
        self.config = config or GuideConfig()
        super().__init__(mounted, calibration, self.config.seconds)
        self.wanted = self.skin.find_patches(self.config.patches)
        self.adjacency = Adjacency.build(self.skin)
        self.on = self.pipeline.config.contacts.with_floor(calibration.floor).on
        self.touched_from = TOUCH_PRESSURE + calibration.floor
        self.min_touch_counts = calibration.compute_counts(self.touched_from)
        self.record: list[Scan] = []
        self.faults = self.build_fault_detector()
        self.rest: RestEstimate | None = None
        self.ignored = np.zeros(self.skin.count, bool)
        self.restless = 0
        self.skipped: set[int] = set()
        self.touched_at: int | None = None
        self.highest = self.strongest = 0
        self.largest = self.firmest = 0.0

    def build_fault_detector(self) -> FrontEnd:
        """Build a front end that finds stuck taxels within the time at rest."""
        seconds = min(FaultConfig().stuck_seconds, STUCK_SHARE * self.config.seconds)
        config = FaultConfig(stuck_seconds=seconds)
        return FrontEnd(self.skin, self.assumed.rising, faults=config)

    def push(self, scan: Scan) -> GuideEvent | None:
        """Process the next scan without taxels that seem touched at rest."""
        scan = replace(scan, received=scan.received & ~self.ignored)
        event = super().push(scan)
        self.highest = max(self.highest, int(scan.counts[scan.received].max(initial=0)))
        if self.rest is not None and self.state is not None:
            above = self.pipeline.front_end.turn(scan).counts - self.rest.rest
            rise = np.where(scan.received, above, 0.0)
            forces = [contact.force for contact in self.state.contacts]
            if rise.max() > self.largest:
                self.largest = float(rise.max())
                self.strongest = int(rise.argmax())
            self.firmest = max([self.firmest, *forces])
        return event

    @property
    def fewer_bits(self) -> int | None:
        """Bits of a converter with a smaller scale that has all counts; else None."""
        fit = [n for n in BITS if self.highest < 2**n - 1 < self.assumed.full_scale]
        return None if self.config.is_scale_known or not fit else fit[0]

    def push_rest(self, scan: Scan, state: TouchState) -> GuideEvent | None:
        """Collect a scan of the time at rest, which begins again after a touch."""
        text = self.describe_touch(scan, state)
        if text:
            return self.restart_rest(text, scan.stamp)
        awaited = self.count_rest(scan)
        self.record.append(scan)
        self.faults.make_reading(scan)
        if self.rest_share < 1.0:
            return awaited
        rest = estimate_rest(self.record, self.skin)
        hand = find_resting_hand(rest, self.skin, self.assumed)
        if hand.any():
            patch = self.skin.patches[self.skin.patch_index[np.argmax(hand)]].id
            text = f"a hand seems to rest on patch '{patch}'"
            return self.restart_rest(text, scan.stamp)
        restless = self.find_restless(rest) & ~self.faults.mask
        self.restless = int(np.count_nonzero(restless))
        self.ignored = self.faults.mask | restless
        self.rest = rest
        self.record = []
        self.phase = "press" if self.config.presses and self.wanted else "done"
        return GuideEvent("rested")

    def find_restless(self, rest: RestEstimate) -> Bool[np.ndarray, "taxel"]:
        """Find taxels that seemed touched in some scans at rest.

        They would begin presses by themselves, so they are not used for any.
        """
        contact = self.assumed.compute_counts(self.on)
        received = np.array([scan.received for scan in self.record])
        above = np.array([np.abs(scan.counts - rest.rest) for scan in self.record])
        number = np.maximum(np.sum(received, axis=0), 1)
        share = np.sum((above > contact) & received, axis=0) / number
        return (share >= RESTLESS) & (np.mean(share >= RESTLESS) < MAX_RESTLESS)

    def describe_touch(self, scan: Scan, state: TouchState) -> str:
        """Describe what touches the skin, or has just left it; empty for nothing."""
        for contact in state.contacts:
            pressure = state.reading.pressure[contact.taxels]
            if np.count_nonzero(pressure >= self.touched_from) >= TOUCH_TAXELS:
                return f"patch '{contact.patch}' is touched"
        above = scan.counts - self.pipeline.front_end.rest
        low = scan.received & (above < -self.min_touch_counts)
        if np.count_nonzero(low) >= LIFTED_TAXELS:
            lifted = np.bincount(self.skin.patch_index[low])
            if lifted.max() >= LIFTED_TAXELS:
                patch = self.skin.patches[int(np.argmax(lifted))].id
                return f"a hand has left patch '{patch}'"
        return ""

    def turn(self) -> None:
        """Take counts to go the other way; rest that is measured is turned, too."""
        super().turn()
        if self.rest is None:
            self.forget_rest()
            return
        self.rest = replace(self.rest, rest=self.assumed.turn_counts(self.rest.rest))
        self.pipeline = TouchPipeline(self.mounted, self.build_rested())

    def forget_rest(self) -> None:
        """Forget the scans at rest so far, and the faults that they showed."""
        self.restart_count()
        self.record = []
        self.faults = self.build_fault_detector()

    def build_rested(self) -> Calibration:
        """Return the assumed calibration with the rest and noise that were measured."""
        assert self.rest is not None
        rest = np.round(self.rest.rest, 2)
        if self.assumed.falling:
            rest = self.assumed.turn_counts(rest)
        noise = np.round(self.rest.noise, 3)
        return replace(self.assumed, noise=noise, rest=rest)

    def restart_rest(self, text: str, stamp: int) -> GuideEvent | None:
        """Forget the time at rest so far; tell it once for each touch."""
        self.forget_rest()
        last = self.touched_at
        self.touched_at = stamp
        apart = last is None or stamp - last > APART * NS_PER_S
        return GuideEvent("touched", text) if apart else None

    def find_refusal(self, press: PressSummary, taxel: int) -> Reason | None:
        """Return why a press on a taxel cannot be used, or None where it can."""
        if press.measure_area(self.skin) > MAX_TIP_AREA:
            return PressRefusal.WIDE.reason()
        if press.measure_travel() > MAX_TIP_TRAVEL:
            return PressRefusal.MOVED.reason()
        if self.has_fault(taxel):
            return PressRefusal.FAULTY_TAXEL.reason()
        return None

    def build_press(self, press: PressSummary, taxel: int) -> FingertipPress:
        """Measure a press on a taxel by its mean counts."""
        patch = int(self.skin.patch_index[taxel])
        above = press.compute_counts(self.assumed)
        return FingertipPress(patch, press.taxels, above, self.get_force(patch))

    def has_fault(self, taxel: int) -> bool:
        """Tell whether a taxel or one of its neighbours is faulty."""
        mask = self.ignored | self.pipeline.front_end.mask
        starts = self.adjacency.starts
        neighbours = self.adjacency.neighbours[starts[taxel] : starts[taxel + 1]]
        return bool(mask[taxel] or mask[neighbours].any())

    def count_presses(self, patch: int) -> int:
        """Return the number of presses of a patch so far."""
        return sum(press.patch == patch for press in self.presses)

    @property
    def press_share(self) -> float:
        """Share of the presses asked for that is done."""
        asked = self.config.presses
        done = [
            asked if patch in self.skipped else min(self.count_presses(patch), asked)
            for patch in self.wanted
        ]
        return sum(done) / (asked * len(done)) if asked and done else 1.0

    def get_force(self, patch: int) -> float | None:
        """Return the force of the next press of a patch [N]; None if not known."""
        forces = self.config.forces
        return forces[self.count_presses(patch) % len(forces)] if forces else None

    @property
    def request(self) -> PressRequest | None:
        """Where to press next; None where no press is missing."""
        for patch in self.wanted:
            count = self.count_presses(patch)
            if patch not in self.skipped and count < self.config.presses:
                taxel = self.find_place(patch, PLACES[count % len(PLACES)])
                x, y, z = self.skin.positions[taxel].tolist()
                name = self.skin.patches[patch].id
                force = self.get_force(patch)
                return PressRequest(name, taxel, (x, y, z), force)
        return None

    def find_place(self, patch: int, place: tuple[float, float]) -> int:
        """Return the taxel nearest to a place that has no fault beside it."""
        taxel = find_nearest_taxel(self.skin, self.skin.patches[patch].id, place)
        members = np.flatnonzero(self.skin.patch_index == patch)
        offsets = self.skin.positions[members] - self.skin.positions[taxel]
        order = members[np.argsort(np.linalg.norm(offsets, axis=1), kind="stable")]
        return next((int(i) for i in order if not self.has_fault(int(i))), taxel)

    def leave_out(self) -> None:
        """Ask for no more presses of the patch that is asked for."""
        if self.request is not None:
            self.skipped.add(int(self.skin.patch_index[self.request.taxel]))

    def ask_again(self, press: FingertipPress) -> None:
        """Ask for another press of a patch, also where it was left out."""
        self.skipped.discard(press.patch)

    def describe_unfelt(self) -> str:
        """Describe why no press was felt or used, and what may be done about it."""
        if self.refusals:
            last = self.refusals[-1]
            return (
                f"no press could be used, the last since {last.what}; allowed is one "
                f"fingertip that keeps its place for a second; {last.remedy}"
            )
        press = replace(self.assumed, gain=self.assumed.gain[[self.strongest]])
        pressure = float(press.compute_pressure(np.array([self.largest]))[0])
        bits = self.fewer_bits
        remedy = "press more firmly"
        if bits is not None and self.largest > 0:
            remedy += (
                f"; if the converter has {bits} bits, as no count was above "
                f"{2**bits - 1:,}, give --bits {bits}"
            )
        return (
            f"no press was felt: the largest rise was {self.largest:.0f} counts = "
            f"{pressure:.1f} kPa, the greatest force {self.firmest:.2f} N; allowed are "
            f"{MIN_PRESS_FORCE:g} N and more for {MIN_PRESS_SECONDS:g} s; {remedy}"
        )

    def finish(self) -> CalibrationResult:
        """Return the calibration from all that was measured.

        Raises:
            ValueError: rest was not measured, or no press that was asked for was felt.
        """
        self.check_rested()
        assert self.rest is not None
        if self.config.presses and self.wanted and not self.presses:
            raise ValueError(self.describe_unfelt())
        known = self.assumed.source
        calibration = replace(
            self.build_rested(), source="rest" if known == "nominal" else known
        )
        gains = None
        if self.presses:
            gains = estimate_gains(self.skin, self.assumed, tuple(self.presses))
            if self.fewer_bits is not None:
                small = self.assumed.with_full_scale(2**self.fewer_bits - 1)
                other = estimate_gains(self.skin, small, tuple(self.presses))
                if other.misfit < gains.misfit:
                    gains = other
                    calibration = calibration.with_full_scale(small.full_scale)
            calibration = gains.apply(calibration, self.skin)
            seconds = self.pipeline.tracker.release_seconds
            calibration = replace(calibration, release_seconds=seconds)
        return CalibrationResult(
            calibration,
            self.rest,
            self.faults.taxel_faults,
            self.faults.taxels["code"].copy(),
            self.restless,
            tuple(self.presses),
            tuple(self.refusals),
            gains,
        )
