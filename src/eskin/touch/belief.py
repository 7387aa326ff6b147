"""This module holds what is believed of each taxel: its noise, and its faults."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.belief_kernels import (
    BELIEF,
    EVEN_SIZE,
    EVEN_SPREAD,
    MIN_LEARNED,
    MIN_NOISE,
    MIN_NOISE_CONTACTS,
    NEVER,
    NOISE_SIGMAS,
    START_FLOOR,
    SWING,
    BeliefContext,
    CountScan,
    NoiseLimits,
    find_swings,
    judge_noise,
    reset_belief,
    spread_line_faults,
    update_belief,
)
from eskin.touch.calibration import MAX_CONTACT, Calibration

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]


@final
class Belief:
    """A belief holds how far each taxel may be from rest by noise, and what is faulty.

    Attributes:
        taxels: (taxel) `BELIEF`.
        limits: what may be noise, and which taxels are faulty.
        last_doubted: (taxel) time at which a taxel was last doubtful [s].
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        contact: Values,
        patches: TaxelGroups,
        lines: tuple[TaxelGroups, TaxelGroups],
    ) -> None:
        """Start with the calibrated noise, or with what is assumed without one.

        `contact` are the counts above rest at which contact begins; `patches` and
        `lines`, its rows and columns, group the taxels.
        """
        self.adjacency = Adjacency.build(skin)
        self.full_scale, self.contact = float(calibration.full_scale), contact
        self.patches, self.lines = patches, lines
        self.taxels = np.zeros(len(contact), BELIEF)
        if calibration.noise is not None:
            most = MAX_CONTACT * self.full_scale / NOISE_SIGMAS
            self.taxels["start_noise"] = np.minimum(calibration.noise, most)
        for i in range(len(contact)):
            reset_belief(i, self.taxels)
        least = np.clip(MIN_NOISE_CONTACTS * contact, *MIN_NOISE)
        self.limits = NoiseLimits(
            counts=np.maximum(NOISE_SIGMAS * self.taxels["noise"], least),
            band=contact / 2.0,
            floor=np.full(len(contact), START_FLOOR),
            noisy=np.zeros(len(contact), np.bool_),
            lifted=np.zeros(len(contact), np.bool_),
        )
        self.swings = np.zeros(len(patches.sizes), SWING)
        self.last_doubted = np.full(len(contact), NEVER)
        self.context = BeliefContext(
            contact,
            least,
            np.asarray(calibration.gain, np.float64),
            calibration.pressure_curve,
            self.adjacency,
            patches,
            *lines,
            self.taxels,
            self.swings,
            self.last_doubted,
        )

    def push(self, scan: CountScan, refused: Flags | None) -> None:
        """Take in a scan; `refused` taxels may swing with their patch."""
        low_count = update_belief(
            scan, self.contact, self.full_scale, self.adjacency, self.taxels
        )
        swings = low_count or self.swings["sign"].any() or refused is not None
        if swings and scan.now >= MIN_LEARNED:
            heard = scan.received if refused is None else scan.received | refused
            find_swings(scan, heard, self.context)

    def doubt_even_lines(self, scan: CountScan) -> None:
        """Doubt rows and columns that are pressed evenly from end to end.

        That is where all taxels of one are about as far above rest.
        """
        above = scan.counts - scan.rest
        high = scan.received & (above > self.limits.band)
        if np.count_nonzero(high) < EVEN_SIZE:
            return
        for lines in self.lines:
            even = (lines.flagged_share(high) == 1.0) & (lines.sizes >= EVEN_SIZE)
            if even.any():
                means, squares = (
                    np.bincount(lines.group_index, values) / lines.sizes
                    for values in (above, above**2)
                )
                even &= squares <= (1.0 + EVEN_SPREAD**2) * means**2
                self.last_doubted[even[lines.group_index]] = scan.now

    def check(self, scan: CountScan) -> None:
        """Update what may be noise, and which taxels are faulty."""
        self.doubt_even_lines(scan)
        self.limits = NoiseLimits(*map(np.empty_like, self.limits))
        judge_noise(scan, self.context, self.limits)

    def spread_lines(self, scan: CountScan, faulty: Flags) -> Flags:
        """Return taxels that are faulty, or on a row or column that is in part.

        Those of such a line that a hand presses with what lies beside it are doubtful.
        """
        result = faulty.copy()
        for lines in self.lines:
            spread_line_faults(scan, faulty, lines, self.context, result)
        return result
