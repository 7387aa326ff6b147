"""This module monitors whether the skin can be relied on."""

import logging
from collections.abc import Iterable
from dataclasses import InitVar, dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.reasons import Problem
from eskin.reasons import Reason
from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.units import NS_PER_S

IN_CONTACT = 0.2
"""Time before a patch went out in which a contact on it is one that was lost [s]."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SkinMonitorConfig:
    """Limits beyond which the arm is slowed, paused or held because of its skin."""

    max_age: float = 0.1
    """Age from which a reading or a touch is stale [s]."""

    max_silence: float = 0.11
    """Age of a patch's newest data from which the patch is out [s]: at 50 readings a
    second, three may be lost in a row."""

    min_valid: float = 0.25
    """Share of a patch's taxels that must be valid; with fewer it sends no data."""

    max_out_share: float = 0.25
    """Share of the skin's taxels that may be on patches that are out; with more the
    arm is held at once."""

    max_out_seconds: float = 0.5
    """Age of a patch's newest data from which the arm is held, where a hand on the
    patch could be missed [s]; before, it is slowed, or suspended if one was on it."""

    hand: float = 0.04
    """Distance from a working taxel up to which a hand is felt [m]; half the width of
    a palm."""

    clear_seconds: float = 2.0
    """Time without a reason after which the arm is no longer slowed [s]."""

    max_force: float = 40.0
    """Measured force of a touch above which a moving arm is held [N]."""

    max_growth: float = 2.5
    """Growth of the measured force of a touch since its detection above which such an
    arm is held, or of the area that it presses nearly to full scale, where more force
    is not measured; as a ratio."""

    least_force: float = 12.0
    """Least force that its growth is related to [N]."""

    least_full_area: float = 0.6e-4
    """Least area at full scale that its growth is related to [m2]."""

    pause_seconds: float = 5.0
    """Duration of a touch above which a moving arm is paused [s]."""

    light_force: float = 2.0
    """Measured force up to which a touch is light [N]."""

    light_seconds: float = 10.0
    """Time for which a touch is light without interruption after which it slows the
    arm instead of suspending and pausing it [s]."""

    max_seconds: InitVar[float | None] = None

    def __post_init__(self, max_seconds: float | None) -> None:
        """Tell that a limit says nothing any more."""
        if max_seconds is not None:
            logger.warning(
                "SkinMonitorConfig: max_seconds: got %g, which says nothing any more, "
                "since every touch suspends the arm; take it out",
                max_seconds,
            )


@final
class SkinMonitor:
    """A skin monitor keeps the age of readings and of the data of each patch.

    Attributes:
        latest: stamp of the latest reading [ns since the epoch].
        is_finite: whether all probabilities of that reading are finite.
        last_valid: stamp of the latest reading with data of each patch [ns].
        last_touched: stamp of the latest contact on each patch [ns]; 0 before one.
    """

    def __init__(self, skin: Skin, config: SkinMonitorConfig, now: int) -> None:
        """Start with a working skin, read at a time [ns since the epoch]."""
        self.config = config
        self.patches = tuple(patch.id for patch in skin.patches)
        self.links = np.array([patch.link for patch in skin.patches])
        self.patch_index = np.asarray(skin.patch_index)
        self.positions = np.asarray(skin.positions)
        self.sizes = np.bincount(self.patch_index, minlength=len(self.patches))
        self.least_valid = np.maximum(1, np.ceil(config.min_valid * self.sizes))
        self.latest = now
        self.is_finite = True
        self.is_turned = False
        self.last_valid = np.full(len(self.patches), now, np.int64)
        self.last_touched = np.zeros(len(self.patches), np.int64)
        self.reach: dict[tuple[int, ...], np.ndarray] = {}

    def update(self, recognition: RecognitionState, touched: Iterable[str]) -> None:
        """Update from the next reading, and the patches that are touched in it."""
        state = recognition.state
        chances = recognition.probabilities
        self.is_finite = all(np.isfinite(each).all() for each in chances.values())
        self.latest = stamp = state.reading.stamp
        valid = np.bincount(
            self.patch_index[state.reading.valid], minlength=len(self.patches)
        )
        has_data = valid >= self.least_valid
        faulty = [fault.patch for fault in state.faults if fault.kind == "patch"]
        kinds = [fault.kind for fault in state.faults]
        self.is_turned = "falling" in kinds or "rising" in kinds
        if faulty:
            has_data &= ~np.isin(self.patches, faulty)
        self.last_valid[has_data] = stamp
        for patch in touched:
            self.last_touched[self.patches.index(patch)] = stamp

    def has_data(self, patch: str) -> bool:
        """Return whether the latest reading has data of a patch."""
        return bool(self.last_valid[self.patches.index(patch)] == self.latest)

    def is_out(self, patch: str, now: int) -> bool:
        """Return whether a patch is out at a time [ns since the epoch]."""
        return self.patches.index(patch) in self.find_out(now)

    def find_out(self, now: int) -> tuple[int, ...]:
        """Return the indices of patches that are out: without data for too long."""
        oldest = now - round(self.config.max_silence * NS_PER_S)
        return tuple(np.flatnonzero(self.last_valid < oldest).tolist())

    def find_problem(self, now: int, is_busy: bool = False) -> Reason | None:
        """Return why the arm is held at a time, or None where it is not.

        The skin is stale, or feels nothing; or a probability is not finite; or patches
        are out that are a large share of it; or one is out for too long that a hand was
        on, or on which a hand could be missed. Where the computer is busy, it does not
        say that the skin is stale.
        """
        age = (now - self.latest) / NS_PER_S
        if age > self.config.max_age:
            problem = Problem.BUSY_COMPUTER if is_busy else Problem.STALE_SKIN
            return problem.reason(milliseconds=1e3 * age)
        if not self.is_finite:
            return Problem.BROKEN_MODEL.reason()
        if self.is_turned:
            return Problem.DEAF_SKIN.reason()
        out = self.find_out(now)
        if not out:
            return None
        share = self.sizes[list(out)].sum() / self.sizes.sum()
        if share > self.config.max_out_share:
            return Problem.BROKEN_SKIN.reason(patches=self.name(out), share=share)
        for index in out:
            silence = (now - self.last_valid[index]) / NS_PER_S
            if silence > self.config.max_out_seconds and (
                self.was_in_contact(index) or self.coverage_gap(index, out)
            ):
                return Problem.BROKEN_PATCH.reason(patches=self.name((index,)))
        return None

    def lost_in_contact(self, now: int) -> bool:
        """Return whether a patch is out that was touched when it went out."""
        return any(map(self.was_in_contact, self.find_out(now)))

    def find_outage(self, now: int) -> Reason | None:
        """Return which patches are out at a time, or None where none is."""
        out = self.find_out(now)
        if not out:
            return None
        return Problem.BROKEN_PATCH.reason(patches=self.name(out))

    def name(self, out: tuple[int, ...]) -> str:
        """Return the names of patches that are out, with a verb."""
        names = ", ".join(f"'{self.patches[index]}'" for index in out)
        return f"patch {names} is" if len(out) == 1 else f"patches {names} are"

    def was_in_contact(self, index: int) -> bool:
        """Return whether a patch was touched when it went out."""
        limit = self.last_valid[index] - round(IN_CONTACT * NS_PER_S)
        return bool(self.last_touched[index] >= max(limit, 1))

    def coverage_gap(self, index: int, out: tuple[int, ...]) -> bool:
        """Return whether a hand on a patch could be felt by no working taxel.

        Args:
            index: the patch.
            out: all patches that are out.
        """
        if out not in self.reach:
            self.reach = {out: self.compute_reach(out)}
        return bool(self.reach[out][index] > self.config.hand)

    def compute_reach(self, out: tuple[int, ...]) -> Float[np.ndarray, "patch"]:
        """Compute how far taxels of each patch that is out are from working ones [m].

        It is the largest distance of a taxel to the nearest working one of its link.
        """
        reach = np.zeros(len(self.patches))
        broken = np.isin(self.patch_index, out)
        for index in out:
            beside = (self.links == self.links[index])[self.patch_index] & ~broken
            if not beside.any():
                reach[index] = np.inf
                continue
            ours = self.positions[self.patch_index == index]
            others = beside
            gaps = ours[:, None] - self.positions[others][None]
            reach[index] = np.linalg.norm(gaps, axis=2).min(axis=1).max()
        return reach
