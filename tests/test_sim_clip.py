"""Clips and streams: the touch, the counts and the truth belong together."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from eskin.sim.contact.press import ContactPads, Press, SoftTissue, TrueTouch
from eskin.sim.dataset import ClipPlan, get_build
from eskin.sim.dataset.clip import make_clip
from eskin.sim.dataset.plan import BuildOrigin, Origin
from eskin.sim.dataset.staging import draw_accident, draw_start, set_up_clip
from eskin.sim.scene.scene import find_contact_steps, shift_touch
from eskin.sim.scene.validity import find_self_contact_sites
from helpers.worlds import world

PLAN = ClipPlan(
    set_name="test",
    seed=(1, 0),
    person=Origin("p", (2, 0)),
    company=Origin("q", (2, 1)),
    build=BuildOrigin("b", (3, 0), "fresh"),
    session=Origin("s", (4, 0)),
    at=0.0,
    seconds=2.0,
    gesture="poke",
    kind=None,
    groups=tuple(range(1, 13)),
    pose=None,
    moving=False,
    fold_share=0.0,
    concurrent=0.0,
    difficulty=1.5,
    regime="paper",
)
GESTURES = ("poke", "double_pat", "grab", "stroke")


def clip_of(number=0, **changes):
    return make_clip(replace(PLAN, seed=(1, number), **changes), world())


def clips(count, **changes):
    return [clip_of(number, **changes) for number in range(count)]


@pytest.mark.parametrize("moving", [False, True])
def test_the_same_plan_gives_the_same_bytes(moving):
    one, other = (clip_of(3, moving=moving, fold_share=0.5) for _ in range(2))
    for name in ("counts", "received", "q"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert one.drawn == other.drawn


def test_a_clip_is_as_long_as_planned_and_counts_every_taxel():
    clip = clip_of()
    count = world().mounted.skin.count
    assert clip.counts.shape == clip.received.shape == (100, count)
    assert clip.q.shape == (100, 6)
    assert clip.counts.min() >= 0


@pytest.mark.parametrize("gesture", GESTURES)
def test_what_is_felt_is_felt_where_and_when_it_truly_is(gesture):
    near = []
    for clip in clips(10, gesture=gesture):
        (truth,) = clip.truths
        calibration = get_build(PLAN.build, world()).calibration(world().mounted.skin)
        rest = np.median(clip.counts, axis=0)
        felt = calibration.compute_pressure(clip.counts - rest) * clip.received
        felt[:, felt.mean(axis=0) > 5.0] = 0.0  # stuck taxels
        reading, taxel = np.unravel_index(felt.argmax(), felt.shape)
        if felt[reading, taxel] < 10.0:
            continue
        around = truth.force[max(0, reading - 2) : reading + 3]
        assert around.max() > 0
        p_world, _ = world().mounted.place_taxels(clip.q[reading])
        at = truth.centroid[max(0, reading - 2) : reading + 3][around > 0]
        near.append(np.linalg.norm(at - p_world[taxel], axis=1).min())
    assert len(near) >= 3
    # A hand is that large.
    assert max(near) < 0.14


def test_onset_and_end_frame_the_force():
    for clip in clips(8, gesture="double_pat"):
        (truth,) = clip.truths
        pressed = np.flatnonzero(truth.force) * 0.02
        assert truth.onset - 0.02 < pressed[0]
        assert pressed[-1] < truth.end


def test_a_bump_of_one_step_is_in_the_truth():
    for clip in clips(20, gesture="none", kind="bump"):
        assert clip.truths[0].force.max() > 0


def test_no_gesture_takes_place_beside_a_touch_that_is_none():
    for clip in clips(25, gesture="none", kind="resting_hand", concurrent=1.0):
        assert {truth.gesture for truth in clip.truths} == {"none"}


def test_a_second_touch_is_the_smaller_and_apart():
    pairs = [clip.truths for clip in clips(25, gesture="grab", concurrent=1.0)]
    two = [truths for truths in pairs if len(truths) == 2]
    assert len(two) > 10
    for first, second in two:
        assert 0 < second.force.sum() < 1.05 * first.force.sum()


@pytest.mark.parametrize("kind", ["idle", "electrical"])
def test_nothing_touches_in_a_clip_without_contact(kind):
    assert clip_of(gesture="none", kind=kind).truths == ()


def test_an_electrical_event_is_in_the_counts_and_in_what_was_drawn():
    quiet = clip_of(4, gesture="none", kind="idle")
    event = clip_of(4, gesture="none", kind="electrical")
    assert any(name.startswith("electrical.") for name in event.drawn)
    assert not any(name.startswith("electrical.") for name in quiet.drawn)


def test_a_robot_that_moves_moves_and_one_that_stands_stands():
    assert np.ptp(clip_of(moving=False).q, axis=0).max() == 0
    assert np.ptp(clip_of(moving=True).q, axis=0).max() > 1e-3


def test_in_a_stream_touches_follow_each_other_after_pauses():
    clip = clip_of(gesture=None, seconds=30.0, moving=True)
    assert len(clip.counts) == 1500
    assert len(clip.truths) >= 3
    alone = [t for t in clip.truths if t.gesture != "none" or t.kind != "guiding"]
    spans = sorted((truth.onset, truth.end) for truth in alone)
    assert spans[0][0] > 0 and spans[-1][1] < 30.0
    assert all(start < end for start, end in spans)


@pytest.mark.parametrize("moving", [False, True])
def test_a_stream_of_accidents_has_nothing_but_accidents(moving):
    kinds = set()
    for number in range(4):
        clip = clip_of(
            number, gesture=None, kind="accidents", seconds=30.0, moving=moving
        )
        assert len(clip.truths) >= 3
        assert {truth.gesture for truth in clip.truths} == {"none"}
        kinds |= {truth.kind for truth in clip.truths}
    assert kinds <= set(world().constants.weights("stream.accidents"))
    assert not kinds & {"press", "single_pat", "squeeze_hold", "guiding"}


def test_links_press_on_each_other_where_a_stream_of_accidents_stands_folded():
    seen = set()
    for number in range(8):
        plan = replace(PLAN, seed=(1, number), gesture=None, kind="accidents")
        stage = set_up_clip(plan, "accidents", world(), plan.rng())
        touching = bool(find_self_contact_sites(world(), stage.q[0]))
        kinds = {draw_accident(stage, 0) for _ in range(100)}
        assert ("self_contact" in kinds) == touching
        seen.add(touching)
    assert seen == {False, True}


@pytest.mark.parametrize("moving", [False, True])
def test_nothing_touches_in_a_quiet_stream_but_electrical_events_come_by_the_hour(
    moving,
):
    """A minute at sixty times the rate has as many as an hour."""
    plan = replace(PLAN, gesture=None, kind="quiet", seconds=60.0, moving=moving)
    clip = make_clip(plan, world_of_many_events())
    assert clip.truths == () and len(clip.counts) == 3000
    events = [name for name in clip.drawn if name.endswith(".electrical")]
    assert 10 <= len(events) <= 40
    onsets = [clip.drawn[name.replace(".electrical", ".onset")] for name in events]
    assert min(onsets) < 1000 and max(onsets) > 2000
    assert bool(np.ptp(clip.q, axis=0).max() > 1e-3) == moving


@lru_cache(maxsize=1)
def world_of_many_events():
    constants = world().constants.scaled({"stream.electrical": 60.0})
    return replace(world(), constants=constants)


def steady(steps, first=0):
    """A touch of even force on the first chart."""
    one = np.ones(1)
    stamps = ContactPads(
        np.zeros((1, 2)), np.full((1, 2), 0.01), 0 * one, 1e-4 * one, 2e-4 * one, one
    )
    force = np.concatenate([[0.0], np.full(steps, 3.0), [0.0]])
    centre = np.zeros((len(force), 2))
    flesh = SoftTissue(190.0, 2100.0, 1.0, 0.4, 0.8)
    press = Press(0, first, stamps, flesh, force, centre, np.zeros(len(force)))
    return TrueTouch("poke", "one_tip", "p", (press,), {})


def test_at_least_the_stated_share_of_every_contact_lies_in_its_clip():
    constants, rng = world().constants, np.random.default_rng(0)
    inside = constants.value("clip.inside")
    cut = 0
    for _ in range(400):
        length = int(rng.integers(5, 190))
        touch = shift_touch(
            steady(length), draw_start(steady(length), 200, constants, rng)
        )
        first, end = find_contact_steps(touch)
        seen = min(end, 200) - max(first, 0)
        assert seen >= inside * length - 1
        cut += seen < length
    assert 0.05 < cut / 400 < 0.25


def test_a_touch_longer_than_its_clip_begins_before_it_or_ends_after_it():
    constants, rng = world().constants, np.random.default_rng(0)
    for _ in range(100):
        touch = steady(350)
        first, end = find_contact_steps(
            shift_touch(touch, draw_start(touch, 200, constants, rng))
        )
        assert min(end, 200) - max(first, 0) >= 0.6 * 200 - 1
        assert first < 0 or end > 200
