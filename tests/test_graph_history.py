"""What a touch has been so far: the same wherever the robot stands."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.graph import HISTORY, NO_HISTORY, GraphStream, join_graphs
from eskin.touch import Calibration, TouchPipeline
from helpers.graphs import (
    Scene,
    bump,
    flat,
    mirrored,
    motion,
    moved,
    press_in_book,
    renumbered,
    rolled,
    scene,
    touch_on_arm,
)

STEP = 0.05


def streamed(touch: Scene):
    """The graphs of each sequence, through the touches of the scene."""
    calibration = Calibration.uniform(touch.mounted.skin.count, 1000, 100.0)
    pipeline = TouchPipeline(touch.mounted, calibration)
    stream, found = GraphStream(touch.mounted), {}
    for reading in touch.readings:
        for key, graph in stream.push(pipeline.push_reading(reading)).items():
            found.setdefault(key, []).append(graph)
    return {key: join_graphs(graphs) for key, graphs in found.items()}


def columns(touch: Scene):
    """Each column of the history of a scene of one touch, by its name."""
    [graphs] = streamed(touch).values()
    return dict(zip(HISTORY, graphs.history.T, strict=True))


def stroke(speed=0.2, kpa=30.0, step=STEP, mounted=None) -> Scene:
    """A load that goes along a grid and half the way back."""
    mounted = mounted or flat(rows=7, columns=25)
    there = np.arange(0.0, 0.121, speed * step)
    x = np.concatenate([there, there[-2 : len(there) // 2 : -1]]) - 0.06
    loads = [bump(mounted.skin, (at, 0.003, 0), kpa) for at in x]
    return scene(mounted, loads, step=step)


def pats(pattern, step=STEP) -> Scene:
    """A load on the same place in some readings and not in others."""
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    return scene(mounted, [on * load for on in pattern], step=step)


def test_age_and_pause_are_times_since_onset_and_since_the_last_contact():
    found = columns(pats([1, 1, 0, 0, 1, 0]))
    np.testing.assert_allclose(found["age"], STEP * np.arange(6), atol=1e-6)
    np.testing.assert_allclose(
        found["pause"], STEP * np.array([0, 0, 1, 2, 0, 1]), atol=1e-6
    )


def test_contacts_count_the_pats():
    found = columns(pats([1, 1, 0, 0, 1, 0, 0, 0, 1, 1]))
    assert found["contacts"].tolist() == [1, 1, 1, 1, 2, 2, 2, 2, 3, 3]


def test_a_flicker_of_one_reading_is_no_new_contact():
    found = columns(pats([1, 1, 0, 1, 1], step=0.02))
    assert found["contacts"].tolist() == [1] * 5


def test_travel_is_the_distance_from_where_it_began_and_farthest_keeps_the_most():
    found = columns(stroke())
    turn = int(found["travel"].argmax())
    assert found["travel"][0] == 0.0
    assert found["travel"][turn] == pytest.approx(12.0, abs=0.3)
    assert found["travel"][-1] == pytest.approx(6.0, abs=1.5)
    np.testing.assert_allclose(
        found["farthest"], np.maximum.accumulate(found["travel"]), rtol=1e-6
    )


def test_impulse_and_peak_force_are_in_newton_seconds_and_newton():
    mounted = flat(pitch=0.02)
    load = np.where(bump(mounted.skin, (0, 0, 0), radius=0.021) > 0, 50.0, 0.0)
    force = 5 * 50e3 * 4e-4
    found = columns(scene(mounted, [load, load, 2 * load, load, 0 * load], step=STEP))
    np.testing.assert_allclose(
        found["peak force"], force * np.array([1, 1, 2, 2, 2]), rtol=1e-5
    )
    # The first reading knows nothing of the time before it.
    np.testing.assert_allclose(
        np.diff(found["impulse"]),
        force * STEP * np.array([1, 1.5, 1.5, 0.5]),
        rtol=1e-4,
    )


def two_touches() -> Scene:
    mounted = flat(columns=30)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.015) for x in (-0.13, 0.13))
    return scene(mounted, [left, left, left + right, left + 2 * right], step=STEP)


def test_each_touch_has_its_own_history():
    left, right = streamed(two_touches()).values()
    assert left.history[:, 0].tolist() == pytest.approx([0, 0.05, 0.1, 0.15])
    assert right.history[:, 0].tolist() == pytest.approx([0, 0.05])
    peak = HISTORY.index("peak force")
    assert right.history[-1, peak] == pytest.approx(2 * left.history[-1, peak])


def test_what_one_touch_does_is_not_counted_of_another():
    mounted = flat(columns=40)
    pat = bump(mounted.skin, (-0.17, 0, 0), radius=0.015)
    loads = [
        on * pat + bump(mounted.skin, (x, 0, 0), radius=0.015)
        for on, x in zip((1, 0, 0, 1, 0, 0, 1), 0.02 * np.arange(7), strict=True)
    ]
    pats, moving = streamed(scene(mounted, loads, step=STEP)).values()
    contacts, farthest = HISTORY.index("contacts"), HISTORY.index("farthest")
    assert pats.history[-1, contacts] == 3
    assert moving.history[-1, contacts] == 1
    assert pats.history[-1, farthest] < 1 < 11 < moving.history[-1, farthest]


def test_a_touch_that_comes_after_another_begins_anew():
    pause = [0] * 13
    [first, second] = streamed(pats([1, 1, 0, 0, 1, *pause, 1, 1])).values()
    # As the first one did, but for the reading before it.
    impulse = HISTORY.index("impulse")
    others = [n for n in range(len(HISTORY)) if n != impulse]
    np.testing.assert_allclose(
        second.history[:2, others], first.history[:2, others], atol=1e-6
    )


def test_a_skin_whose_distances_mean_nothing_has_no_history():
    touch = pats([1, 1, 0, 1])
    nominal = replace(touch.mounted.skin, calibrated=False)
    mounted = type(touch.mounted)(nominal, touch.mounted.robot)
    [graphs] = streamed(Scene(mounted, touch.readings)).values()
    assert graphs.history.shape == (4, len(HISTORY))
    assert not graphs.history.any()
    assert not NO_HISTORY.any()


SCENES = {
    "a stroke on a grid": stroke,
    "a stroke round a tube": lambda: stroke(mounted=rolled(rows=25)),
    "pats": lambda: pats([1, 1, 0, 0, 1, 0, 1]),
    "two touches": two_touches,
    "a hand between patches on two links": press_in_book,
    "a hand on two links of the moving ur5": touch_on_arm,
}
CHANGES = {
    "moved": lambda touch: moved(touch, motion(3)),
    "mirrored": mirrored,
    "renumbered": renumbered,
    "mirrored and moved": lambda touch: moved(mirrored(touch), motion(4)),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("change", CHANGES)
def test_the_history_is_the_same_wherever_the_robot_stands(name, change):
    touch = SCENES[name]()
    one, other = streamed(touch), streamed(CHANGES[change](touch))
    histories = [
        [graphs.history for graphs in found.values()] for found in (one, other)
    ]
    assert sum(history.any() for history in histories[0])
    # Touches that begin at one reading may be numbered otherwise.
    for parts in histories:
        parts.sort(key=lambda history: (len(history), *history[-1]))
    for before, after in zip(*histories, strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("step", [0.005, 0.02, 0.05, 0.1])
def test_steady_contact_is_one_contact_at_any_rate(step):
    found = columns(pats([1] * 6, step=step))
    assert found["contacts"].tolist() == [1] * 6
