"""This module defines the data of a skin at one instant: scans and readings."""

import math
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import ReadingError
from eskin.skin import Skin


# Scan and Reading check their own types: no_type_check switches off the tests' hook.
@no_type_check
@dataclass(frozen=True, eq=False)
class Scan:
    """A scan holds the counts of the whole skin at one instant, before calibration."""

    stamp: int
    """Time at which it was taken [ns since the epoch]."""
    counts: Int[np.ndarray, "taxel"]
    """Counts of the converter (int32); meaningless where nothing was received. Unsigned
    ones of up to 16 bits, as many converters give, are converted."""
    received: Bool[np.ndarray, "taxel"]
    """False where no new data was received."""
    q: Float[np.ndarray, "joint"]
    """Joint positions at that time [rad] (float64)."""
    shear: Int[np.ndarray, "taxel 2"] | None = None
    """Counts along the taxel's tangent x and y, where the skin measures shear."""

    def __post_init__(self) -> None:
        """Refuse arrays of a wrong type or shape, and q that is not finite."""
        check_stamp(self.stamp)
        for name in ("counts", "shear"):
            object.__setattr__(self, name, to_signed(getattr(self, name)))
        count = check_array("counts", self.counts, "i", None)
        check_array("received", self.received, "b", count)
        if self.shear is not None:
            check_array("shear", self.shear, "i", count, 2)
        check_joints(self.q)


@no_type_check
@dataclass(frozen=True, eq=False)
class Reading:
    """A reading is a calibrated scan: the pressure on the whole skin at one instant."""

    stamp: int
    """Time at which it was taken [ns since the epoch]."""
    pressure: Float[np.ndarray, "taxel"]
    """Pressure on each taxel [kPa] (float32); meaningless where not valid."""
    valid: Bool[np.ndarray, "taxel"]
    """False where no new data was received, or the data cannot be trusted."""
    q: Float[np.ndarray, "joint"]
    """Joint positions at that time [rad] (float64)."""
    shear: Float[np.ndarray, "taxel 2"] | None = None
    """Shear along the taxel's tangent x and y [kPa] (float32), where measured."""

    def __post_init__(self) -> None:
        """Refuse arrays of a wrong type or shape, and NaN that is marked valid."""
        check_stamp(self.stamp)
        count = check_array("pressure", self.pressure, "f", None)
        check_array("valid", self.valid, "b", count)
        check_finite("pressure", self.pressure, self.valid)
        if self.shear is not None:
            check_array("shear", self.shear, "f", count, 2)
            check_finite("shear", self.shear.sum(axis=1), self.valid)
        check_joints(self.q)


MAX_SECONDS = 1e11
"""Number above which a stamp cannot be seconds since the epoch."""
KINDS = {"i": "signed integers", "f": "floating-point numbers", "b": "booleans"}


def check_stamp(stamp: object) -> None:
    """Refuse a stamp that is no Python integer, such as seconds in a float."""
    if type(stamp) is not int:
        remedy = "convert it with int(...)"
        if isinstance(stamp, float):
            remedy = "take time.time_ns(); a float of nanoseconds has lost digits"
            if abs(stamp) < MAX_SECONDS:
                remedy = "it looks like seconds: give round(1e9 * stamp)"
        raise ReadingError(
            f"stamp is {type(stamp).__name__} {stamp}; allowed is int, nanoseconds "
            f"since the epoch; {remedy}"
        )


def to_signed(array: object) -> object:
    """Return an array of unsigned integers of up to 16 bits as signed ones."""
    if isinstance(array, np.ndarray) and array.dtype.kind == "u":
        return array.astype(np.int32) if array.dtype.itemsize <= 2 else array
    return array


def check_array(name: str, array: object, kind: str, *shape: int | None) -> int:
    """Return the length of an array; refuse another type or shape.

    Where the first length of the shape is None, any is allowed.
    """
    if not isinstance(array, np.ndarray) or array.dtype.kind != kind:
        got = getattr(array, "dtype", type(array).__name__)
        raise ReadingError(
            f"{name} is {got}; allowed is an array of {KINDS[kind]}; convert it first, "
            "and mark what is missing as not received or not valid"
        )
    is_other = array.ndim != len(shape) or array.shape[1:] != shape[1:]
    if is_other or shape[0] not in (None, len(array)):
        allowed = tuple("any" if want is None else want for want in shape)
        raise ReadingError(
            f"{name} has shape {array.shape}; allowed is {allowed}; "
            "give every taxel of the skin one entry"
        )
    return len(array)


def check_finite(
    name: str, values: Float[np.ndarray, "taxel"], valid: Bool[np.ndarray, "taxel"]
) -> None:
    """Refuse NaN and infinity where the taxel is marked valid."""
    finite = np.isfinite(values)
    if not finite.all() and (valid & ~finite).any():
        first = int(np.flatnonzero(valid & ~finite)[0])
        raise ReadingError(
            f"{name} of taxel {first} is {values[first]} but marked valid; allowed are "
            "finite numbers; mark the taxel as not valid"
        )


def check_joints(q: Float[np.ndarray, "joint"]) -> None:
    """Refuse joint positions that are not one finite number a joint."""
    check_array("q", q, "f", None)
    if not all(map(math.isfinite, q.tolist())):
        first = int(np.flatnonzero(~np.isfinite(q))[0])
        raise ReadingError(
            f"q of joint {first} is {q[first]}; allowed are finite numbers [rad]; "
            "send the last known joint positions while the robot is silent"
        )


def check_order(last: int, stamp: int) -> None:
    """Refuse a stamp that is not later than the last one."""
    if stamp <= last:
        raise ReadingError(
            f"stamp {stamp} ns comes after {last} ns; allowed is only later; "
            "drop late and repeated readings, or start anew for another recording"
        )


def check_count(data: Scan | Reading, skin: Skin) -> None:
    """Refuse data of another skin."""
    count = len(data.counts if isinstance(data, Scan) else data.pressure)
    if count != skin.count:
        raise ReadingError(
            f"{type(data).__name__.lower()} has {count} taxels, skin '{skin.name}' has "
            f"{skin.count}; allowed is one value a taxel; load the skin that the data "
            "came from"
        )
