"""Wrong calibrations and readings are refused, each in one line that says why.

What is refused by a pipeline that has begun, which then goes on, is tested with it.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import EskinError, ReadingError, RecordingError, SkinMismatchError
from eskin.skin import MountedSkin
from eskin.touch import (
    Calibration,
    CalibrationConfig,
    ContactConfig,
    FrontEnd,
    PipelineConfig,
    TouchPipeline,
)
from helpers.refusals import REFUSALS, check_refusal, refusal
from helpers.touch import (
    SECOND,
    START,
    build_grid_skin,
    one_link_robot,
    reading_at,
    scan_at,
)

SKIN = build_grid_skin()
MOUNTED = MountedSkin(SKIN, one_link_robot())
DIVIDER = Calibration(
    np.full(SKIN.count, 50.0 / 4095), 4095, curve="divider", exponent=0.8, unfelt=2.0
)
LINEAR = Calibration(np.full(SKIN.count, 120.0 / 255), 255)
ENTRIES = json.loads(DIVIDER.to_bytes())


def data(content, *parts):
    """Return the row of bytes that are no calibration."""

    def call():
        Calibration.from_bytes(content)

    name = f"bytes {content!r}"
    return refusal(name, RecordingError, call, "calibration ", "allowed", *parts)


def entry(key, value, *parts):
    """Return the row of the bytes of a calibration with another entry."""
    content = json.dumps(ENTRIES | {key: value}).encode()

    def call():
        Calibration.from_bytes(content)

    name = f"{key} {str(value):.20} in a file"
    return refusal(name, RecordingError, call, "calibration ", "allowed", *parts)


def constant(key, value, *parts):
    """Return the row of a calibration with another constant."""

    def call():
        replace(DIVIDER, **{key: value})

    return refusal(f"{key} {str(value):.20}", ValueError, call, *parts)


def blinding(key, value, part):
    """Return the row of a calibration with which no touch would be felt."""

    def call():
        TouchPipeline(MOUNTED, replace(DIVIDER, **{key: value}))

    name = f"{key} that blinds, {np.max(value):g}"
    parts = ("allowed is ", "calibrate the skin again")
    return refusal(name, ValueError, call, part, *parts)


def unreached(contact):
    """Return the row of a model whose contact [kPa] the converter does not reach."""
    config = PipelineConfig(CalibrationConfig(), ContactConfig(on=contact))

    def call():
        TouchPipeline(MOUNTED, LINEAR, config)

    name = f"contact at {contact:g} kPa"
    return refusal(name, EskinError, call, f"at {contact:g} kPa; allowed ", "train the")


def scan(key, value, *parts):
    """Return the row of a scan with another value."""

    def call():
        replace(scan_at(0.0, np.zeros(3)), **{key: value})

    return refusal(f"{key} of a scan {value!r:.30}", ReadingError, call, *parts)


ROWS = [
    data(b"", "Expecting value"),
    data(b"[]", "list indices"),
    data(b"{}", "'version'"),
    data(b'{"version": 1}', "'gain'"),
    data(b"\xff", "byte 0xff"),
    entry("curve", "round", "curve is 'round'"),
    entry("exponent", 0.0, "exponent is 0.0"),
    entry("version", 3, "has version 3"),
    entry("source", "guess", "source is 'guess'"),
    entry("noise", [1.0], "noise"),
    entry("noise", [-1.0] * SKIN.count, "noise is -1.0"),
    entry("rest", [float("nan")] * SKIN.count, "rest is nan"),
    entry("gain_deviation", [float("inf")], "gain_deviation is inf"),
    entry("unfelt_deviation", -0.1, "unfelt_deviation is -0.1"),
    entry("falling", "no", "falling is 'no'", "true and false"),
    constant("gain", np.array([0.1, np.nan]), "gain is nan"),
    constant("exponent", np.inf, "exponent is inf"),
    constant("full_scale", 0, "full_scale is 0"),
    refusal(
        "logarithmic curve without its span",
        ValueError,
        lambda: replace(DIVIDER, curve="logarithmic"),
        "span is 0.0",
        "data sheet",
    ),
    refusal(
        "calibration of another skin",
        SkinMismatchError,
        lambda: FrontEnd(SKIN, Calibration.uniform(5, 1000, 100.0)),
        "5 taxels",
        "36",
    ),
    blinding("gain", 1e-3 * DIVIDER.gain, "at 0.826 of full scale"),
    blinding("gain", 1e300 * DIVIDER.gain, "e+298"),
    blinding("floor", 500.0, "at 500 kPa"),
    blinding("noise", np.full(SKIN.count, 1e9), "noise is 1000000000.0"),
    blinding("exponent", 1e9, "exponent is 1000000000.0"),
    *map(unreached, (1e3, 1e4)),
    scan("counts", np.array([1.0, np.nan, 2.0]), "counts is float64"),
    scan("received", np.ones(2, bool), "received has shape (2,)"),
    scan("counts", np.zeros(3, np.uint32), "counts is uint32", "signed", "convert it"),
    scan("stamp", START / SECOND, "allowed is int", "seconds: give round(1e9"),
    scan("stamp", float(START), "stamp is float", "time.time_ns", "lost digits"),
    scan("stamp", np.int64(START), "stamp is int64", "allowed is int", "int("),
    scan("q", np.array([0.0, np.nan]), "q of joint 1 is nan"),
    refusal(
        "pressure of a valid taxel",
        ReadingError,
        lambda: reading_at(0.0, [1.0, np.nan, 2.0]),
        "pressure of taxel 1 is nan",
    ),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_calibration_or_reading_is_refused_in_one_line(error, call, parts):
    check_refusal(error, call, parts)
