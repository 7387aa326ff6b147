"""This module simulates faults of a skin that nobody touches, on the counts of scans.

Amplitudes are in counts of a converter of 1023 on which contact begins at 22 counts
above rest; they are scaled to the skin that is attacked.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.skin import Skin
from eskin.touch import Calibration, ContactConfig, Scan
from eskin.units import NS_PER_S

CONTACT_COUNTS = 22.0
"""Counts above rest at which contact begins, on the converter of the amplitudes."""
HUM = 100.0
"""Amplitude of mains hum [counts]."""
MAINS = 50.0
"""Mean frequency of the mains [Hz]."""
MAINS_DRIFT = 0.05
"""Standard deviation of that frequency from skin to skin [Hz]."""
FLOATING = 150.0
"""Standard deviation of a row that is not connected [counts]."""
SLOW_SECONDS = 0.5
"""Correlation time of a row that floats slowly [s]."""
TELEGRAPH = 100.0
"""Step of telegraph noise [counts]."""
TELEGRAPH_SECONDS = 2.0
"""Mean time between two steps of telegraph noise [s]."""
PALM = 0.06
"""Distance within which a hand could press all of some taxels at once [m]."""
RISE = 0.06
"""Time in which taxels that step together rise or fall [s]."""
SPIKE_CHANCE = 1e-4
"""Probability that a value is a spike."""


@dataclass(frozen=True)
class FaultTarget:
    """A target is the skin that a fault is simulated on."""

    skin: Skin
    """The skin."""
    unit: float
    """Counts of this skin for one count of the amplitudes."""
    full_scale: int
    """Counts at which its converter saturates."""
    rng: np.random.Generator
    """Random numbers of the fault."""


Disturbance = Callable[[float], Float[np.ndarray, "taxel"]]
"""Gives what a fault adds to the counts at a time [s]."""


def build_target(skin: Skin, calibration: Calibration, seed: int) -> FaultTarget:
    """Build the target of a fault on a skin."""
    contact = calibration.compute_counts(ContactConfig().on)
    unit = float(np.median(contact)) / CONTACT_COUNTS
    rng = np.random.default_rng((seed, 24))
    return FaultTarget(skin, unit, calibration.full_scale, rng)


def choose(target: FaultTarget, share: float) -> Int[np.ndarray, "chosen"]:
    """Choose a share of all taxels at random."""
    count = max(round(share * target.skin.count), 1)
    return target.rng.choice(target.skin.count, count, replace=False)


def add_noise(target: FaultTarget, share: float, sigma: float) -> Disturbance:
    """Return white noise of a standard deviation [counts] on a share of the taxels."""
    return add_white(target, choose(target, share), sigma)


def add_white(
    target: FaultTarget, taxels: Int[np.ndarray, "chosen"], sigma: float
) -> Disturbance:
    """Return white noise on some taxels."""
    noise = np.zeros(target.skin.count)

    def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
        noise[taxels] = target.rng.normal(0.0, sigma, len(taxels))
        return noise

    return disturb


def choose_row(target: FaultTarget) -> Int[np.ndarray, "chosen"]:
    """Choose the taxels of a row of at least five taxels."""
    skin = target.skin
    while True:
        taxel = int(target.rng.integers(skin.count))
        row = (skin.rows == skin.rows[taxel]) & (
            skin.patch_index == skin.patch_index[taxel]
        )
        if row.sum() >= 5:
            return np.flatnonzero(row)


def float_row(target: FaultTarget) -> Disturbance:
    """Return a row that is not connected and picks up white noise."""
    return add_white(target, choose_row(target), FLOATING)


def choose_rows(target: FaultTarget) -> Int[np.ndarray, "chosen"]:
    """Choose the taxels of two rows of at least five taxels, one after the other."""
    skin = target.skin
    while True:
        row = choose_row(target)
        patch = skin.patch_index == skin.patch_index[row[0]]
        after = np.flatnonzero(patch & (skin.rows == skin.rows[row[0]] + 1))
        if len(after) >= 5:
            return np.concatenate([row, after])


def wander(target: FaultTarget, taxels: Int[np.ndarray, "chosen"]) -> Disturbance:
    """Return taxels that are not connected and wander."""
    rng = target.rng
    state = rng.normal(0.0, FLOATING, len(taxels))
    noise = np.zeros(target.skin.count)
    last = 0.0

    def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
        nonlocal state, last
        keep = np.exp(-(seconds - last) / SLOW_SECONDS)
        last = seconds
        fresh = rng.normal(0.0, FLOATING, len(taxels))
        state = keep * state + np.sqrt(1 - keep**2) * fresh
        noise[taxels] = state
        return noise

    return disturb


def hum(target: FaultTarget, by_rows: bool = False) -> Disturbance:
    """Return mains hum on one patch, which beats with the rate of the scans.

    Args:
        target: skin that is attacked.
        by_rows: whether the rows of the patch are read one after the other.
    """
    patch = int(target.rng.integers(len(target.skin.patches)))
    share = (target.skin.patch_index == patch).astype(float)
    frequency = target.rng.normal(MAINS, MAINS_DRIFT)
    if by_rows:
        rows = np.asarray(target.skin.rows, float)
        delay = rows / (rows[share > 0].max() + 1.0) / MAINS
    else:
        delay = target.rng.uniform(0.0, 1.0) / frequency

    def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
        return HUM * np.sin(2 * np.pi * frequency * (seconds + delay)) * share

    return disturb


def add_spikes(target: FaultTarget) -> Disturbance:
    """Return spikes of one scan, of any size up to full scale, anywhere."""
    top = target.full_scale / target.unit

    def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
        hit = target.rng.random(target.skin.count) < SPIKE_CHANCE
        return hit * target.rng.uniform(CONTACT_COUNTS, top)

    return disturb


def choose_within_palm(target: FaultTarget) -> Int[np.ndarray, "chosen"]:
    """Choose four taxels that a hand could press at once."""
    skin = target.skin
    middle = int(target.rng.integers(skin.count))
    distances = np.linalg.norm(skin.positions - skin.positions[middle], axis=1)
    near = (distances < PALM) & (skin.patch_index == skin.patch_index[middle])
    return target.rng.choice(np.flatnonzero(near), 4, replace=False)


def step(
    target: FaultTarget, taxels: Int[np.ndarray, "chosen"], in_step: bool = False
) -> Disturbance:
    """Return taxels that step up and down at random times.

    Args:
        target: skin that is attacked.
        taxels: the taxels.
        in_step: whether all step at the same times, and take `RISE` to do so.
    """
    rng = target.rng
    rise = RISE if in_step else 0.0
    count = 1 if in_step else len(taxels)
    high = rng.random(count) < 0.5
    noise = np.zeros(target.skin.count)
    last = 0.0

    def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
        nonlocal high, last
        elapsed = seconds - last
        chance = 1.0 - np.exp(-elapsed / TELEGRAPH_SECONDS)
        last = seconds
        high = high ^ (rng.random(count) < chance)
        change = TELEGRAPH * min(elapsed / rise, 1.0) if rise else TELEGRAPH
        noise[taxels] += np.clip(TELEGRAPH * high - noise[taxels], -change, change)
        return noise

    return disturb


FAULTS: dict[str, Callable[[FaultTarget], Disturbance]] = {
    "none": lambda target: lambda seconds: np.zeros(target.skin.count),
    "0.2 % noisy, sigma 7": lambda target: add_noise(target, 0.002, 7.0),
    "0.2 % noisy, sigma 9": lambda target: add_noise(target, 0.002, 9.0),
    "1 % noisy, sigma 5": lambda target: add_noise(target, 0.01, 5.0),
    "1 % noisy, sigma 9": lambda target: add_noise(target, 0.01, 9.0),
    "floating row": float_row,
    "floating row, slow": lambda target: wander(target, choose_row(target)),
    "two floating rows, slow": lambda target: wander(target, choose_rows(target)),
    "hum of a patch": hum,
    "hum of a patch, row by row": lambda target: hum(target, by_rows=True),
    "spikes, 1e-4 a value": add_spikes,
    "telegraph, 0.2 %": lambda target: step(target, choose(target, 0.002)),
    "telegraph in step, four taxels": lambda target: step(
        target, choose_within_palm(target), in_step=True
    ),
}
"""The faults that are simulated, by their names in tables."""


class FaultySkin:
    """A faulty skin disturbs the scans that pass through it."""

    def __init__(self, fault: str, target: FaultTarget) -> None:
        """Draw a fault of a kind of `FAULTS`."""
        self.target = target
        self.disturb = FAULTS[fault](target)
        self.first: int | None = None

    def corrupt(self, scan: Scan) -> Scan:
        """Return a scan with the fault."""
        self.first = scan.stamp if self.first is None else self.first
        added = self.disturb((scan.stamp - self.first) / NS_PER_S) * self.target.unit
        counts = np.round(scan.counts + added).astype(scan.counts.dtype)
        counts = np.clip(counts, 0, self.target.full_scale)
        return replace(scan, counts=np.where(scan.received, counts, scan.counts))
