"""Press hands evenly on taxels of a simulated sensor, and read its scans."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.people.gesture_sample import build_minimum_jerk
from eskin.sim.sensor import Sensor, SensorBuild
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.units import NS_PER_S

LANDING = 0.3
"""Time in which a hand lands, and in which it lifts [s]."""
LEAST_PRESSURE = 2.0
"""Least pressure that the pressures of hands are multiples of [kPa]."""
SWAY_SECONDS = 1.0
"""Time constant with which the force of a still hand varies [s]."""
SHAPES = {
    "palm": tuple((row, column) for row in range(6) for column in range(5)),
    "fingers": tuple((row, column) for row in range(2) for column in (0, 2, 4, 6)),
}
"""Rows and columns that each kind of hand presses."""


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand presses some taxels evenly, from a moment on until another."""

    taxels: Int[np.ndarray, "pressed"]
    """Taxels that are pressed."""
    pressure: float
    """Mean pressure on each [kPa]."""
    lands: float
    """Time at which it lands [s]; negative if before the first scan."""
    lifts: float
    """Time at which it begins to lift [s]."""

    def compute_share(self, times: Float[np.ndarray, "step"]) -> np.ndarray:
        """Return the share of the pressure at times, without the sway [0 to 1]."""
        ramp = build_minimum_jerk(101)
        rising = np.interp(times - self.lands, np.linspace(0, LANDING, 101), ramp)
        falling = np.interp(times - self.lifts, np.linspace(0, LANDING, 101), ramp)
        return rising - falling


def draw_block(
    shape: str, patch: str, skin: Skin, rng: np.random.Generator
) -> Int[np.ndarray, "pressed"]:
    """Draw taxels of a patch that a kind of hand presses, all of them present."""
    taxels = skin.find_taxels(patch)
    found = {(skin.rows[one], skin.columns[one]): one for one in taxels}
    places = [
        [found.get((row + r, column + c)) for r, c in SHAPES[shape]]
        for row, column in found
    ]
    whole = [place for place in places if None not in place]
    return np.array(whole[int(rng.integers(len(whole)))], dtype=np.int64)


def compute_hand_pressure(
    factor: float, taxels: Int[np.ndarray, "pressed"], build: SensorBuild
) -> float:
    """Return a multiple of the activation pressure of taxels [kPa]."""
    activation = float(np.median(build.velostat.activation[taxels]))
    return factor * max(activation, LEAST_PRESSURE)


def set_creep(
    build: SensorBuild, growth: float, first: float, last: float
) -> SensorBuild:
    """Return a build whose reading grows by a share between two times under load.

    Args:
        build: build to change; a new creep keeps its course over time.
        growth: growth of conductance.
        first: first of the times [s].
        last: second of them [s].
    """
    velostat = build.velostat
    creep = np.ones_like(velostat.creep)
    grown = np.array(
        [
            creep[0] @ (1.0 - np.exp(-time / velostat.creep_times))
            for time in (first, last, build.calibrated_at)
        ]
    )
    # growth = (1 + c g_last) / (1 + c g_first) - 1, solved for the size c.
    size = growth / (grown[1] - (1.0 + growth) * grown[0])
    own = build.compute_calibrated_creep()
    changed = replace(
        velostat,
        creep=size * creep,
        gain=velostat.gain * own / (1.0 + size * grown[2]),
    )
    return replace(build, velostat=changed)


class PressedSensor:
    """A pressed sensor is one that hands press, read scan by scan."""

    def __init__(
        self,
        build: SensorBuild,
        skin: Skin,
        hands: Sequence[Hand],
        sway: float,
        seed: int,
        before: float = 0.0,
    ) -> None:
        """Begin at time 0.

        Args:
            build: sensor.
            skin: skin of its taxels.
            hands: hands, which press different taxels at any time.
            sway: deviation of the force of a still hand, relative to it.
            seed: seed of the sensor's noise and of the sway.
            before: time before the first scan, for which hands are pressed already [s].
        """
        self.build = build
        self.skin = skin
        self.hands = tuple(hands)
        self.sway = sway
        self.sensor = Sensor(build, skin, np.random.default_rng((seed, 27)))
        self.rng = np.random.default_rng((seed, 28))
        self.taxels = np.unique(np.concatenate([hand.taxels for hand in hands]))
        self.step = build.electronics.step
        self.period = build.electronics.period
        self.ratio = round(self.period / self.step)
        self.time = -before
        self.states = np.random.default_rng((seed, 29)).standard_normal(len(hands))
        for _ in range(round(before / self.period)):
            self.push()

    def push(self) -> None:
        """Simulate the steps until the next scan."""
        times = self.time + self.step * np.arange(1, self.ratio + 1)
        pressure = np.zeros((self.ratio, len(self.taxels)))
        keep = float(np.exp(-self.period / SWAY_SECONDS))
        fresh = self.rng.standard_normal(len(self.hands))
        self.states = keep * self.states + np.sqrt(1.0 - keep**2) * fresh
        for hand, state in zip(self.hands, self.states, strict=True):
            places = np.searchsorted(self.taxels, hand.taxels)
            force = hand.pressure * np.exp(self.sway * state)
            pressure[:, places] += (force * hand.compute_share(times))[:, None]
        self.sensor.simulate_steps(pressure, self.taxels)
        self.time += self.period

    def scan(self, q: Float[np.ndarray, "joint"]) -> Scan:
        """Simulate the next scan, in a pose."""
        self.push()
        counts = self.sensor.read(np.array([self.sensor.steps - 1.0]))[0]
        lost = self.sensor.losses.draw_next()[0]
        received = ~lost[self.skin.patch_index]
        counts[~received] = 0
        stamp = round((self.time + STAMP_OFFSET) * NS_PER_S)
        return Scan(stamp, counts, received, q)


STAMP_OFFSET = 10.0
"""Stamp of time 0 [s]."""
