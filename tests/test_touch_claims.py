"""Tests of what calibrations and models may claim: no file makes a skin numb.

A file is refused with one line, or the skin feels a fingertip of 20 N, whatever it
says of its sensor. What real sensors have is accepted.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import EskinError
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import (
    Calibration,
    ContactConfig,
    PipelineConfig,
    TouchPipeline,
)
from helpers.touch import one_link_robot, scan_at

SKIN = build_grid_skin(8, 8, calibrated=True)
MOUNTED = MountedSkin(SKIN, one_link_robot())
RNG = np.random.default_rng(0)
SCATTER = np.exp(0.3 * RNG.standard_normal(SKIN.count))
DIVIDER = Calibration(
    SCATTER * 50.0 / 4095, 4095, curve="divider", exponent=0.8, unfelt=2.0
)
LINEAR = Calibration(SCATTER * 120.0 / 255, 255)
LOGARITHMIC = Calibration(
    SCATTER * 200.0 / 1023,
    1023,
    curve="logarithmic",
    exponent=0.8,
    unfelt=3.0,
    span=300.0,
)
TRUE = [
    replace(one, noise=np.full(SKIN.count, 0.5), rest=np.full(SKIN.count, 20.0))
    for one in (DIVIDER, LINEAR, LOGARITHMIC)
]
MIDDLE = 27
"""Taxel that the fingertip presses."""


def feels(claimed, true, config=None):
    """Return whether a skin of a claimed calibration feels a fingertip of 20 N.

    Nothing may count as a touch before, and no number may overflow.
    """
    pipeline = TouchPipeline(MOUNTED, claimed, config)
    squared = np.sum((SKIN.positions - SKIN.positions[MIDDLE]) ** 2, axis=1)
    tip = 127.0 * np.exp(-squared / (2 * 0.005**2))  # 20 N, in kPa
    rng = np.random.default_rng(1)
    with np.errstate(all="raise", under="ignore"):
        for number in range(120):
            pressed = min(max(number - 80, 0) / 8, 1.0) * tip
            counts = 20 + true.compute_counts(pressed) + 0.4 * rng.normal(size=64)
            counts = np.minimum(np.round(counts), true.full_scale)
            state = pipeline.push_scan(scan_at(number / 50, counts))
            if number > 80 and state.open:
                return True
    return False


def is_safe(load, true, config=None):
    """Return whether a file is refused with one line, or is felt through."""
    try:
        return feels(load(), true, config)
    except (EskinError, ValueError) as error:
        message, *_ = str(error).split("(TypeCheckError")  # only in tests
        return len(message.splitlines()) == 1


VALUES = (0, -1, 1e-300, 1e-3, 1e9, 1e300, float("nan"), "x", None, [], {})


@pytest.mark.parametrize("true", TRUE, ids=lambda one: one.curve)
def test_absurd_calibration_is_refused_or_felt_through(true):
    content = json.loads(true.to_bytes())
    wrong = []
    for key, value in content.items():
        for other in VALUES:
            changed = [other]
            if isinstance(value, list) and isinstance(other, int | float):
                changed = [[other * one for one in value]]
                changed.append([*changed[0][:32], *value[32:]])
            for each in changed:
                data = json.dumps(content | {key: each}).encode()
                if not is_safe(lambda data=data: Calibration.from_bytes(data), true):
                    wrong.append((key, other))
    assert not wrong


@pytest.mark.parametrize("full_scale", [255, 4095, 65535])
@pytest.mark.parametrize(
    ("curve", "scale", "exponent", "unfelt"),
    [
        ("divider", 0.3, 0.8, 3.0),  # the most sensitive device measured
        ("divider", 130.0, 1.6, 18.0),
        ("linear", 60.0, 1.0, 0.0),
        ("linear", 300.0, 1.0, 0.0),
        ("logarithmic", 60.0, 0.7, 3.0),
        ("logarithmic", 600.0, 0.8, 3.0),
    ],
)
def test_calibration_of_a_real_sensor_is_accepted(
    full_scale, curve, scale, exponent, unfelt
):
    span = 300.0 if curve == "logarithmic" else 0.0
    claimed = Calibration(
        SCATTER * scale / full_scale,
        full_scale,
        curve=curve,
        exponent=exponent,
        unfelt=unfelt,
        span=span,
        noise=np.full(SKIN.count, max(0.001 * full_scale, 0.3)),
    )
    assert feels(claimed, claimed)


def test_taxel_that_claims_to_feel_little_feels_from_a_quarter_of_full_scale():
    numb = replace(LINEAR, gain=LINEAR.gain * np.where(np.arange(64) < 31, 1e-3, 1.0))
    pipeline = TouchPipeline(MOUNTED, numb)
    for number, above in enumerate([0] * 50 + [63] * 2 + [64] * 2):
        state = pipeline.push_scan(
            scan_at(number / 50, 20 + above * (np.arange(64) == 9))
        )
        assert (state.reading.pressure[9] >= state.contact) == (above == 64)


def test_model_does_not_decide_what_is_a_fault():
    masks = []
    for on in (0.7, 20.0):
        contacts = ContactConfig(on=on, off=0.5)
        pipeline = TouchPipeline(MOUNTED, DIVIDER, PipelineConfig(contacts=contacts))
        rng = np.random.default_rng(2)
        for number in range(300):
            counts = 200 + rng.integers(-1, 2, 64)
            counts[9] += 150 * (-1) ** number
            pipeline.push_scan(scan_at(number / 50, counts))
        masks.append(pipeline.front_end.mask)
    assert masks[0][9]
    np.testing.assert_array_equal(*masks)
