"""This module guides a person through a calibration: rest first, then presses."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.calibration.gains import (
    FingertipPress,
    GainEstimate,
    GainPrior,
    estimate_gains,
)
from eskin.calibration.press_guide import GuideEvent, PressGuide
from eskin.calibration.rest import (
    RestEstimate,
    RestRecord,
    estimate_rest,
    find_resting_hand,
)
from eskin.skin import MountedSkin, Skin
from eskin.skin.wiring import find_nearest_taxel
from eskin.touch import (
    Adjacency,
    Calibration,
    Contact,
    Fault,
    FaultConfig,
    FaultDetector,
    PressDetector,
    Scan,
    TouchPipeline,
    TouchState,
)
from eskin.touch.faults import TAXEL_KINDS
from eskin.units import NS_PER_S

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


@dataclass(frozen=True)
class GuideConfig:
    """A configuration tells what is asked of the person."""

    seconds: float = 5.0
    """Time without touch [s]."""
    presses: int = 5
    """Number of presses of each patch; 0 measures rest alone."""
    patches: tuple[str, ...] = ()
    """Patches to press; all where none is named."""
    forces: tuple[float, ...] = ()
    """Forces of the presses of a patch, one after the other and again [N]; empty where
    they are not known."""
    prior: GainPrior = field(default_factory=GainPrior)
    """What is known before any press."""


@dataclass(frozen=True)
class PressRequest:
    """A request tells where to press, and how hard."""

    patch: int
    """Index of the patch."""
    taxel: int
    """Taxel in the middle of the place."""
    force: float | None
    """Force [N]; None for that of a usual press."""


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A result is a calibration and what was found on the way."""

    calibration: Calibration
    rest: RestEstimate
    faults: tuple[Fault, ...]
    """Faults at the end of rest, whole lines and patches as one."""
    codes: Int[np.ndarray, "taxel"]
    """Index in `TAXEL_KINDS` of the fault of each taxel at the end of rest, or -1."""
    presses: tuple[FingertipPress, ...]
    gains: GainEstimate | None
    """Gains; None without a press."""

    def count_taxels(self, kind: str) -> int:
        """Return the number of taxels with a fault of a kind."""
        return int(np.count_nonzero(self.codes == TAXEL_KINDS.index(kind)))


@dataclass(eq=False)
class PressScans:
    """The scans of a press that goes on."""

    forces: list[float] = field(default_factory=list)
    taxels: list[Int[np.ndarray, "some"]] = field(default_factory=list)
    pressures: list[Float[np.ndarray, "taxel"]] = field(default_factory=list)
    centres: list[Float[np.ndarray, "3"]] = field(default_factory=list)

    def add(self, contact: Contact, state: TouchState) -> None:
        """Add the strongest contact of a scan."""
        self.forces.append(contact.force)
        self.taxels.append(contact.taxels)
        self.pressures.append(state.reading.pressure)
        self.centres.append(contact.p_link)

    def measure_area(self, skin: Skin) -> float:
        """Return the area above `TIP_LEVEL` at the greatest force [m2]."""
        peak = int(np.argmax(self.forces))
        taxels = self.taxels[peak]
        pressure = self.pressures[peak][taxels]
        wide = taxels[pressure >= TIP_LEVEL * pressure.max()]
        return float(skin.areas[wide].sum())

    def measure_travel(self) -> float:
        """Return the way of the centre while the force is more than half [m]."""
        firm = np.flatnonzero(np.array(self.forces) >= 0.5 * max(self.forces))
        return float(np.linalg.norm(self.centres[firm[-1]] - self.centres[firm[0]]))

    def build_press(
        self, calibration: Calibration, patch: int, force: float | None
    ) -> FingertipPress:
        """Build the press from the mean counts of its scans of greatest force."""
        taxels = self.taxels[int(np.argmax(self.forces))]
        firm = np.flatnonzero(np.array(self.forces) >= TOP * max(self.forces))
        pressed = replace(
            calibration, gain=calibration.gain[taxels], noise=None, rest=None
        )
        above = [pressed.compute_counts(self.pressures[n][taxels]) for n in firm]
        return FingertipPress(patch, taxels, np.mean(above, axis=0), force)


@final
class CalibrationGuide(PressGuide[FingertipPress]):
    """A guide measures rest, then asks for presses until every patch has enough.

    A press counts for the patch on which it is felt, wherever it was asked for.

    Attributes:
        skipped: patches that are no longer asked for.
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
        self.mounted, self.assumed = mounted, calibration
        self.rest_seconds = self.config.seconds
        self.wanted = find_patches(self.skin, self.config.patches)
        self.adjacency = Adjacency.build(self.skin)
        self.pipeline = TouchPipeline(mounted, calibration)
        self.on = self.pipeline.config.contacts.with_floor(calibration.floor).on
        self.touched_from = TOUCH_PRESSURE + calibration.floor
        self.least_touch = calibration.compute_counts(self.touched_from)
        self.phase = "rest"
        self.record, self.faults = RestRecord(), self.build_fault_detector()
        self.rest: RestEstimate | None = None
        self.ignored = np.zeros(self.skin.count, bool)
        self.detector = PressDetector()
        self.pressing = PressScans()
        self.presses = []
        self.skipped: set[int] = set()
        self.touched_at: int | None = None
        self.state: TouchState | None = None

    def build_fault_detector(self) -> FaultDetector:
        """Build a detector that finds stuck taxels within the time at rest."""
        least = FaultConfig().stuck_seconds
        seconds = min(least, STUCK_SHARE * self.config.seconds)
        config = FaultConfig(stuck_seconds=seconds)
        return FaultDetector(self.skin, self.assumed, config, self.on)

    def push(self, scan: Scan) -> GuideEvent | None:
        """Process the next scan, and return what it has led to."""
        scan = replace(scan, received=scan.received & ~self.ignored)
        state = self.state = self.pipeline.push(scan)
        if self.phase == "rest":
            return self.push_rest(scan, state)
        if self.phase == "press":
            return self.push_press(state)
        return None

    def push_rest(self, scan: Scan, state: TouchState) -> GuideEvent | None:
        """Collect a scan of the time at rest, which begins again after a touch."""
        text = self.describe_touch(scan, state)
        if text:
            return self.restart_rest(text, scan.stamp)
        self.record.add(scan)
        baseline = self.pipeline.calibrator.state.baseline
        self.faults.push(scan, state.reading.pressure, baseline)
        if self.record.seconds < self.config.seconds:
            return None
        rest = estimate_rest(self.record, self.skin)
        hand = find_resting_hand(rest, self.skin, self.assumed)
        if hand.any():
            patch = self.skin.patches[self.skin.patch_index[np.argmax(hand)]].id
            text = f"a hand seems to rest on patch '{patch}'"
            return self.restart_rest(text, scan.stamp)
        self.ignored = self.faults.mask | self.find_restless(rest)
        self.rest, self.record = rest, RestRecord()
        self.phase = "press" if self.config.presses and self.wanted else "done"
        return GuideEvent("rested")

    def find_restless(self, rest: RestEstimate) -> Bool[np.ndarray, "taxel"]:
        """Find taxels that seemed touched in some scans at rest.

        They would begin presses by themselves, so they are not used for any.
        """
        contact = self.assumed.compute_counts(self.on)
        away = [np.abs(counts - rest.rest) > contact for counts in self.record.counts]
        seen = np.maximum(np.sum(self.record.received, axis=0), 1)
        share = np.sum(np.array(away) & self.record.received, axis=0) / seen
        return (share >= RESTLESS) & (np.mean(share >= RESTLESS) < MAX_RESTLESS)

    def describe_touch(self, scan: Scan, state: TouchState) -> str:
        """Describe what touches the skin, or has just left it; empty for nothing."""
        for contact in state.contacts:
            pressure = state.reading.pressure[contact.taxels]
            if np.count_nonzero(pressure >= self.touched_from) >= TOUCH_TAXELS:
                return f"patch '{contact.patch}' is touched"
        above = scan.counts - self.pipeline.calibrator.state.baseline
        low = scan.received & (above < -self.least_touch)
        if np.count_nonzero(low) >= LIFTED_TAXELS:
            lifted = np.bincount(self.skin.patch_index[low])
            if lifted.max() >= LIFTED_TAXELS:
                patch = self.skin.patches[int(np.argmax(lifted))].id
                return f"a hand has left patch '{patch}'"
        return ""

    def restart_rest(self, text: str, stamp: int) -> GuideEvent | None:
        """Forget the time at rest so far; tell it once for each touch."""
        self.record, self.faults = RestRecord(), self.build_fault_detector()
        last, self.touched_at = self.touched_at, stamp
        apart = last is None or stamp - last > APART * NS_PER_S
        return GuideEvent("touched", text) if apart else None

    def push_press(self, state: TouchState) -> GuideEvent | None:
        """Follow a press, and measure it at its end."""
        taxel = self.detector.push(state)
        if self.is_pressed:
            contact = max(state.contacts, key=lambda each: each.force)
            self.pressing.add(contact, state)
            return None
        ended, self.pressing = self.pressing, PressScans()
        if taxel is None:
            return None
        text = self.describe_refusal(ended, taxel)
        if text:
            return GuideEvent("refused", text, taxel)
        patch = int(self.skin.patch_index[taxel])
        force = self.get_force(patch)
        self.presses.append(ended.build_press(self.assumed, patch, force))
        if self.request is None:
            self.phase = "done"
        return GuideEvent("pressed", taxel=taxel)

    def describe_refusal(self, scans: "PressScans", taxel: int) -> str:
        """Describe why a press cannot be used; empty if it can."""
        if scans.measure_area(self.skin) > MAX_TIP_AREA:
            return "that was wider than one fingertip"
        if scans.measure_travel() > MAX_TIP_TRAVEL:
            return "the finger moved"
        if self.has_fault(taxel):
            return "a taxel beside it is faulty"
        return ""

    def has_fault(self, taxel: int) -> bool:
        """Tell whether a taxel or one of its neighbours is faulty."""
        mask = self.ignored | self.pipeline.faults.mask
        starts = self.adjacency.starts
        near = self.adjacency.neighbours[starts[taxel] : starts[taxel + 1]]
        return bool(mask[taxel] or mask[near].any())

    def count_presses(self, patch: int) -> int:
        """Return the number of presses of a patch so far."""
        return sum(press.patch == patch for press in self.presses)

    @property
    def progress(self) -> float:
        """Share of the time at rest, or of the presses asked for, that is done."""
        if self.phase == "rest":
            return min(self.record.seconds / self.config.seconds, 1.0)
        most = self.config.presses
        done = [
            most if patch in self.skipped else min(self.count_presses(patch), most)
            for patch in self.wanted
        ]
        return sum(done) / (most * len(done)) if most and done else 1.0

    def get_force(self, patch: int) -> float | None:
        """Return the force of the next press of a patch [N]; None if not known."""
        forces = self.config.forces
        return forces[self.count_presses(patch) % len(forces)] if forces else None

    @property
    def request(self) -> PressRequest | None:
        """Return where to press next; None where no press is missing."""
        for patch in self.wanted:
            count = self.count_presses(patch)
            if patch not in self.skipped and count < self.config.presses:
                place = PLACES[count % len(PLACES)]
                taxel = self.find_place(patch, place)
                return PressRequest(patch, taxel, self.get_force(patch))
        return None

    def find_place(self, patch: int, place: tuple[float, float]) -> int:
        """Return the taxel nearest to a place that has no fault beside it."""
        taxel = find_nearest_taxel(self.skin, self.skin.patches[patch].id, place)
        members = np.flatnonzero(self.skin.patch_index == patch)
        away = self.skin.positions[members] - self.skin.positions[taxel]
        order = members[np.argsort(np.linalg.norm(away, axis=1), kind="stable")]
        return next((int(i) for i in order if not self.has_fault(int(i))), taxel)

    def skip(self) -> None:
        """Ask for no more presses of a patch, and ignore a press that goes on."""
        self.detector.drop()
        if self.request is not None:
            self.skipped.add(self.request.patch)
        if self.request is None:
            self.phase = "done"

    def withdraw(self) -> None:
        """Forget the last press; the patch on which it was felt needs another.

        That patch is asked for also where it was left out. A press that goes on is
        ignored.
        """
        self.detector.drop()
        self.skipped.discard(self.presses.pop().patch)

    def finish(self) -> CalibrationResult:
        """Return the calibration from all that was measured.

        Raises:
            ValueError: rest was not measured.
        """
        if self.rest is None:
            raise ValueError(
                f"the skin was not at rest for {self.config.seconds:g} s; allowed is "
                "that time without touch; take all hands off and calibrate again"
            )
        known = self.assumed.source
        calibration = replace(
            self.assumed,
            source="rest" if known == "nominal" else known,
            noise=np.round(self.rest.noise, 3),
            rest=np.round(self.rest.rest, 2),
        )
        gains = None
        if self.presses:
            presses, prior = tuple(self.presses), self.config.prior
            gains = estimate_gains(self.skin, self.assumed, presses, prior)
            calibration = gains.apply(calibration, self.skin)
        return CalibrationResult(
            calibration,
            self.rest,
            self.faults.faults,
            self.faults.code.copy(),
            tuple(self.presses),
            gains,
        )


def find_patches(skin: Skin, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return the indices of patches, of all where none is named.

    Raises:
        ValueError: the skin has no patch of a name.
    """
    known = [patch.id for patch in skin.patches]
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ValueError(
            f"no patch '{unknown[0]}'; allowed are {', '.join(known)}; name some of "
            "them"
        )
    return tuple(n for n, name in enumerate(known) if not names or name in names)
