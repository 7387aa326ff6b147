"""This module computes what taxels show of the press of a fingertip.

A fingertip presses with the pressure of an inverted paraboloid (Pawluk and Howe 1999)
on an area that grows with a power of its force. What taxels of a trial calibration show
of it is read with the calibration that was assumed. Where a fingertip presses less than
closes the layers of the sensor, taxels show nothing; the smaller the force, and the
larger the taxels, the more is lost.
"""

from typing import final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri
from scipy.stats.qmc import Sobol

from eskin.touch import Calibration, ContactConfig

AREA_AT_1_N = 90e-6
"""Contact area of a fingertip on a flat at 1 N [m2]."""
AREA_EXPONENT = 0.42
"""Growth of this area with force."""
AREA_DEVIATION = 0.25
"""Standard deviation of its natural logarithm between people and fingers."""
SENSING_SHARE = 0.65
"""Share of the area of a taxel, in its middle, that senses."""
FILM = (0.5e-3, 3e-3)
"""Least and largest standard deviation of the spread of pressure by a film [m]."""
FORCES = np.geomspace(0.3, 40.0, 12)
"""Forces that are computed [N]."""
DRAWS = 256
"""Number of places and sizes of the fingertip that are drawn for each: a power of 2."""
RADIUS = 0.014
"""Distance from the middle of a fingertip within which taxels are computed [m]."""
MAX_REACH = 8
"""Largest number of taxels on each side of the middle one."""
POINTS = 4
"""Number of points along each side of a taxel at which pressure is averaged."""
MIN_FORCE = 0.1
"""Force that is taken for shown where less is [N]; such presses are not noticed."""
PA_PER_KPA = 1000.0


@final
class FingertipResponse:
    """A response tells what taxels of one size show of a fingertip by its force.

    Places, sizes and gains of single taxels are drawn once, so that it is a smooth
    function of the constants.
    """

    def __init__(
        self, area: float, calibration: Calibration, gain: float, scatter: float
    ) -> None:
        """Draw the presses.

        Args:
            area: area of one taxel, taken as square [m2].
            calibration: calibration that is assumed.
            gain: gain that is assumed [kPa/count].
            scatter: standard deviation of ln gain of a taxel in its patch.
        """
        rng = np.random.default_rng(0)
        pitch = float(np.sqrt(area))
        # Evenly spread points, so that means over few draws are precise.
        even = Sobol(4, rng=0).random(DRAWS)
        offset = (even[:, :2] - 0.5) * pitch
        scale = np.exp(AREA_DEVIATION * ndtri(even[:, 2]))
        film = FILM[0] + (FILM[1] - FILM[0]) * even[:, 3]
        film = film / (np.sqrt(2.0 * np.pi) * pitch)
        film = np.minimum(film, 0.2)
        fields = []
        for force in FORCES:
            size = AREA_AT_1_N * force**AREA_EXPONENT * scale
            pressed = press_taxels(float(force), size, offset, pitch)
            fields.append(spread_pressure(pressed, film).reshape(DRAWS, -1))
        self.pressure = np.stack(fields)
        single = rng.standard_normal(self.pressure.shape[1:])
        self.half_scale = gain * calibration.full_scale * np.exp(scatter * single)
        self.read_scale = gain * calibration.full_scale
        self.calibration = calibration
        self.area = area
        self.cache: dict[tuple[float, ...], tuple[np.ndarray, np.ndarray]] = {}

    def compute(
        self, ln_gain: float, exponent: float, unfelt: float
    ) -> tuple[Float[np.ndarray, "force"], Float[np.ndarray, "force"]]:
        """Return mean and variance of ln(force shown / N) at each of `FORCES`.

        Args:
            ln_gain: ln of the gain over the one that is assumed.
            exponent: exponent of the curve.
            unfelt: activation pressure [kPa].
        """
        key = ln_gain, exponent, unfelt
        if key in self.cache:
            return self.cache[key]
        felt = np.maximum(self.pressure - unfelt, 0.0)
        power = exponent / self.calibration.exponent
        share = felt / (self.half_scale * np.exp(ln_gain))
        read = self.read_scale * (share if power == 1.0 else share**power)
        shown = read + np.minimum(read, self.calibration.unfelt)
        shown[shown < ContactConfig().off] = 0.0
        total = PA_PER_KPA * self.area * shown.sum(axis=2)
        logs = np.log(np.maximum(total, MIN_FORCE))
        self.cache[key] = logs.mean(axis=1), logs.var(axis=1)
        return self.cache[key]


def press_taxels(
    force: float,
    size: Float[np.ndarray, "draw"],
    offset: Float[np.ndarray, "draw 2"],
    pitch: float,
) -> Float[np.ndarray, "draw side side"]:
    """Compute the mean pressure over the sensing part of taxels in a square [kPa].

    Args:
        force: force of the fingertip [N].
        size: area of its contact [m2].
        offset: its centre, from the centre of the middle taxel [m].
        pitch: distance of the taxels [m].
    """
    reach = min(int(np.ceil(RADIUS / pitch)), MAX_REACH)
    centres = pitch * np.arange(-reach, reach + 1)
    side = pitch * np.sqrt(SENSING_SHARE)
    inside = side * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)
    lines = (centres[:, None] + inside).ravel()
    x, y = ((lines - offset[:, k, None]) ** 2 for k in (0, 1))
    radius = size / np.pi
    shape = 1.0 - (x[:, :, None] + y[:, None, :]) / radius[:, None, None]
    peak = 2.0 * force / size / PA_PER_KPA
    pressure = peak[:, None, None] * np.maximum(shape, 0.0)
    count = len(centres)
    grid = pressure.reshape(len(size), count, POINTS, count, POINTS)
    return grid.mean(axis=(2, 4))


def spread_pressure(
    pressure: Float[np.ndarray, "draw side side"], share: Float[np.ndarray, "draw"]
) -> Float[np.ndarray, "draw side side"]:
    """Give a share of the pressure of each taxel to each of its four neighbours."""
    share = share[:, None, None]
    result = (1.0 - 4.0 * share) * pressure
    result[:, 1:] += share * pressure[:, :-1]
    result[:, :-1] += share * pressure[:, 1:]
    result[:, :, 1:] += share * pressure[:, :, :-1]
    result[:, :, :-1] += share * pressure[:, :, 1:]
    return result
