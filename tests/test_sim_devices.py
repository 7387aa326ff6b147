"""These tests check the set of random devices, and how a device measures."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.recording import find_recordings, read_recording
from eskin.sim.contact.press import Press, SoftTissue, TrueTouch
from eskin.sim.dataset import GenerationSettings, generate, read_index
from eskin.sim.dataset.devices import (
    LONGEST_POKE_TRAVEL,
    DeviceSimulator,
    draw_device,
    measure,
    read_out,
    slide_poke,
)
from eskin.sim.people.person import build_body
from eskin.sim.people.recorded import find_recorded_people, read_recorded_touches

DEVICES = [draw_device(str(number)) for number in range(100)]
STEP = 0.01


def plain(**facts):
    """Return a device of four cells that measures pressure as it is."""
    device = next(d for d in DEVICES if not d.closed and d.skin.count == 4)
    usual = {"gain": 1.0, "lag": 0.0, "binary": 0.0, "full": 50.0, "noise": 0.0}
    return replace(device, **(usual | {"counts": 4095} | facts))


def press(device, seconds=(0.5, 0.8), pressure=10.0, steps=200):
    """Return a pressure on all small cells that begins and ends at once."""
    found = np.zeros((steps, device.fine.count))
    first, end = (round(each / STEP) for each in seconds)
    found[first:end] = pressure
    return found


def test_devices_span_the_ranges_of_sensors():
    pitches = [float(np.sqrt(device.skin.areas[0])) for device in DEVICES]
    assert min(pitches) < 0.004 and max(pitches) > 0.033
    assert {device.reading for device in DEVICES} == {"line", "hold", "own"}
    for part in ("closed", "lag", "binary", "noise"):
        assert 0.05 < np.mean([bool(getattr(each, part)) for each in DEVICES]) < 0.8
    assert all(9 <= device.rate <= 60 for device in DEVICES)


def test_some_devices_have_a_few_large_cells_perhaps_apart():
    large = [device for device in DEVICES if device.has_large_cells]
    assert 0.2 < len(large) / len(DEVICES) < 0.7
    assert any(device.skin.count == 1 for device in large)
    sides = [float(np.sqrt(device.skin.areas[0])) for device in large]
    apart = [device.pitch / side for device, side in zip(large, sides, strict=True)]
    assert max(apart) > 2 and min(apart) == pytest.approx(1.0)
    assert {len(device.skin.patches) == device.skin.count for device in large} == {
        True,
        False,
    }


def test_the_gap_between_two_pads_measures_nothing():
    device = next(
        each
        for each in DEVICES
        if each.inner < each.finer and each.skin.count > 1 and not each.closed
    )
    device = replace(device, gain=1.0, lag=0.0, binary=0.0, full=50.0)
    times = device.finer
    patch = device.fine.patches[0]
    margin = (times - device.inner) // 2
    inside = np.arange(times)
    inside = (inside >= margin) & (inside < margin + device.inner)
    rows = np.tile(inside, patch.rows // times)
    columns = np.tile(inside, patch.columns // times)
    on_pads = np.outer(rows, columns).ravel()
    pressure = np.full((5, device.fine.count), 10.0)
    assert measure(device, pressure * on_pads, STEP) == pytest.approx(10.0)
    assert not measure(device, pressure * ~on_pads, STEP).any()


def test_a_slipping_poke_travels_no_further_than_allowed():
    simulator = DeviceSimulator(DEVICES[0].skin.name)
    site = simulator.draw_site(np.random.default_rng(0))
    force = np.ones(30)
    still = np.tile(np.array(site.centre), (30, 1))
    body = build_body("knuckle", simulator.constants)
    tissue = SoftTissue(1.0, 1.0, 1.0, 1.0, 0.0)
    press = Press(site.chart, 0, force, still, np.zeros(30), body, tissue)
    touch = TrueTouch("poke", "knuckle", "one", (press,), {})
    for seed in range(20):
        (slid,) = slide_poke(touch, np.random.default_rng(seed)).presses
        travel = np.linalg.norm(slid.centre[-1] - slid.centre[0])
        assert 0.0 < travel <= LONGEST_POKE_TRAVEL


def test_a_reading_falls_with_its_lag_and_never_below_the_pressure():
    device = plain(lag=0.2)
    pressure = press(device)
    found = measure(device, pressure, STEP)[:, 0]
    assert found[50:80] == pytest.approx(np.full(30, 10.0))
    assert found[99] == pytest.approx(10.0 * np.exp(-0.2 / 0.2), rel=1e-6)


def test_a_binary_device_is_on_or_off_and_others_saturate():
    device = plain(binary=4.0)
    assert set(np.unique(measure(device, press(device), STEP))) == {0.0, 50.0}
    assert not measure(device, press(device, pressure=3.0), STEP).any()
    assert measure(plain(), press(device, pressure=80.0), STEP).max() == 50.0


@pytest.mark.parametrize("reading", ["line", "hold", "own"])
def test_a_slow_device_is_read_as_it_is_said(reading):
    device = plain(rate=10.0, reading=reading)
    measured = measure(device, press(device, (0.0, 2.0)), STEP)
    measured *= np.linspace(0, 1, len(measured))[:, None]
    times, counts = read_out(device, measured, STEP, np.random.default_rng(0))
    assert (np.diff(times) > 0).all()
    same = (np.diff(counts[:, 0]) == 0).mean()
    assert np.median(np.diff(times)) == pytest.approx(0.1 if reading == "own" else 0.02)
    assert (same > 0.7) == (reading == "hold")


def test_clips_are_of_the_gesture_that_their_device_shows(tmp_path):
    settings = GenerationSettings("devices", clips=50, subjects=2, seed=5)
    generate(tmp_path / "set", settings, 0)
    recordings = [read_recording(p) for p in find_recordings([tmp_path / "set"])]
    assert len({recording.skin.name for recording in recordings}) == 2
    rows = read_index(tmp_path / "set")
    for row in rows:
        assert all(touch.gesture == row.gesture for touch in row.touches)
    assert np.mean([bool(row.touches) for row in rows]) > 0.8
    closed = {
        session.file
        for session in settings.sessions
        if draw_device(settings.find_skin(session)).closed
    }
    assert {row.file for row in rows if row.gesture == "grab"} <= closed


def write_phone(path, travel_cells):
    """Write a participant who strokes over some cells, and then holds a fingertip."""
    frames = np.zeros((60, 27, 15), np.uint8)
    for number in range(15):
        frames[5 + number, 4 + round(travel_cells * number / 14), 7] = 200
    frames[32:58, 10, 7] = 200
    trial = np.repeat([0, 1], 30).astype(np.int32)
    labels = np.array(["scroll", "tap"])
    np.savez(path, frames=frames, trial=trial, labels=labels, rate=np.float32(14.3))


def test_strokes_and_held_fingertips_on_a_phone_are_played_on_devices(tmp_path):
    write_phone(tmp_path / "P01.npz", 8)
    write_phone(tmp_path / "P02.npz", 5)
    found = [
        (touch.repetition.person, touch.gesture)
        for touch in read_recorded_touches(tmp_path)
    ]
    assert found == [(1, "stroke"), (1, "none"), (2, "none")]
    people = find_recorded_people(tmp_path, [1], needed=())
    assert people.classes == ("stroke", "none")
    settings = GenerationSettings("devices", clips=4, recorded=people)
    (session,) = settings.sessions
    simulator = DeviceSimulator(settings.find_skin(session), people)
    clips = [simulator.make(plan) for plan in settings.plan_clips(session)[1:]]
    kinds = {truth.kind for clip in clips for truth in clip.truths}
    assert kinds == {"scroll", "tap"}
