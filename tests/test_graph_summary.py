"""What a touch is as a whole, in the units that people feel."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.graph import (
    HISTORY,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compress_shear,
    compute_node_scalars,
)
from eskin.graph.summary_kernels import AREA, FORCE, HISTORY_FLOORS, RATE, SPEED
from helpers.graphs import (
    SCENES,
    book,
    bump,
    double,
    flat,
    orthogonal,
    pressure_summary,
    rolled,
    scene,
    shear_summary,
    shuffled,
    stroke_on_grid,
    turned,
)

every_scene = pytest.mark.parametrize("name", SCENES)


def feature(batch, name):
    """One column of the summary."""
    return pressure_summary(batch)[:, PRESSURE_SUMMARY.index(name)]


def shear_feature(batch, name):
    return shear_summary(batch)[:, SHEAR_SUMMARY.index(name)]


def test_every_feature_has_its_column():
    batch = SCENES["a press on the seam of two patches"](True).graphs()
    assert pressure_summary(batch).shape == (batch.count, len(PRESSURE_SUMMARY))
    assert shear_summary(batch).shape == (batch.count, len(SHEAR_SUMMARY))


def test_force_area_and_rates_are_in_newton_and_cm2():
    mounted = flat(pitch=0.02)
    load = np.where(bump(mounted.skin, (0, 0, 0), radius=0.021) > 0, 50.0, 0.0)
    batch = scene(mounted, [load, 2 * load, load], step=0.1).graphs()
    force = 5 * 50e3 * 4e-4
    np.testing.assert_allclose(
        np.expm1(feature(batch, "force")) * FORCE, [force, 2 * force, force], rtol=1e-4
    )
    np.testing.assert_allclose(
        np.expm1(feature(batch, "area")) * AREA, [20.0] * 3, rtol=1e-4
    )
    np.testing.assert_allclose(
        np.expm1(feature(batch, "loading rate")) * RATE,
        [force / 0.5, force / 0.1, 0.0],
        rtol=1e-3,
    )
    np.testing.assert_allclose(
        np.expm1(feature(batch, "unloading rate")) * RATE, [0, 0, 10 * force], rtol=1e-3
    )
    above = [feature(batch, f"area above {level} kPa")[1] for level in (20, 50, 90)]
    np.testing.assert_allclose(np.expm1(above) * AREA, [20.0] * 3, rtol=1e-4)
    assert feature(batch, "area above 50 kPa")[0] == 0.0


def test_the_summary_ends_with_the_logarithms_of_the_history():
    batch = SCENES["a press on the seam of two patches"]().graphs()
    rng = np.random.default_rng(0)
    history = rng.uniform(0, 9, batch.history.shape).astype(np.float32)
    found = pressure_summary(replace(batch, history=history))[:, -len(HISTORY) :]
    assert PRESSURE_SUMMARY[-len(HISTORY) :] == HISTORY
    np.testing.assert_allclose(
        np.expm1(found) * HISTORY_FLOORS, history, rtol=1e-4, atol=1e-4
    )
    without = pressure_summary(batch)
    assert not without[:, -len(HISTORY) :].any()
    rest = slice(None, -len(HISTORY))
    changed = pressure_summary(replace(batch, history=history))
    np.testing.assert_array_equal(changed[:, rest], without[:, rest])


def test_length_breadth_and_depth_are_those_of_the_load():
    mounted = flat(rows=9, columns=21)
    p = mounted.skin.positions
    load = np.where((abs(p[:, 0]) < 0.045) & (abs(p[:, 1]) < 0.015), 20.0, 0.0)
    batch = scene(mounted, [load]).graphs()
    found = [feature(batch, name)[0] for name in ("length", "breadth", "depth")]
    x, y = p[load > 0][:, :2].T * 100
    np.testing.assert_allclose(found, [x.std(), y.std(), 0.0], atol=0.02)


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("where", [flat, rolled])
def test_a_stroke_has_about_the_speed_of_the_hand(speed, where):
    """Along the tube's axis, or along the grid."""
    mounted = where(rows=21, columns=9)
    axis = 2 if where is rolled else 1
    start = np.array([0.03 if where is rolled else 0.0, 0.0, 0.0])
    places = np.linspace(-0.06, 0.06, 13)
    loads = [bump(mounted.skin, start + np.eye(3)[axis] * y) for y in places]
    batch = scene(mounted, loads, step=0.01 / speed).graphs()
    found = np.expm1(feature(batch, "speed")) * SPEED
    assert found[0] == 0.0
    np.testing.assert_allclose(found[2:-2], 100 * speed, rtol=0.1)


def test_a_faster_stroke_is_faster_whatever_the_rate_of_readings():
    speeds = [feature(stroke_on_grid(speed=v).graphs(), "speed")[5] for v in (0.1, 0.3)]
    assert speeds[1] > speeds[0] + 0.5


def test_a_load_that_rides_on_a_moving_link_has_no_speed():
    mounted = book()
    load = bump(mounted.skin, (0.05, 0, -0.01))
    qs = np.linspace(0.0, 1.0, 6)[:, None]
    batch = scene(mounted, [load] * 6, qs).graphs()
    np.testing.assert_allclose(feature(batch, "speed"), 0.0, atol=1e-5)
    dragged = scene(mounted, [load] * 6, qs, shear=True).graphs()
    along = shear_feature(dragged, "shear along the motion")
    np.testing.assert_allclose(along, 0.0, atol=1e-12)


def test_a_load_that_appears_or_goes_has_no_speed():
    mounted = flat()
    load = bump(mounted.skin, (0.02, 0.01, 0))
    batch = scene(mounted, [load, 0 * load, load]).graphs()
    assert feature(batch, "speed").tolist() == [0.0, 0.0, 0.0]


def test_normals_agree_on_a_flat_patch_and_disagree_around_a_tube():
    """The same pressure image: what a deformed patch could not tell (the paper)."""
    sheet, tube = flat(rows=9, columns=15), rolled()
    image = np.where(abs(sheet.skin.positions[:, 1]) < 0.025, 20.0, 0.0)
    laid, wrapped = (scene(m, [image]).graphs() for m in (sheet, tube))
    assert np.array_equal(np.sort(laid.pressure), np.sort(wrapped.pressure))
    assert feature(laid, "agreement of normals")[0] == pytest.approx(1.0)
    assert feature(wrapped, "agreement of normals")[0] < 0.5
    assert feature(wrapped, "depth")[0] > 1.0 > feature(laid, "depth")[0] + 0.99


def test_shear_of_a_drag_a_pinch_and_a_twist_are_told_apart():
    mounted = flat()
    p = mounted.skin.positions[:, :2]
    load = bump(mounted.skin, (0, 0, 0), radius=0.035)
    outward = p / (np.linalg.norm(p, axis=1, keepdims=True) + 1e-9)
    around = outward @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    ahead = np.tile([1.0, 0.0], (len(p), 1))
    found = {}
    for name, field in {"drag": ahead, "spread": outward, "twist": around}.items():
        touch = scene(mounted, [load])
        drag = (0.5 * load[:, None] * field).astype(np.float32)
        reading = replace(touch.readings[0], shear=drag)
        batch = replace(touch, readings=(reading,)).graphs()
        found[name] = [
            float(shear_feature(batch, f)[0])
            for f in ("agreement of shear", "divergence", "curl")
        ]
    assert found["drag"][0] > 0.9 > 0.1 > max(map(abs, found["drag"][1:]))
    assert found["spread"][1] > 0.6 > 0.1 > max(found["spread"][0], found["spread"][2])
    assert found["twist"][2] > 0.6 > 0.1 > max(map(abs, found["twist"][:2]))


@every_scene
@pytest.mark.parametrize("sign", [1, -1])
def test_features_are_the_same_in_float64_to_the_last_digits(name, sign):
    rng = np.random.default_rng(1)
    batch = double(SCENES[name](True).graphs())
    other = turned(batch, orthogonal(rng, sign), (2.0, 3.0, -4.0))
    for features in (pressure_summary, shear_summary, compute_node_scalars):
        assert features(batch).dtype == np.float64
        np.testing.assert_allclose(features(other), features(batch), atol=1e-10)
    for features in (pressure_summary, shear_summary):
        found = features(shuffled(batch, rng))
        np.testing.assert_allclose(found, features(batch), atol=1e-10)


@every_scene
def test_features_are_the_same_in_float32_after_a_motion(name):
    batch = SCENES[name](True).graphs()
    other = turned(batch, orthogonal(np.random.default_rng(2), 1))
    for features in (pressure_summary, shear_summary, compute_node_scalars):
        np.testing.assert_allclose(features(other), features(batch), atol=1e-4)


def test_compressed_vectors_keep_their_direction_and_their_order():
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = np.geomspace(1e-6, 1e4, 50)
    found = compress_shear(directions * sizes[:, None])
    lengths = np.linalg.norm(found, axis=1)
    np.testing.assert_allclose(found, lengths[:, None] * directions, atol=1e-12)
    assert (np.diff(lengths) > 0).all()
    assert lengths[-1] < 5.0
    assert not compress_shear(np.zeros((2, 3))).any()


@pytest.mark.parametrize("kpa", [1e-3, 1.0, 500.0])
def test_node_scalars_stay_of_order_one(kpa):
    mounted = flat()
    loads = [k * bump(mounted.skin, (0, 0, 0), kpa=kpa) for k in (0.1, 1.0, 0.0)]
    scalars = compute_node_scalars(scene(mounted, loads, shear=True).graphs())
    assert np.abs(scalars).max() < 4.0
