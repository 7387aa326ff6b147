"""This module defines the calibration of a skin, which converts counts to pressure."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from eskin.errors import RecordingError, SkinMismatchError
from eskin.skin import Skin
from eskin.touch.pressure_kernels import (
    PressureCurve,
    compute_counts,
    compute_pressures,
)
from eskin.units import format_count

VERSIONS = (1, 2)
"""Versions of the text; that of counts which fall is 2, so that no program that knows
of rising ones alone reads it."""
MAX_CALIBRATION_BYTES = 8 << 20
"""Largest size of a calibration as text, with 200,000 gains [bytes]."""
PARSE_ERRORS = (LookupError, OverflowError, RecursionError, TypeError, ValueError)
"""Exceptions that JSON of another structure raises."""
Curve = Literal["linear", "divider", "logarithmic"]
CalibrationSource = Literal["nominal", "rest", "presses", "exact"]
MAX_FULL_SCALE = 2.0**16 - 1.0
"""Largest full scale [counts]: packets and recordings hold 16 bits."""
MAX_CONTACT = 0.25
"""Largest share of full scale at which contact begins, whatever a file says."""
LIMITS = {
    "gain": (1e-4, 1e5),  # times full scale
    "shear_gain": (-1e4, 1e4),
    "shear_rest": (-MAX_FULL_SCALE, MAX_FULL_SCALE),
    "floor": (0.0, 1e4),
    "exponent": (0.2, 5.0),
    "unfelt": (0.0, 1e4),
    "span": (0.0, 1e6),
    "noise": (0.0, 1.0),  # times full scale
    "rest": (-1.0, 1.0),  # times full scale
    "gain_deviation": (0.0, 1e3),
    "exponent_deviation": (0.0, 1e3),
    "unfelt_deviation": (0.0, 1e3),
    "release_seconds": (1e-3, 10.0),
}
"""Smallest and largest value of each field, beyond the values of any sensor."""
MEASURED = ("noise", "rest", "gain_deviation")
"""Fields that hold numbers of taxels or patches, or None."""
DEFAULT_FREE = (
    *MEASURED,
    "exponent_deviation",
    "unfelt_deviation",
    "source",
    "falling",
    "release_seconds",
)
"""Keys that are left out of the text where they have their defaults, so that a nominal
calibration is written as it always was."""


def parse_choice(what: str, name: object, choices: object) -> Any:  # noqa: ANN401
    """Return a name that is one of a `Literal`; raise `ValueError` for another."""
    if name in get_args(choices):
        return name
    allowed = ", ".join(get_args(choices))
    raise ValueError(f"{what} is {name!r}; allowed are {allowed}")


def parse_flag(what: str, value: object) -> bool:
    """Return a truth value; raise `ValueError` for another value."""
    if value in (True, False):
        return bool(value)
    raise ValueError(f"{what} is {value!r}; allowed are true and false")


def parse_numbers(values: object) -> Float[np.ndarray, "number"] | None:
    """Return a list of numbers as an array, and None as it is."""
    return None if values is None else np.array(values, dtype=np.float64)


def parse_number(value: object) -> float | None:
    """Return a number as a float, and None as it is."""
    return None if value is None else float(value)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibration holds the constants of a skin's electronics.

    It is stored in every recording.
    """

    gain: Float[np.ndarray, "taxel"]
    """Pressure of one count [kPa/count]. Gain times full scale is the pressure at full
    scale, or at half scale where `curve` is "divider"."""
    full_scale: int
    """Counts at which the converter saturates."""
    shear_gain: float = 1.0
    """Shear of one count [kPa/count]; unused where no shear is measured."""
    shear_rest: int = 0
    """Nominal counts of a shear channel at rest."""
    floor: float = 0.0
    """Pressure below which the signal does not distinguish a touch from rest, such as
    that of a tight sleeve [kPa]; the thresholds of contact rise with it."""
    curve: Curve = "linear"
    """Counts over pressure: proportional; those of a voltage divider with a resistor
    whose conductance is a power of the pressure, which with an exponent of 1 is also
    the curve of a capacitor on a spring; or the logarithm of such a conductance."""
    exponent: float = 1.0
    """Exponent of that power; unused where the curve is linear."""
    unfelt: float = 0.0
    """Pressure that closes the layers of the sensor without a change of the counts
    [kPa]. It is added to the measured pressure, which it at most doubles, so that noise
    stays small."""
    span: float = 0.0
    """Conductance at full scale of a logarithmic converter, by that from which counts
    grow as its logarithm; unused with other curves."""
    matrix: bool = False
    """Whether taxels are read out by rows and columns, with crosstalk between them that
    `CrosstalkCompensator` estimates and subtracts."""
    falling: bool = False
    """Whether counts fall under pressure, as of a sensor with a pull-up resistor;
    full scale less the counts is then what the other constants are of."""
    source: CalibrationSource = "nominal"
    """Where the constants come from. `nominal`: a data sheet; `rest`: rest and noise of
    this skin were measured; `presses`: its gains as well, from presses; `exact`: the
    true constants of a simulated sensor."""
    release_seconds: float = 0.1
    """Time constant with which the pressure falls once the sensor is let go [s]. The
    front end learns it from releases; this is where it begins."""
    noise: Float[np.ndarray, "taxel"] | None = None
    """Standard deviation of each taxel at rest, rounding included [counts]; None where
    it was not measured."""
    rest: Float[np.ndarray, "taxel"] | None = None
    """Counts of each taxel at rest, as the converter gives them; None where they were
    not measured."""
    gain_deviation: Float[np.ndarray, "patch"] | None = None
    """Standard deviation of the natural logarithm of the gain of each patch, in the
    skin's order, as presses leave it; None where no press was measured."""
    exponent_deviation: float | None = None
    """The same of the exponent; None where presses did not estimate it."""
    unfelt_deviation: float | None = None
    """The same of `unfelt`; None where presses did not estimate it."""

    def __repr__(self) -> str:
        """Describe the calibration in a line."""
        return (
            f"<Calibration of {format_count(len(self.gain), 'taxel')}: {self.source}, "
            f"{self.curve}, full scale {self.full_scale} counts>"
        )

    def check_skin(self, skin: Skin) -> None:
        """Raise a `SkinMismatchError` unless the calibration has a gain a taxel."""
        if len(self.gain) != skin.count:
            raise SkinMismatchError(
                f"calibration has {len(self.gain)} taxels, skin '{skin.name}' "
                f"has {skin.count}; allowed is one gain a taxel; use the skin's own"
            )

    def __post_init__(self) -> None:
        """Refuse constants that no sensor has."""
        parse_choice("curve", self.curve, Curve)
        parse_choice("source", self.source, CalibrationSource)
        full = self.full_scale
        self.check_field("full_scale", 1.0, MAX_FULL_SCALE)
        units = {"gain": 1.0 / full, "noise": full, "rest": full}
        for name, (low, high) in LIMITS.items():
            if name == "span" and self.curve == "logarithmic":
                low = 0.01
            unit = units.get(name, 1.0)
            self.check_field(name, low * unit, high * unit)
        for name in ("noise", "rest"):
            value = getattr(self, name)
            if value is not None and len(value) != len(self.gain):
                raise ValueError(
                    f"{name} has {len(value)} values, gain has {len(self.gain)}; "
                    "allowed is one number a taxel; calibrate the skin again"
                )

    def check_field(self, name: str, low: float, high: float) -> None:
        """Refuse a field that has a number outside limits, or another shape."""
        value = getattr(self, name)
        is_list = name in ("gain", *MEASURED)
        if value is None and name not in ("gain", "full_scale"):
            return
        numbers = np.asarray(value)
        wrong = numbers[~((numbers >= low) & (numbers <= high))]
        if numbers.ndim != is_list or len(wrong):
            got = wrong[0] if len(wrong) else f"of shape {numbers.shape}"
            raise ValueError(
                f"{name} is {got!s:.40}; allowed is {low:g} to {high:g}"
                f"{' each' * is_list}; correct it by the data sheet, or calibrate the "
                "skin again"
            )

    @classmethod
    def uniform(
        cls, count: int, full_scale: int, pressure: float, floor: float = 0.0
    ) -> "Calibration":
        """Return one gain for all taxels: `pressure` [kPa] at `full_scale` counts."""
        return cls(np.full(count, pressure / full_scale), full_scale, floor=floor)

    @property
    def pressure_curve(self) -> PressureCurve:
        """The parameters of the curve for compiled code."""
        if self.curve == "linear":
            return PressureCurve(np.inf, 1.0, self.unfelt, 0.0)
        span = self.span if self.curve == "logarithmic" else 0.0
        return PressureCurve(float(self.full_scale), self.exponent, self.unfelt, span)

    def compute_counts(
        self, pressure: float | Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Compute the counts above rest at a pressure [kPa], or at one a taxel."""
        return self.convert(compute_counts, pressure)

    def compute_contact(self, pressure: float) -> Float[np.ndarray, "taxel"]:
        """Compute the counts above rest at which contact begins, from a pressure [kPa].

        They are at most a quarter of full scale.
        """
        return np.minimum(self.compute_counts(pressure), MAX_CONTACT * self.full_scale)

    def compute_pressure(
        self, above: Float[np.ndarray, "*batch taxel"]
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Compute the pressure [kPa] at counts above rest."""
        return self.convert(compute_pressures, above)

    def convert(
        self,
        kernel: Callable[..., None],
        values: float | Float[np.ndarray, "*batch taxel"],
    ) -> Float[np.ndarray, "*batch taxel"]:
        """Convert one value, or one a taxel, by a kernel of the pressure curve."""
        every, gain = np.broadcast_arrays(np.asarray(values, np.float64), self.gain)
        out = np.empty(every.size)
        kernel(every.ravel(), gain.ravel(), self.pressure_curve, out)
        return out.reshape(every.shape)

    def turn_counts(self, counts: np.ndarray) -> np.ndarray:
        """Return full scale less the counts, and counts below zero as they are.

        By those a converter signals invalid data. Twice is the same as not at all.
        """
        turned = np.maximum(self.full_scale - counts, 0)
        return np.where(counts < 0, counts, turned)

    def with_full_scale(self, full_scale: int) -> "Calibration":
        """Return the constants for a converter with another full scale [counts].

        The pressure at full scale stays; rest and noise are counts, and stay too.
        """
        gain = self.gain * (self.full_scale / full_scale)
        return replace(self, gain=gain, full_scale=full_scale)

    @property
    def rising(self) -> "Calibration":
        """The calibration of the same skin for counts that are turned to rise."""
        if not self.falling:
            return self
        rest = None if self.rest is None else self.turn_counts(self.rest)
        return replace(self, falling=False, rest=rest)

    def to_bytes(self) -> bytes:
        """Encode the constants as JSON text."""
        content = {"version": VERSIONS[self.falling], **vars(self)}
        for name in ("gain", *MEASURED):
            values = content[name]
            content[name] = None if values is None else [float(v) for v in values]
        for name in DEFAULT_FREE:
            if content[name] == getattr(Calibration, name):
                del content[name]
        if self.curve != "logarithmic":
            del content["span"]
        return json.dumps(content).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> "Calibration":
        """Decode what `to_bytes` encoded.

        Raises:
            RecordingError: The bytes are no calibration of a known version.
        """
        if len(data) > MAX_CALIBRATION_BYTES:
            raise RecordingError(
                f"calibration has {len(data):,} bytes; allowed are "
                f"{MAX_CALIBRATION_BYTES:,}; record again, or use Calibration.to_bytes"
            )
        try:
            content = json.loads(data)
            version = content["version"]
            calibration = cls(
                gain=np.array(content["gain"], dtype=np.float64),
                full_scale=int(content["full_scale"]),
                shear_gain=float(content.get("shear_gain", 1.0)),
                shear_rest=int(content.get("shear_rest", 0)),
                floor=float(content.get("floor", 0.0)),
                curve=parse_choice("curve", content.get("curve", "linear"), Curve),
                exponent=float(content.get("exponent", 1.0)),
                unfelt=float(content.get("unfelt", 0.0)),
                span=float(content.get("span", 0.0)),
                release_seconds=float(content.get("release_seconds", 0.1)),
                matrix=parse_flag("matrix", content.get("matrix", False)),
                falling=parse_flag("falling", content.get("falling", False)),
                source=parse_choice(
                    "source", content.get("source", "nominal"), CalibrationSource
                ),
                **{name: parse_numbers(content.get(name)) for name in MEASURED},
                exponent_deviation=parse_number(content.get("exponent_deviation")),
                unfelt_deviation=parse_number(content.get("unfelt_deviation")),
            )
        except PARSE_ERRORS as error:
            raise RecordingError(
                f"calibration cannot be read ({type(error).__name__}: {error}); "
                "allowed is JSON with version, gain and full_scale; measure it with "
                "eskin calibrate"
            ) from error
        if version not in VERSIONS:
            raise RecordingError(
                f"calibration has version {version}; allowed are {VERSIONS}; "
                "read it with a newer eskin"
            )
        return calibration
