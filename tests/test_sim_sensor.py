"""These tests check the laws of the simulated sensor as a whole."""

from dataclasses import fields, replace

import numpy as np
import pytest

from eskin.sim.sensor.build import build_nominal_sensor, draw_build
from eskin.sim.sensor.model import SensorStages
from eskin.sim.sensor.sensor import sense
from eskin.touch import FrontEnd
from helpers.sensors import (
    CONSTANTS,
    ELEMENT_STAGES,
    NO_STAGES,
    SKIN,
    TAXEL,
    change_build,
    read_conductance,
    read_counts,
    step_load,
)
from helpers.touch import scan_at

TAXELS = np.array([7, 8, 13, TAXEL, 50])
ALL_TAXELS = np.arange(SKIN.count)
WAVES = np.clip(np.sin(np.linspace(-1, 8, 120)), 0, 1)[:, None]
PRESSURE = WAVES * np.array([4.0, 12.0, 30.0, 8.0, 60.0])
BUILD = draw_build("b", "shifted", SKIN, CONSTANTS, np.random.default_rng(5))
WORKING = SensorStages(noise=False, faults=False, ghosting=False)
ZERO = np.zeros(SKIN.count)
ONE = np.ones(SKIN.count)

STEADY = {"walk": 0.0, "after": 0.0}
NEUTRAL = {
    "bending": {"velostat": {"bend": ZERO}},
    "threshold": {"velostat": {"activation": ZERO}},
    "hysteresis": {"velostat": {"play_widths": np.zeros(4)}},
    "power": {"velostat": {"exponent": ONE}},
    "creep": {"velostat": {"creep": np.zeros((SKIN.count, 3))}},
    "gain": {"velostat": {"gain": ONE, "session_gain": (0.0, 0.0)}},
    "drift": {"velostat": {"temperature": 0.0}, "electronics": STEADY},
    "ghosting": {"electronics": {"ghost": 0.0, "leak": 0.0}},
    "noise": {"electronics": {"noise": 0.0, "noise_relative": 0.0}},
    "skew": {"electronics": {"phase": np.zeros(2), "scan": 0.0, "jitter": 0.0}},
    "faults": {"defects": {"dead": ZERO > 0, "stuck": ZERO + np.nan, "dropped": 0.0}},
}
"""Fields of a build with which a stage has no effect."""


def sense_build(build=BUILD, stages=None, pressure=PRESSURE, taxels=TAXELS, lead=0):
    rng = np.random.default_rng(3)
    return sense(pressure, taxels, build, SKIN, rng, stages, lead=lead)


STAGES = [
    field.name
    for field in fields(SensorStages)
    if field.name not in ("divider", "proximity")
]


@pytest.mark.parametrize("stage", STAGES)
def test_stage_that_is_off_does_nothing(stage):
    off, received = sense_build(stages=SensorStages(**{stage: False}))
    neutral, also = sense_build(change_build(BUILD, **NEUTRAL[stage]))
    np.testing.assert_array_equal(off, neutral)
    np.testing.assert_array_equal(received, also)
    on, some = sense_build()
    assert (on != off).any() or (some != received).any()


def test_counts_without_stages_are_proportional_to_pressure():
    counts, received = sense_build(stages=NO_STAGES)
    full = BUILD.electronics.full_scale
    x = np.zeros((60, SKIN.count))
    x[:, TAXELS] = PRESSURE[::2] / BUILD.velostat.half_pressure
    rest = full * BUILD.electronics.base
    assert received.all()
    np.testing.assert_allclose(counts, np.clip(full * x + rest, 0, full), atol=0.6)
    # With x above its free reading, a divider gives x / (1 + x).
    divided, _ = sense_build(stages=replace(NO_STAGES, divider=True))
    expected = full * x / (1 + x) + rest
    np.testing.assert_allclose(divided[:, 7], expected[:, 7], atol=2)


def test_pat_reads_a_quarter_less_than_a_press_of_the_same_force():
    pat = 20.0 * np.clip(np.sin(np.pi * np.arange(14) / 13), 0.0, 1.0) ** 1.5
    short = read_conductance(np.concatenate([np.zeros(10), pat, np.zeros(20)])).max()
    long = read_conductance(step_load(20.0, 0.8)).max()
    assert short / long == pytest.approx(0.725, abs=0.03)


def test_second_of_two_equal_pats_reads_more():
    pats = [step_load(20.0, 0.13), step_load(20.0, 0.13, before=0.15, after=0.1)]
    g = read_conductance(np.concatenate(pats))
    assert 1.05 < g[19:].max() / g[:19].max() < 1.10


def test_calibration_reads_the_true_pressure_of_a_nominal_taxel():
    build = build_nominal_sensor(SKIN, CONSTANTS)
    stages = replace(ELEMENT_STAGES, threshold=True)
    counts = read_counts(step_load(20.0, 1.1, before=3.0), build, stages)
    front_end = FrontEnd(SKIN, build.calibration(SKIN))
    # Neighbours are pressed as much: a taxel that steps alone is faulty.
    near = np.abs(ALL_TAXELS - TAXEL) <= 1
    scans = [
        scan_at(number * 0.02, np.where(near, count, 0))
        for number, count in enumerate(counts[:201])
    ]
    pressure = [front_end.make_reading(scan).pressure for scan in scans][-1]
    assert pressure[near] == pytest.approx(20.0, rel=0.02)
    assert not pressure[~near].any()


def test_hysteresis_forgets_a_touch_that_is_over():
    firm = np.full(50, 60.0)
    pause = np.zeros(20)
    light = np.concatenate([np.arange(1, 21.0), np.arange(20, 5.0, -1)])
    stages = replace(ELEMENT_STAGES, creep=False)
    after = read_conductance(np.concatenate([firm, pause, light]), stages)
    alone = read_conductance(np.concatenate([pause, light]), stages)
    np.testing.assert_allclose(after[25:], alone, rtol=1e-6)


def test_readings_of_a_patch_are_dropped_together_in_runs():
    lossy = change_build(BUILD, defects={"dropped": 0.1})
    counts, received = sense_build(lossy, pressure=np.zeros((20000, 5)))
    assert not counts[~received].any()
    by_patch = received[:, [0, 36]]
    np.testing.assert_array_equal(received, by_patch[:, SKIN.patch_index])
    lost = ~by_patch
    assert lost.mean() == pytest.approx(0.1, abs=0.02)
    runs = np.diff(lost.astype(int), axis=0, prepend=0) > 0
    assert lost.sum() / runs.sum() == pytest.approx(3.0, rel=0.2)


def test_rows_and_patches_are_scanned_one_after_the_other():
    timing = {"phase": np.array([0.005, 0.015]), "scan": 0.012, "jitter": 0.0}
    build = change_build(BUILD, electronics=timing)
    rising = np.repeat(np.linspace(0, 20, 200)[:, None], SKIN.count, axis=1)
    counts, _ = sense_build(build, replace(NO_STAGES, skew=True), rising, ALL_TAXELS)
    above = counts[-1] - build.electronics.base * build.electronics.full_scale
    assert (np.diff(above[:36].reshape(6, 6)[:, 0]) > 0).all()
    assert (above[:36] > above[36:]).all()


def test_baseline_shift_after_a_touch_decays_and_is_smaller_after_a_light_one():
    steady = change_build(BUILD, electronics={"walk": 0.0, "bits": 20})
    stages = replace(WORKING, threshold=False)
    shifts = []
    for kpa in (0.5, 100.0):
        series = np.zeros((1200, 1))
        series[50:150] = kpa
        counts = sense_build(steady, stages, series, TAXELS[3:4])[0][:, TAXEL]
        shifts.append(abs(counts[[80, -1]] - counts[0]))
        assert shifts[-1][1] < shifts[-1][0] / 4
    assert 0 < shifts[0][0] < 0.5 * shifts[1][0]
