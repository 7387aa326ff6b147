"""This module computes which part of a fingertip's force the taxels measure.

A fingertip presses with the pressure of an inverted paraboloid (Pawluk and Howe 1999)
on an area that grows with a power of its force. Where it presses less than closes the
layers of the sensor, taxels measure nothing; the smaller the force, and the larger the
taxels, the more is lost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
FORCES = np.geomspace(0.05, 100.0, 20)
"""Forces for which the response is tabulated [N]."""
ACTIVATIONS = np.geomspace(0.1, 20.0, 9)
"""Pressures that close the layers for which it is tabulated [kPa]."""
DRAWS = 96
"""Number of places and sizes of the fingertip that are drawn for each."""
REACH = 4
"""Number of taxels on each side of the middle one that are computed."""
POINTS = 4
"""Number of points along each side of a taxel at which pressure is averaged."""
LEAST_SHARE = 0.01
"""Share of the force that is taken for measured where nothing is."""
MIN_SLOPE = 0.3
"""Least growth of the measured force with the true one, both as logarithms."""
PA_PER_KPA = 1000.0


@dataclass(frozen=True, eq=False)
class FingertipResponse:
    """A response is the force that taxels of one size measure, over that applied."""

    mean: Float[np.ndarray, "activation force"]
    """Mean of ln(measured force / N) at each of `ACTIVATIONS` and `FORCES`."""
    deviation: Float[np.ndarray, "activation force"]
    """Standard deviation of it over places and fingers."""

    def at(
        self, unfelt: float
    ) -> tuple[Float[np.ndarray, "force"], Float[np.ndarray, "force"]]:
        """Return mean and deviation at an activation pressure [kPa]."""
        last = len(ACTIVATIONS) - 1
        ratio = np.log(max(unfelt, ACTIVATIONS[0]) / ACTIVATIONS[0])
        place = min(ratio / np.log(ACTIVATIONS[1] / ACTIVATIONS[0]), last)
        low = min(int(place), last - 1)
        part = place - low
        return (
            (1 - part) * self.mean[low] + part * self.mean[low + 1],
            (1 - part) * self.deviation[low] + part * self.deviation[low + 1],
        )

    def infer_force(self, measured: float, unfelt: float) -> tuple[float, float, float]:
        """Infer the force of a press from the force that was measured [N].

        Returns:
            ln of the true force; its standard deviation by place and finger; and the
            growth of ln measured force with ln true force.
        """
        mean, deviation = self.at(unfelt)
        forces, value = np.log(FORCES), np.log(measured)
        n = int(np.clip(np.searchsorted(mean, value), 1, len(forces) - 1))
        slope = (mean[n] - mean[n - 1]) / (forces[n] - forces[n - 1])
        slope = max(slope, MIN_SLOPE)
        force = forces[n] + (value - mean[n]) / slope
        return force, float(np.interp(force, forces, deviation)) / slope, slope


def tabulate_response(area: float, felt_from_zero: bool = False) -> FingertipResponse:
    """Tabulate the response of taxels of an area [m2].

    Args:
        area: area of one taxel, taken as square.
        felt_from_zero: whether the sensor has no activation pressure.
    """
    rng = np.random.default_rng(0)
    pitch = np.sqrt(area)
    offset = rng.uniform(-0.5, 0.5, (DRAWS, 2)) * pitch
    scale = np.exp(AREA_DEVIATION * rng.standard_normal(DRAWS))
    film = rng.uniform(*FILM, DRAWS) / (np.sqrt(2.0 * np.pi) * pitch)
    mean = np.empty((len(ACTIVATIONS), len(FORCES)))
    deviation = np.empty_like(mean)
    for n, force in enumerate(FORCES):
        size = AREA_AT_1_N * force**AREA_EXPONENT * scale
        pressure = spread_pressure(press_taxels(force, size, offset, pitch), film)
        for m, unfelt in enumerate(ACTIVATIONS):
            felt = np.maximum(pressure - unfelt * (not felt_from_zero), 0.0)
            shown = felt + np.minimum(felt, unfelt) * (not felt_from_zero)
            total = PA_PER_KPA * area * shown.sum(axis=(1, 2))
            logs = np.log(np.maximum(total, LEAST_SHARE * force))
            mean[m, n], deviation[m, n] = logs.mean(), logs.std()
    return FingertipResponse(np.maximum.accumulate(mean, axis=1), deviation)


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
        offset: its centre from that of the middle taxel [m].
        pitch: distance of the taxels [m].
    """
    centres = pitch * np.arange(-REACH, REACH + 1)
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
