"""Laws of the sensor as a whole."""

from dataclasses import fields, replace

import numpy as np
import pytest

from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.model import SensorStages
from eskin.sim.sensor.noise import NOISE_BLOCK
from eskin.sim.sensor.sensor import sense
from helpers.sensors import (
    CONSTANTS,
    ELEMENT,
    NONE,
    SKIN,
    conductance,
    element,
    step_load,
)

TAXELS = np.array([7, 8, 13, 14, 50])


def press(steps=120):
    """Five taxels pressed on and off, each by another amount."""
    force = np.clip(np.sin(np.linspace(-1, 8, steps)), 0, 1)[:, None]
    return force * np.array([4.0, 12.0, 30.0, 8.0, 60.0])


def built(kind="shifted", seed=5):
    return draw_build("b", kind, SKIN, CONSTANTS, np.random.default_rng(seed))


def sensed(build, stages=None, pressure=None, taxels=TAXELS, seed=3, **options):
    pressure = press() if pressure is None else pressure
    rng = np.random.default_rng(seed)
    return sense(pressure, taxels, build, SKIN, rng, stages, **options)


def without(build, stage):
    """The build in which what a stage does has no effect."""
    velostat, electronics, defects = build.velostat, build.electronics, build.defects
    none, one = np.zeros(SKIN.count), np.ones(SKIN.count)
    changes = {
        "bending": {"bend": none},
        "threshold": {"activation": none},
        "hysteresis": {"play_widths": np.zeros(4)},
        "power": {"exponent": one},
        "creep": {"creep": np.zeros((SKIN.count, 3))},
        "gain": {"gain": one, "session_gain": (0.0, 0.0)},
        "drift": {"temperature": 0.0},
    }
    electrical = {
        "ghosting": {"ghost": 0.0, "leak": 0.0},
        "drift": {"walk": 0.0, "after": 0.0},
        "noise": {"noise": 0.0, "noise_relative": 0.0},
        "skew": {"phase": np.zeros(2), "scan": 0.0, "jitter": 0.0},
    }
    broken = {
        "faults": {
            "dead": none.astype(bool),
            "stuck": np.full(SKIN.count, np.nan),
            "dropped": 0.0,
        }
    }
    return replace(
        build,
        velostat=replace(velostat, **changes.get(stage, {})),
        electronics=replace(electronics, **electrical.get(stage, {})),
        defects=replace(defects, **broken.get(stage, {})),
    )


PASSIVE = [field.name for field in fields(SensorStages) if field.name != "divider"]


@pytest.mark.parametrize("stage", PASSIVE)
def test_a_stage_that_is_off_passes_on_what_it_gets(stage):
    build = built()
    off, received = sensed(build, replace(SensorStages(), **{stage: False}))
    neutral, also = sensed(without(build, stage))
    np.testing.assert_array_equal(off, neutral)
    np.testing.assert_array_equal(received, also)
    on, some = sensed(build)
    assert (on != off).any() or (some != received).any()


def test_with_all_stages_off_counts_are_proportional_to_pressure():
    build = built()
    counts, received = sensed(build, NONE)
    electronics = build.electronics
    x = np.zeros((60, SKIN.count))
    x[:, TAXELS] = press()[::2] / build.velostat.half_pressure
    full = electronics.full_scale
    expected = np.clip(full * x + electronics.base * full, 0, full)
    assert received.all()
    np.testing.assert_allclose(counts, expected, atol=0.6)


def test_the_divider_bends_what_would_be_proportional():
    build = built()
    off = sensed(build, NONE)[0] - sensed(build, NONE, 0 * press())[0]
    on = sensed(build, replace(NONE, divider=True))[0]
    on = on - sensed(build, NONE, 0 * press())[0]
    full = build.electronics.full_scale
    x = (off / full)[:, TAXELS[0]]
    np.testing.assert_allclose(on[:, TAXELS[0]], full * x / (1 + x), atol=2)


def test_the_same_seed_gives_the_same_bytes():
    one, two = sensed(built()), sensed(built())
    assert one[0].tobytes() == two[0].tobytes()
    assert one[1].tobytes() == two[1].tobytes()
    assert sensed(built(), seed=4)[0].tobytes() != one[0].tobytes()


def test_taxels_called_active_without_pressure_change_nothing():
    more = np.append(TAXELS, np.setdiff1d(np.arange(SKIN.count), TAXELS))
    padded = np.zeros((120, SKIN.count))
    padded[:, : len(TAXELS)] = press()
    order = np.random.default_rng(0).permutation(SKIN.count)
    counts, received = sensed(built())
    again, also = sensed(built(), pressure=padded[:, order], taxels=more[order])
    np.testing.assert_array_equal(counts, again)
    np.testing.assert_array_equal(received, also)


def test_a_longer_series_begins_with_the_shorter_one():
    long = np.tile(press(), (4, 1))
    assert len(long) > 2 * NOISE_BLOCK
    short = long[:300]
    stages = SensorStages(faults=False)
    np.testing.assert_array_equal(
        sensed(built(), stages, long)[0][:100], sensed(built(), stages, short)[0][:100]
    )


def test_a_lead_is_felt_but_not_read():
    still = element()
    series = step_load(20.0, 1.5)
    whole = conductance(series, still)
    rng = np.random.default_rng(1)
    counts, received = sense(
        series[:, None], np.array([14]), still, SKIN, rng, ELEMENT, lead=60
    )
    x = counts[:, 14] / still.electronics.full_scale
    np.testing.assert_allclose(x / (1 - x), whole[30:], rtol=1e-4)
    assert len(received) == len(counts) == 50


def test_conductance_grows_with_pressure():
    levels = [conductance(step_load(p, 0.5), element())[-1] for p in (1, 5, 20, 80)]
    assert np.all(np.diff(levels) > 0)


def test_faults_are_in_the_counts():
    build = built(seed=8)
    stuck = np.flatnonzero(np.isfinite(build.defects.stuck))
    quiet = SensorStages(noise=False, drift=False, ghosting=False)
    everywhere = np.full((300, SKIN.count), 30.0)
    dead = np.flatnonzero(build.defects.dead)
    defects = replace(build.defects, dropped=0.1, dead=np.arange(SKIN.count) == 3)
    for broken in (build, replace(build, defects=defects)):
        counts, received = sensed(broken, quiet, everywhere, np.arange(SKIN.count))
        full = build.electronics.full_scale
        heard = np.where(received, counts, -1)
        for taxel in stuck:
            value = round(full * float(build.defects.stuck[taxel]))
            assert set(heard[:, taxel]) <= {value, -1}
        for taxel in np.flatnonzero(
            broken.defects.dead & ~np.isfinite(broken.defects.stuck)
        ):
            rest = full * build.electronics.base[taxel]
            assert np.abs(counts[received[:, taxel], taxel] - rest).max() <= 1
    assert len(stuck) + len(dead) > 0


def test_readings_of_a_patch_are_lost_together_in_runs():
    build = built()
    lossy = replace(build, defects=replace(build.defects, dropped=0.1))
    _, received = sensed(lossy, pressure=np.zeros((20000, 5)))
    by_patch = received[:, [0, 36]]
    np.testing.assert_array_equal(received, by_patch[:, SKIN.patch_index])
    lost = ~by_patch
    assert lost.mean() == pytest.approx(0.1, abs=0.02)
    runs = np.diff(lost.astype(int), axis=0, prepend=0) > 0
    assert lost.sum() / runs.sum() == pytest.approx(3.0, rel=0.2)


def test_a_bent_taxel_reads_more_at_rest_and_does_not_wander():
    build = built()
    bend = np.zeros(SKIN.count)
    bend[20] = 30.0
    bent = replace(build, velostat=replace(build.velostat, bend=bend))
    stages = SensorStages(noise=False, drift=False, faults=False, ghosting=False)
    counts, _ = sensed(bent, stages)
    free, _ = sensed(build, stages)
    assert (counts[:, 20] == counts[0, 20]).all()
    assert counts[0, 20] > free[:, 20].max() + 50


def test_rows_are_scanned_one_after_the_other():
    build = built()
    phase = np.array([0.005, 0.015])
    build = replace(
        build,
        electronics=replace(build.electronics, phase=phase, scan=0.012, jitter=0.0),
    )
    rising = np.repeat(np.linspace(0, 20, 200)[:, None], SKIN.count, axis=1)
    stages = replace(NONE, skew=True)
    counts, _ = sensed(build, stages, rising, np.arange(SKIN.count))
    base = build.electronics.base * build.electronics.full_scale
    above = counts[-1] - base
    assert (np.diff(above[SKIN.patch_index == 0].reshape(6, 6)[:, 0]) > 0).all()
    assert (above[:36] > above[36:]).all()


def test_a_touch_leaves_a_shift_that_fades():
    build = built()
    stages = SensorStages(noise=False, faults=False, ghosting=False)
    flat = replace(build, electronics=replace(build.electronics, walk=0.0))
    series = np.zeros((1200, 1))
    series[50:150] = 40.0
    counts, _ = sensed(flat, stages, series, np.array([14]))
    before, soon, late = counts[0, 14], counts[78, 14], counts[-1, 14]
    assert abs(soon - before) > 2
    assert abs(late - before) < abs(soon - before) / 4


def test_a_light_touch_leaves_less_of_a_shift_than_a_firm_one():
    build = built()
    calm = replace(build.electronics, walk=0.0, bits=20)
    flat = replace(build, electronics=calm)
    stages = SensorStages(noise=False, faults=False, ghosting=False, threshold=False)

    def shift(kpa):
        series = np.zeros((200, 1))
        series[50:150] = kpa
        counts, _ = sensed(flat, stages, series, np.array([14]))
        return abs(counts[80, 14] - counts[0, 14])

    assert 0 < shift(0.5) < 0.5 * shift(100.0)


def test_play_forgets_a_touch_that_is_over():
    hard, soft = (
        np.full(50, 60.0),
        np.concatenate([np.arange(1, 21.0), np.arange(20, 5.0, -1)]),
    )
    gap = np.zeros(20)
    stages = replace(ELEMENT, creep=False)
    after = conductance(np.concatenate([hard, gap, soft]), element(), stages)
    alone = conductance(np.concatenate([gap, soft]), element(), stages)
    np.testing.assert_allclose(after[25:], alone, rtol=1e-6)


def test_a_baseline_walks_either_way_as_far_as_it_should():
    build = built()
    calm = replace(build.electronics, walk=1.0, after=0.0)
    quiet = replace(build, electronics=calm)
    counts, _ = sensed(
        quiet, replace(NONE, drift=True), np.zeros((800, 0)), np.zeros(0, int)
    )
    moved = counts[-1] - counts[0]
    assert abs(moved.mean()) < 3 * 20 / np.sqrt(SKIN.count)
    assert moved.std() == pytest.approx(20.0, rel=0.2)


def test_a_higher_reading_is_noisier():
    build = built()
    noisy = replace(build.electronics, noise=1.0, noise_relative=0.02, bits=12)
    build = replace(build, electronics=noisy)
    stages = replace(NONE, noise=True)
    series = np.full((2000, 1), 0.5 * build.velostat.half_pressure)
    counts, _ = sensed(build, stages, series, np.array([14]))
    high, low = counts[:, 14], counts[:, 15]
    assert high.std() == pytest.approx(0.02 * high.mean(), rel=0.1)
    assert low.std() == pytest.approx(np.hypot(1.0, 0.02 * low.mean()), rel=0.15)


def test_what_does_not_belong_together_is_refused_in_one_line():
    build = built()
    with pytest.raises(ValueError, match="names? some taxel twice"):
        sensed(build, taxels=np.array([1, 2, 3, 4, 4]))
    with pytest.raises(ValueError, match="lead is 500"):
        sensed(build, lead=500)
    with pytest.raises(ValueError, match="not finite"):
        sensed(build, pressure=np.full((10, 5), np.nan))
