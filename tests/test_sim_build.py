"""Laws of the builds that are drawn."""

from dataclasses import asdict

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import build_nominal_sensor, draw_build, find_line_taxels
from eskin.sim.sensor.velostat import count_steps_from_edge
from eskin.touch import Calibration
from helpers.touch import build_grid_skin

CONSTANTS = load_constants()
SKIN = build_grid_skin(12, 12, patches=6)


def drawn(kind="fresh", seed=1, constants=CONSTANTS, name="b"):
    return draw_build(name, kind, SKIN, constants, np.random.default_rng(seed))


def test_the_same_seed_draws_the_same_build():
    one, two = drawn(), drawn()
    np.testing.assert_equal(asdict(one), asdict(two))
    assert drawn(seed=2).velostat.half_pressure != one.velostat.half_pressure


def test_taxels_scatter_about_their_patch_as_asked():
    for kind in ("fresh", "shifted"):
        gains = np.log([drawn(kind, seed).velostat.gain for seed in range(20)])
        by_patch = gains.reshape(20, 6, 144)
        inside = by_patch.std(axis=2).mean()
        assert inside == pytest.approx(
            CONSTANTS.value(f"sensor.gain_taxel.{kind}"), rel=0.05
        )
        between = by_patch.mean(axis=2).std()
        assert between == pytest.approx(
            CONSTANTS.value(f"sensor.gain_patch.{kind}"), rel=0.2
        )


def test_shifted_builds_are_worse_than_fresh_ones():
    def means(kind):
        builds = [drawn(kind, seed).electronics for seed in range(10)]
        broken = [drawn(kind, seed).defects.dead.mean() for seed in range(10)]
        return np.array(
            [
                np.mean([b.ghost for b in builds]),
                np.mean([b.leak for b in builds]),
                np.mean(broken),
            ]
        )

    assert (means("shifted") > 2 * means("fresh")).all()


def test_bent_taxels_lie_at_the_edges_of_their_patches():
    bend = drawn().velostat.bend
    bent = bend > 0
    assert 0.04 < bent.mean() < 0.11
    assert (count_steps_from_edge(SKIN)[bent] == 0).all()
    assert bend.max() <= 3.0


def test_a_dead_line_is_dead_and_named():
    constants = CONSTANTS.scaled({"sensor.dead_line.shifted": 10.0})
    build = drawn("shifted", constants=constants)
    assert len(build.defects.lines) == 6
    for line in build.defects.lines:
        inside = find_line_taxels(line, SKIN)
        assert inside.sum() == 12
        assert build.defects.dead[inside].all()


def test_a_calibration_knows_the_converter_and_no_single_taxel():
    build = drawn("shifted")
    calibration = build.calibration(SKIN)
    assert calibration.full_scale == 2**build.electronics.bits - 1
    assert np.unique(calibration.gain).size == 1
    assert calibration.curve == "divider"
    again = Calibration.from_bytes(calibration.to_bytes())
    assert (again.curve, again.exponent) == ("divider", calibration.exponent)
    assert (
        calibration.exponent == build_nominal_sensor(SKIN, CONSTANTS).nominal_exponent
    )


def test_scaling_a_constant_scales_the_build():
    half = drawn(constants=CONSTANTS.scaled({"sensor.half_pressure.fresh": 2.0}))
    assert half.velostat.half_pressure == pytest.approx(
        2 * drawn().velostat.half_pressure
    )
