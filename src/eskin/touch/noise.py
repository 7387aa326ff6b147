"""This module measures what may be noise of each taxel, fast and slow."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.touch.calibration import MAX_CONTACT, Calibration
from eskin.touch.fault_kernels import START_SECONDS, CountHistory

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
MIN_NOISE, MIN_NOISE_CONTACTS = (2.0, 4.0), 2.0
"""Limits of the smallest difference from rest that may be noise [counts], and what it
is between them, in units of the counts at which contact begins: converters round, and
coarse ones would feel no light touch."""
SIGMA_DEVIATION = 1.65
"""Median deviation of white noise from a straight course, in units of its standard
deviation: that of the second difference is the square root of 6, and its median is
0.674 of that."""
FLOOR_SIGMAS = 6.0
"""Signal that may be noise, in units of the standard deviation."""
SLOW_NOISE_SIGMAS = 4.0
"""The same of the slow noise of a taxel that wanders about its rest."""
SLOW_NOISE_MEDIAN = 0.6745
"""Median depth of such noise below rest, in units of its standard deviation."""
SLOW_NOISE_SHARE = 0.7
"""Smallest slow noise of a taxel, in units of the median of its patch: where rest was
learned too low, no noise is seen below it."""
MAX_REST_BAND = 4.0
"""Largest distance from rest that is left to noise, in units of the counts at which
contact begins: a patch that swings further feels no touch."""
MAX_SLOW_NOISE = 1.5
"""The same of slow noise: swings beyond it, as of mains hum, remain a fault."""


@final
class NoiseFloor:
    """A noise floor holds how far each taxel may be from its rest by noise alone.

    Attributes:
        counts: (taxel) counts above rest up to which they are noise.
        floor: (taxel) the same as pressure, larger while it is learned [kPa].
        rest_band: (taxel) counts from which a taxel is away from rest, for faults.
    """

    def __init__(
        self,
        calibration: Calibration,
        contact: Values,
        members: list[Int[np.ndarray, "_"]],
        history: CountHistory,
        start_floor: float,
    ) -> None:
        """Start with the calibrated noise, or with what is assumed without one.

        `contact` are the counts above rest at which contact begins, `members` the
        taxels of each patch, `start_floor` is the pressure that may be noise until it
        is known [kPa].
        """
        self.calibration = calibration
        self.contact = contact
        self.members = members
        self.history = history
        self.start_floor = start_floor
        if calibration.noise is not None:
            most = MAX_CONTACT * calibration.full_scale / FLOOR_SIGMAS
            history.start_noise[:] = SIGMA_DEVIATION * np.minimum(
                calibration.noise, most
            )
        self.counts = self.measure_noise(history.start_noise)
        self.rest_band = contact / 2.0
        self.floor = np.full(len(contact), start_floor)

    def measure_noise(self, deviation: Values) -> Values:
        """Return the counts above rest that may be noise of a `CountHistory.noise`."""
        least = np.clip(MIN_NOISE_CONTACTS * self.contact, *MIN_NOISE)
        return np.maximum(FLOOR_SIGMAS / SIGMA_DEVIATION * deviation, least)

    def measure_slow_noise(self, mask: Flags) -> Values:
        """Return the median depth below rest of each taxel [counts].

        It is at least a part of that of its patch, in units of the counts at which
        contact begins, where faulty taxels do not count.
        """
        slow_noise, contact = self.history.slow_noise, self.contact
        ratio, usual = slow_noise / contact, np.zeros(len(self.contact))
        for members in self.members:
            used = members[~mask[members]]
            if len(used):
                middle = len(used) // 2
                usual[members] = np.partition(ratio[used], middle)[middle]
        return np.maximum(slow_noise, SLOW_NOISE_SHARE * usual * contact)

    def update(self, mask: Flags, now: float) -> None:
        """Update what may be noise by the history, without faulty taxels, at a time."""
        fast = self.measure_noise(self.history.noise)
        slow = SLOW_NOISE_SIGMAS / SLOW_NOISE_MEDIAN * self.measure_slow_noise(mask)
        self.counts = np.maximum(fast, slow)
        floor = self.calibration.compute_pressure(self.counts)
        contact = self.contact
        rest_band = np.maximum(fast, np.minimum(slow, MAX_SLOW_NOISE * contact))
        self.rest_band = np.clip(rest_band, contact / 2.0, MAX_REST_BAND * contact)
        starts = now - self.history.first_received < START_SECONDS
        learns = starts & (self.history.start_noise == 0.0)
        least = np.maximum(floor, self.start_floor)
        self.floor = np.where(learns, least, floor)
