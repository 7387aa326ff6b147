"""Shapes of force and of motion through time."""

import numpy as np
from jaxtyping import Float

Series = Float[np.ndarray, "time"]


def steps_of(duration: float, step: float) -> int:
    """Length of a series that lasts so long, both ends counted; at least three."""
    return max(3, round(duration / step) + 1)


def bell(steps: int, exponent: float) -> Series:
    """Up and down, sin(pi x) to a power, largest value 1."""
    shape = np.sin(np.linspace(0, np.pi, steps)) ** exponent
    return pinned(shape / shape.max())


def trapezoid(steps: int, rise: float, fall: float, smooth: int) -> Series:
    """Up, hold, down, largest value 1.

    Args:
        steps: length.
        rise: share of the length in which it rises.
        fall: share in which it falls.
        smooth: steps to either side over which corners are rounded.
    """
    x = np.linspace(0, 1, steps)
    shape = np.interp(x, [0, rise, max(rise, 1 - fall), 1], [0.0, 1.0, 1.0, 0.0])
    kernel = np.hanning(2 * smooth + 3)[1:-1]
    if len(kernel) > steps:
        return pinned(shape / shape.max())
    shape = pinned(np.convolve(shape, kernel / kernel.sum(), mode="same"))
    return shape / shape.max()


def pinned(shape: Series) -> Series:
    """The same with both ends exactly zero."""
    shape = np.clip(shape, 0.0, None)
    shape[[0, -1]] = 0.0
    return shape


def peaked(shape: Series, force: float) -> Series:
    """The same shape with a largest value of `force`."""
    return shape * (force / shape.max())


def minimum_jerk(steps: int) -> Series:
    """Smoothest way from 0 to 1 (Flash and Hogan 1985)."""
    x = np.linspace(0, 1, steps)
    return x**3 * (10 - 15 * x + 6 * x**2)


def wander(
    steps: int,
    step: float,
    band: tuple[float, float],
    tones: int,
    rng: np.random.Generator,
) -> Series:
    """Slow noise with mean square 1: equal power in each octave, as 1/f.

    Args:
        steps: length.
        step: time between two values [s].
        band: lowest and highest frequency [Hz].
        tones: number of sines.
        rng: to draw phases from.
    """
    rates = np.geomspace(*band, tones)
    phases = rng.uniform(0, 2 * np.pi, tones)
    times = np.arange(steps) * step
    waves = np.sin(2 * np.pi * rates[:, None] * times + phases[:, None])
    return waves.sum(axis=0) * np.sqrt(2 / tones)


def tremor(steps: int, step: float, rate: float, rng: np.random.Generator) -> Series:
    """A sine of amplitude 1, `rate` [Hz], whose phase is drawn."""
    return np.sin(2 * np.pi * (rate * np.arange(steps) * step + rng.random()))
