"""This module holds what is believed of each taxel: its noise, and its faults."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.belief_kernels import (
    BELIEF,
    MOST_ODDS,
    NEVER,
    ODDS_SECONDS,
    START_SECONDS,
    CountScan,
    reset_belief,
    update_belief,
)
from eskin.touch.calibration import MAX_CONTACT, Calibration

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
MIN_NOISE, MIN_NOISE_CONTACTS = (2.0, 4.0), 2.0
"""Limits of the smallest difference from rest that may be noise [counts], and what it
is between them, in units of the counts at which contact begins: converters round, and
coarse ones would feel no light touch."""
NOISE_SIGMAS, WANDER_SIGMAS = 6.0, 5.0
"""Signal that may be noise, in standard deviations of the noise from scan to scan, and
of wandering about rest."""
WANDER_SHARE = 0.7
"""Smallest wandering of a taxel, in units of the median of its patch: where rest was
learned too low, none is seen below it."""
MAX_BAND, MAX_WANDER_BAND = 4.0, 1.5
"""Largest distance from rest that is left to noise, and to wandering, in units of the
counts at which contact begins: a patch that swings further feels no touch."""
MIN_LEARNED = 0.3
"""Time from which the noise is known well enough to tell what is away from rest [s]."""
LEARN_SCANS = 40
"""Number of scans from which noise is known well enough for a fault."""
MIN_MIXED = 3
"""Number of taxels of a row or column that are away from rest, where some are above and
some below it, from which it is doubtful: beside a pressed taxel, one that was released
may be below rest for a while."""


@dataclass(frozen=True)
class BeliefConfig:
    """Thresholds say from what noise or evidence on a taxel is not believed."""

    start_floor: float = 7.0
    """Pressure that may be noise while the noise is neither calibrated nor learned yet
    [kPa]."""
    noisy: float = 0.55
    """Noise that makes a taxel a fault, in units of the counts at which contact
    begins; and at least `noisy_counts`."""
    noisy_counts: float = 2.4
    """The same in counts: converters have a noise of one or two."""
    noisier: float = 2.5
    """Smallest ratio of the noise of such a taxel to the median of its patch."""
    hides: float = 0.025
    """Noise that is a fault also where all of the patch has it, in units of full scale;
    the noisiest sensor measured has 0.017."""
    faulty: float = 1.5
    """Evidence from which a taxel is a fault."""
    faulty_share: float = 0.34
    """Share of a row or column that is faulty from which all of it is: it is not
    connected, though some of its taxels show it at zero or full scale alone."""
    doubtful_noise: float = 0.5
    """Share of the noise of a fault from which a taxel is doubtful: it may stop an arm,
    and nothing else."""
    doubtful: float = 1.2
    """Evidence from which it is."""
    swing_share: float = 0.25
    """Share of a patch that is above rest by more than noise, and soon after below it,
    as no hand does."""
    line_share: float = 0.2
    """Share of a row or column above rest by more than noise, and another below it,
    that makes it doubtful: it is not connected."""
    line_size: int = 6
    """Number of taxels of a row or column from which it must not be pressed evenly."""
    line_spread: float = 0.2
    """Standard deviation of the counts above rest along a row or column, in units of
    their mean, below which it is pressed evenly, as by hum and by no hand."""


@final
class Belief:
    """A belief holds how far each taxel may be from rest by noise, and what is faulty.

    Attributes:
        counts: (taxel) counts above rest up to which they are noise.
        floor: (taxel) the same as pressure, larger while it is learned [kPa].
        band: (taxel) counts from which a taxel is away from rest, for faults.
        last_doubted: (taxel) time at which a taxel was last doubtful [s].
        taxels: (taxel) `BELIEF`.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        contact: Values,
        patches: TaxelGroups,
        lines: tuple[TaxelGroups, ...],
        config: BeliefConfig,
    ) -> None:
        """Start with the calibrated noise, or with what is assumed without one.

        `contact` are the counts above rest at which contact begins; `patches` and
        `lines` group the taxels.
        """
        self.adjacency = Adjacency.build(skin)
        self.calibration, self.contact, self.config = calibration, contact, config
        self.patches, self.lines = patches, lines
        index = patches.group_index
        self.members = [np.flatnonzero(index == n) for n in range(len(patches.sizes))]
        self.taxels = np.zeros(len(contact), BELIEF)
        if calibration.noise is not None:
            most = MAX_CONTACT * calibration.full_scale / NOISE_SIGMAS
            self.taxels["start_noise"] = np.minimum(calibration.noise, most)
        for i in range(len(contact)):
            reset_belief(i, self.taxels)
        self.limit = np.maximum(config.noisy * contact, config.noisy_counts)
        self.counts = self.measure_noise()
        self.band = contact / 2.0
        self.floor = np.full(len(contact), config.start_floor)
        self.sign = np.zeros(len(patches.sizes), np.int64)
        self.turned_at = np.full(len(patches.sizes), NEVER)
        self.last_doubted = np.full(len(contact), NEVER)

    def measure_noise(self) -> Values:
        """Return the counts above rest that may be noise from scan to scan."""
        least = np.clip(MIN_NOISE_CONTACTS * self.contact, *MIN_NOISE)
        return np.maximum(NOISE_SIGMAS * self.taxels["noise"], least)

    def push(self, scan: CountScan, refused: Flags | None) -> None:
        """Take in a scan; `refused` taxels may swing with their patch."""
        full, belief = self.calibration.full_scale, self.taxels
        low_count = update_belief(scan, self.contact, full, self.adjacency, belief)
        swings = low_count or self.sign.any() or refused is not None
        if swings and scan.now >= MIN_LEARNED:
            received = scan.received if refused is None else scan.received | refused
            above = scan.counts - scan.rest
            high, low = above > self.band, above < -self.band
            self.follow_swings(received & high, received & low, scan.now)
            self.doubt_mixed_lines(scan.received & high, scan.received & low, scan.now)

    def follow_swings(self, high: Flags, low: Flags, now: float) -> None:
        """Take turns of whole patches about rest, as of mains hum, for evidence."""
        share, patches = self.config.swing_share, self.patches
        sign = np.where(patches.flagged_share(high) >= share, 1, 0)
        sign = np.where(patches.flagged_share(low) >= share, -1, sign)
        turned = (sign != 0) & (sign != self.sign)
        for n in np.flatnonzero(turned & (self.sign != 0)):
            odds = self.taxels["odds"][self.members[n]] + 1.0
            self.taxels["odds"][self.members[n]] = np.minimum(odds, MOST_ODDS)
        self.sign = np.where(turned, sign, self.sign)
        self.turned_at[turned] = now
        self.sign[now - self.turned_at > ODDS_SECONDS] = 0

    def doubt_mixed_lines(self, high: Flags, low: Flags, now: float) -> None:
        """Doubt rows and columns that are partly above rest and partly below it.

        So does a line that is not connected, of which at least `MIN_MIXED` taxels are
        away from rest; a hand presses, and presses nothing below rest.
        """
        for lines in self.lines:
            mixed = lines.flagged_count(high | low) >= MIN_MIXED
            for flags in (high, low):
                mixed &= lines.flagged_share(flags) >= self.config.line_share
            if mixed.any():
                self.last_doubted[mixed[lines.group_index]] = now

    def doubt_even_lines(self, scan: CountScan) -> None:
        """Doubt rows and columns that are pressed evenly from end to end.

        That is where all taxels of one are about as far above rest.
        """
        above, size = scan.counts - scan.rest, self.config.line_size
        high = scan.received & (above > self.band)
        if np.count_nonzero(high) < size:
            return
        for lines in self.lines:
            even = (lines.flagged_share(high) == 1.0) & (lines.sizes >= size)
            if even.any():
                means, squares = (
                    np.bincount(lines.group_index, values) / lines.sizes
                    for values in (above, above**2)
                )
                even &= squares <= (1.0 + self.config.line_spread**2) * means**2
                self.last_doubted[even[lines.group_index]] = scan.now

    def check(self, scan: CountScan) -> Flags:
        """Update what may be noise, and return the taxels that are faulty."""
        self.doubt_even_lines(scan)
        config, noise = self.config, self.taxels["noise"]
        odds, share = self.taxels["odds"], noise / self.limit
        usual_noise, usual_wander = self.find_usual()
        since = scan.now - scan.first_received
        seconds = max(START_SECONDS, LEARN_SCANS * scan.elapsed)
        known, guessed = since >= seconds, since >= seconds / 2.0
        faulty = (share >= 1.0) & (noise >= config.noisier * usual_noise)
        faulty |= noise >= config.hides * self.calibration.full_scale
        faulty = (odds >= config.faulty) | (known & faulty)
        restless = guessed & (share >= config.doubtful_noise)
        restless &= noise >= config.noisier * usual_noise
        self.last_doubted[faulty | restless | (odds >= config.doubtful)] = scan.now
        self.update_floors(scan, usual_wander)
        return faulty

    def find_usual(self) -> tuple[Values, Values]:
        """Find the medians of noise and wandering on the patch of each taxel.

        That of the noise is in counts, the other in units of the counts at which
        contact begins.
        """
        values = np.stack([self.taxels["noise"], self.taxels["wander"] / self.contact])
        usual = np.empty_like(values)
        for members in self.members:
            middle = len(members) // 2
            ranked = np.partition(values[:, members], middle, axis=1)
            usual[:, members] = ranked[:, middle, None]
        return usual[0], usual[1]

    def spread_lines(self, faulty: Flags) -> Flags:
        """Return taxels that are faulty, or on a row or column that is in part."""
        result = faulty.copy()
        for lines in self.lines:
            out = lines.flagged_share(faulty) >= self.config.faulty_share
            out &= lines.flagged_count(faulty) >= MIN_MIXED
            result |= out[lines.group_index]
        return result

    def update_floors(self, scan: CountScan, usual: Values) -> None:
        """Update what may be noise, by the usual wandering of each patch."""
        contact, fast = self.contact, self.measure_noise()
        ratio = np.maximum(self.taxels["wander"] / contact, WANDER_SHARE * usual)
        slow = WANDER_SIGMAS * ratio * contact
        self.counts = np.maximum(fast, slow)
        band = np.maximum(fast, np.minimum(slow, MAX_WANDER_BAND * contact))
        self.band = np.clip(band, contact / 2.0, MAX_BAND * contact)
        floor = self.calibration.compute_pressure(self.counts)
        learns = scan.now - scan.first_received < START_SECONDS
        learns &= self.taxels["start_noise"] == 0.0
        least = np.where(learns, self.config.start_floor, 0.0)
        self.floor = np.maximum(floor, least)

    def find_lifted(
        self, taxels: Int[np.ndarray, "some"], rest: Values
    ) -> Bool[np.ndarray, "some"]:
        """Tell which of some taxels have been below rest in the latest scans.

        A hand was on them when the skin was switched on, and has lifted: its pressure
        was taken for their rest, and its noise for theirs.
        """
        some = self.taxels[taxels]
        highest = np.fmax(np.fmax(some["first"], some["second"]), some["third"])
        return highest < rest[taxels] - self.band[taxels]
