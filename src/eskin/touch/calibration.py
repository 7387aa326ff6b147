"""Counts to kPa: the constants of the electronics, and the baseline as it drifts."""

import json
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import ReadingError, RecordingError, SkinMismatchError
from eskin.skin.skin import Skin
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration_kernels import (
    MOST,
    Memory,
    PressureCurve,
    Rates,
    calibrate,
)
from eskin.touch.reading import Reading, Scan, check_order
from eskin.units import NS_PER_S

VERSION = 1

UNREADABLE = (LookupError, OverflowError, RecursionError, TypeError, ValueError)
"""What JSON of another shape raises."""

Curve = Literal["linear", "divider"]

CURVES: tuple[Curve, ...] = ("linear", "divider")


def curve_named(name: object) -> Curve:
    """The curve of that name.

    Raises:
        ValueError: there is none.
    """
    for curve in CURVES:
        if name == curve:
            return curve
    raise ValueError(
        f"curve is {name!r}; allowed are 'linear' and 'divider'; correct it"
    )


@dataclass(frozen=True, eq=False)
class Calibration:
    """Constants of one skin's electronics; travels with a recording."""

    gain: Float[np.ndarray, "taxel"]
    """Pressure of one count [kPa/count]; behind a divider, gain times full scale is
    the pressure at half scale."""

    full_scale: int
    """Counts at which the converter saturates."""

    shear_gain: float = 1.0
    """Shear of one count [kPa/count]; without meaning where no shear is measured."""

    shear_rest: int = 0
    """Nominal counts of a shear channel at rest."""

    floor: float = 0.0
    """Pressure below which this device's signal does not tell a touch from rest, as
    under a sleeve worn tight [kPa]; raises the thresholds of contact."""

    curve: Curve = "linear"
    """How counts grow with pressure: in proportion, or as those of a resistor in a
    voltage divider whose conductance is a power of pressure."""

    exponent: float = 1.0
    """That power; without meaning where the curve is linear."""

    unfelt: float = 0.0
    """Pressure that it takes to close the sensor, of which nothing is felt [kPa]. It is
    added to what is felt, but never more than is felt, so that noise stays noise."""

    matrix: bool = False
    """Whether taxels are read out by rows and columns that leak into each other; how
    much is then learned from the readings and taken off, see `CrosstalkCompensator`."""

    def __post_init__(self) -> None:
        """Refuse constants that no electronics have."""
        gain = np.asarray(self.gain)
        if gain.ndim != 1 or not (np.isfinite(gain).all() and (gain > 0).all()):
            raise ValueError(
                f"gain has shape {gain.shape} and least value {gain.min(initial=0)}; "
                "allowed is one finite positive number a taxel [kPa/count]; "
                "calibrate the skin again"
            )
        finite = np.isfinite([self.shear_gain, self.floor, self.unfelt]).all()
        if self.full_scale <= 0 or not finite or min(self.floor, self.unfelt) < 0:
            raise ValueError(
                f"full_scale is {self.full_scale}, shear_gain {self.shear_gain}, floor "
                f"{self.floor} and unfelt {self.unfelt}; allowed are positive counts, "
                "a finite gain, floor and unfelt of at least 0 kPa; correct them"
            )
        if not 0 < self.exponent < np.inf:
            raise ValueError(
                f"exponent is {self.exponent}; allowed is a finite positive number; "
                "correct it"
            )
        curve_named(self.curve)

    @classmethod
    def uniform(
        cls, count: int, full_scale: int, pressure: float, floor: float = 0.0
    ) -> "Calibration":
        """The same gain for all taxels: `pressure` [kPa] at `full_scale` counts."""
        return cls(np.full(count, pressure / full_scale), full_scale, floor=floor)

    def compute_counts(
        self, pressure: float | Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Counts above rest that mean a pressure [kPa], the same or of each taxel."""
        conductance = self.compute_conductance(pressure)
        if self.curve == "linear":
            return self.full_scale * conductance
        return self.full_scale * conductance / (1.0 + conductance)

    def compute_pressure(
        self, above: Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Pressure [kPa] that counts above rest mean."""
        share = np.maximum(above, 0.0) / self.full_scale
        if self.curve == "linear":
            return self.invert_conductance(share)
        share = np.minimum(share, MOST)
        return self.invert_conductance(share / (1.0 - share))

    def compute_conductance(
        self, pressure: float | Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """What a pressure [kPa] lets through, by what half scale does.

        Of a linear device it is the counts above rest by full scale.
        """
        felt = np.maximum(pressure - self.unfelt, 0.5 * pressure)
        linear = felt / (np.asarray(self.gain, np.float64) * self.full_scale)
        return linear if self.curve == "linear" else linear**self.exponent

    def invert_conductance(
        self, conductance: Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Pressure [kPa] that lets through so much; undoes `compute_conductance`."""
        power = 1.0 if self.curve == "linear" else 1.0 / self.exponent
        felt = conductance**power * self.gain * self.full_scale
        return felt + np.minimum(felt, self.unfelt)

    def to_bytes(self) -> bytes:
        """The constants as JSON text."""
        return json.dumps(
            {
                "version": VERSION,
                "gain": [float(gain) for gain in self.gain],
                "full_scale": self.full_scale,
                "shear_gain": self.shear_gain,
                "shear_rest": self.shear_rest,
                "floor": self.floor,
                "curve": self.curve,
                "exponent": self.exponent,
                "unfelt": self.unfelt,
                "matrix": self.matrix,
            }
        ).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> "Calibration":
        """Read what `to_bytes` wrote.

        Raises:
            RecordingError: the bytes are no calibration of a known version.
        """
        try:
            content = json.loads(data)
            version = content["version"]
            calibration = cls(
                np.array(content["gain"], dtype=np.float64),
                int(content["full_scale"]),
                float(content["shear_gain"]),
                int(content["shear_rest"]),
                float(content["floor"]),
                curve_named(content.get("curve", "linear")),
                float(content.get("exponent", 1.0)),
                float(content.get("unfelt", 0.0)),
                bool(content.get("matrix", False)),
            )
        except UNREADABLE as error:
            raise RecordingError(
                f"calibration cannot be read ({type(error).__name__}: {error}); "
                "allowed is JSON with version, gain, full_scale, shear_gain, "
                "shear_rest and floor; record again, or use Calibration.to_bytes"
            ) from error
        if version != VERSION:
            raise RecordingError(
                f"calibration has version {version}; allowed is {VERSION}; "
                "read it with a newer eskin"
            )
        return calibration


@dataclass(frozen=True)
class CalibrationConfig:
    """How the baseline of each taxel is found and followed. All times in [s]."""

    tare_seconds: float = 2.0
    """How long a taxel is tared after it is first heard."""

    tare_samples: int = 16
    """How many samples the tare takes in that time."""

    tare_rank: float = 0.25
    """Which of the sorted samples is the baseline: low, so that a touch is not it."""

    margin: float = 1.5
    """Pressure above the baseline from which a taxel may be touched [kPa]; below the
    baseline by as much, it sits too low."""

    drift_seconds: float = 10.0
    """Time constant of following the drift of an untouched taxel."""

    low_seconds: float = 0.3
    """Time constant of recovering from a baseline that is too high."""

    freeze_seconds: float = 3.0
    """How long after a touch a taxel and its neighbours are not followed."""

    longest_seconds: float = 120.0
    """After how long without a break a touch is taken for a change at rest."""

    stale_seconds: float = 5.0
    """Time constant of learning such a change."""

    after_fraction: float = 0.1
    """Part of its recent peak that a released taxel may keep without being touched; of
    counts, as what stays is a shift of the baseline."""

    fade_seconds: float = 20.0
    """Time constant in which the recent peak is forgotten."""

    steady_seconds: float = 1.0
    """After how long without change above the baseline a taxel is taken to rest: nobody
    holds a finger so still, but what a sensor keeps after a touch, or feels where the
    skin bends, stays."""

    still: float = 0.25
    """What counts as no change, in units of `margin`."""

    kept: float = 5.0
    """The most that a sensor is believed to keep, in units of `margin`."""

    settle_seconds: float = 0.3
    """Time constant of learning what does not change."""

    relearn_seconds: float = 2.0
    """Time constant of learning what a released taxel keeps."""

    silence_seconds: float = 10.0
    """After how long unheard a taxel is tared anew: its patch may be another one."""


class Calibrator:
    """Turns the counts of one skin into kPa, scan by scan; final and stateful.

    Only stamps and past scans decide, so a replayed recording gives the same readings
    as the live device at any rate.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        config: CalibrationConfig | None = None,
    ) -> None:
        """Start untared."""
        if len(calibration.gain) != skin.count:
            raise SkinMismatchError(
                f"calibration has {len(calibration.gain)} taxels, skin '{skin.name}' "
                f"has {skin.count}; allowed is one gain a taxel; use the skin's own"
            )
        self.skin = skin
        self.calibration = calibration
        self.config = config or CalibrationConfig()
        self.adjacency = Adjacency.build(skin)
        self.gain = np.asarray(calibration.gain, np.float64)
        self.margin = calibration.compute_counts(self.config.margin)
        self.bend = build_pressure_curve(calibration)
        self.rates = rates_of(self.config)
        self.memory = fresh_memory(skin.count, self.config.tare_samples)
        self.shear_rest = np.full((skin.count, 2), float(calibration.shear_rest))
        self.first: int | None = None
        self.last: int | None = None

    def push(
        self, scan: Scan, faulty: Bool[np.ndarray, "taxel"] | None = None
    ) -> Reading:
        """Calibrate the next scan; faulty taxels are not valid and teach nothing."""
        check_count(scan, self.skin)
        check_order(self.last, scan.stamp)
        if self.first is None:
            self.first = scan.stamp
        seconds = (scan.stamp - self.first) / NS_PER_S
        elapsed = 0.0 if self.last is None else (scan.stamp - self.last) / NS_PER_S
        self.last = scan.stamp
        use = scan.received if faulty is None else scan.received & ~faulty
        pressure = np.empty(self.skin.count, np.float32)
        calibrate(
            scan.counts,
            use,
            seconds,
            self.gain,
            self.bend,
            self.margin,
            self.adjacency.starts,
            self.adjacency.neighbours,
            self.memory,
            self.rates,
            pressure,
        )
        shear = None
        if scan.shear is not None:
            shear = self.push_shear(scan.shear, use, seconds, elapsed)
        return Reading(scan.stamp, pressure, use.copy(), scan.q, shear)

    def push_shear(
        self,
        counts: Int[np.ndarray, "taxel 2"],
        use: Bool[np.ndarray, "taxel"],
        seconds: float,
        elapsed: float,
    ) -> Float[np.ndarray, "taxel 2"]:
        """Calibrate shear; its rest is followed while the taxel is untouched."""
        above = counts - self.shear_rest
        idle = use & (seconds - self.memory.held > self.config.freeze_seconds)
        follow = elapsed / (self.config.drift_seconds + elapsed)
        self.shear_rest[idle] += follow * above[idle]
        shear = (above * self.calibration.shear_gain).astype(np.float32)
        shear[~use] = 0.0
        return shear


def build_pressure_curve(calibration: Calibration) -> PressureCurve:
    """How the curve bends, as the kernel wants it."""
    if calibration.curve == "linear":
        return PressureCurve(np.inf, 1.0, calibration.unfelt)
    power = 1.0 / calibration.exponent
    return PressureCurve(float(calibration.full_scale), power, calibration.unfelt)


def check_count(scan: Scan, skin: Skin) -> None:
    """Refuse a scan of another skin."""
    if len(scan.counts) != skin.count:
        raise ReadingError(
            f"scan has {len(scan.counts)} taxels, skin '{skin.name}' has {skin.count}; "
            "allowed is one count a taxel; load the skin that the data came from"
        )


def rates_of(config: CalibrationConfig) -> Rates:
    """The configuration as the kernel wants it."""
    return Rates(
        tare_step=config.tare_seconds / config.tare_samples,
        tare_rank=config.tare_rank,
        drift=config.drift_seconds,
        low=config.low_seconds,
        freeze=config.freeze_seconds,
        longest=config.longest_seconds,
        stale=config.stale_seconds,
        fade=config.fade_seconds,
        after=config.after_fraction,
        relearn=config.relearn_seconds,
        silence=config.silence_seconds,
        steady=config.steady_seconds,
        still=config.still,
        kept=config.kept,
        settle=config.settle_seconds,
    )


def fresh_memory(count: int, samples: int) -> Memory:
    """The memory of a skin never heard."""
    never = np.full(count, -np.inf)
    return Memory(
        baseline=np.zeros(count),
        peak=np.zeros(count),
        low=np.full(count, np.inf),
        heard=never.copy(),
        since=np.full(count, np.inf),
        held=never.copy(),
        steady=np.full(count, np.inf),
        steady_at=never.copy(),
        due=never.copy(),
        filled=np.zeros(count, np.int64),
        samples=np.zeros((count, samples)),
    )
