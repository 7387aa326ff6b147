"""Textbook touches are what their formulas say, and owe the simulator nothing."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks import textbook
from benchmarks.textbook.__main__ import Command, main
from benchmarks.textbook.clips import NOISE, scans_of
from benchmarks.textbook.draws import CLIP, TOUCHES, draw_touch
from benchmarks.textbook.report import share, table, verdicts
from benchmarks.textbook.skins import GAIN, REST, site_of
from benchmarks.textbook.sweeps import FACTORS, Point, draw_setting
from benchmarks.textbook.touches import Spot, Touch, axes_of, flat_hand, laid

PITCH = 0.008
TIMES = np.arange(0, CLIP, 0.001)


def rng(seed=0):
    return np.random.default_rng(seed)


def setting(name="poke", seed=0, **given):
    return draw_setting(name, rng(seed), given)


def still(spot):
    """A spot that is pressed all the time."""
    return Touch("poke", (spot,), ((-9.0, 9.0),), 0.1)


def field(site, touch):
    """Pressure of every taxel in the middle of a clip."""
    return site.pressure(touch, np.array([1.0]))[0]


def force(site, pressure):
    """Force on the skin [N]."""
    return 1e3 * pressure @ site.mounted.skin.areas


def test_nothing_of_the_simulator_is_imported():
    for path in Path(textbook.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in getattr(node, "names", ())]
            module = getattr(node, "module", "") or ""
            assert not any("sim" in f"{module}.{n}".split(".") for n in names), path


@pytest.mark.parametrize("surface", ["flat", "round"])
@pytest.mark.parametrize("pitch", [0.004, 0.007, 0.012])
@pytest.mark.parametrize("name", ["poke", "double_pat", "stroke", "grab"])
def test_taxels_bear_the_force_of_the_spots(surface, pitch, name):
    if (surface, name) == ("flat", "grab"):
        return
    site = site_of(surface, pitch)
    touch = draw_touch(name, setting(name), site, rng(1))
    whole = sum(spot.force for spot in touch.spots)
    middle = np.array([np.mean(touch.contacts[0])])
    felt = site.pressure(touch, middle)[0]
    assert force(site, felt) == pytest.approx(whole * touch.share(middle)[0], rel=0.02)


def test_bare_strips_of_the_ur5_feel_nothing():
    site = site_of("ur5", 0.0)
    facing = still(Spot((0.0, 0.0), axes_of(2e-4), 5.0))
    seam = still(Spot((site.girth / 4, 0.0), axes_of(2e-4), 5.0))
    assert force(site, field(site, facing)) == pytest.approx(5.0, rel=0.02)
    assert 1.0 < force(site, field(site, seam)) < 4.5


@pytest.mark.parametrize("surface", ["flat", "round"])
def test_spot_lies_where_it_is_asked_for(surface):
    site = site_of(surface, 0.005)
    spot = Spot((0.021, -0.033), (0.006, 0.018), 5.0, angle=0.7)
    felt = field(site, still(spot))[site.taxel]
    centre = felt @ site.points / felt.sum()
    assert centre == pytest.approx(spot.centre, abs=3e-4)
    along, across = [(np.cos(a), np.sin(a)) for a in (0.7 + np.pi / 2, 0.7)]
    wide, narrow = (
        np.sqrt(felt @ ((site.points - centre) @ way) ** 2 / felt.sum())
        for way in (along, across)
    )
    assert wide > 2 * narrow


def test_spot_goes_round_the_tube():
    site = site_of("round", 0.005)
    there, back = (
        field(site, still(Spot((s, 0.0), (0.01, 0.01), 5.0)))
        for s in (0.04, 0.04 - site.girth)
    )
    assert np.allclose(there, back)


def test_mean_pressure_and_peak_are_those_of_a_paraboloid():
    site = site_of("flat", 0.004)
    felt = field(site, still(Spot((0.0, 0.0), axes_of(4e-4), 10.0)))
    assert felt.max() == pytest.approx(2 * 10.0 / 4e-4 / 1e3, rel=0.1)
    assert felt.max() <= 2 * 10.0 / 4e-4 / 1e3


def test_ramps_are_raised_cosines_and_never_longer_than_half_a_contact():
    touch = Touch("poke", (), ((0.5, 0.9),), 0.1)
    asked = np.array([0.5, 0.525, 0.55, 0.6, 0.8, 0.85, 0.9])
    quarter = 0.5 - 0.5 * np.cos(np.pi / 4)
    assert touch.share(asked) == pytest.approx([0, quarter, 0.5, 1, 1, 0.5, 0])
    short = replace(touch, contacts=((0.5, 0.6),))
    assert short.share(np.array([0.525, 0.55, 0.575])) == pytest.approx([0.5, 1, 0.5])


@pytest.mark.parametrize("seconds", [0.15, 0.4, 0.8])
def test_poke_presses_as_long_as_asked(seconds):
    touch = draw_touch("poke", setting(duration=seconds), site_of("flat", PITCH), rng())
    pressed = TIMES[touch.share(TIMES) > 0]
    assert np.ptp(pressed) == pytest.approx(seconds, abs=0.003)


@pytest.mark.parametrize("gap", [0.15, 0.3, 0.45])
def test_pats_are_so_far_apart_and_lifted_between(gap):
    site = site_of("flat", PITCH)
    touch = draw_touch("double_pat", setting("double_pat", gap=gap), site, rng())
    (first, lifted), (second, end) = touch.contacts
    assert second - first == pytest.approx(gap)
    assert lifted < second
    assert end - second == pytest.approx(lifted - first)


def test_one_pat_is_answered_once_no_second_can_come():
    for seed in range(20):
        drawn = setting("one pat", seed)
        touch = draw_touch("one pat", drawn, site_of("flat", PITCH), rng(seed))
        [(start, _)] = touch.contacts
        assert CLIP - start >= 0.45 - 1e-9


@pytest.mark.parametrize("surface", ["flat", "round"])
@pytest.mark.parametrize("speed", [5.0, 40.0])
def test_stroke_moves_at_its_speed(surface, speed):
    site = site_of(surface, 0.005)
    touch = draw_touch("stroke", setting("stroke", speed=speed), site, rng())
    [(start, end)] = touch.contacts
    times = np.linspace(start + 0.3 * (end - start), end - 0.3 * (end - start), 2)
    felt = site.pressure(touch, times)
    p = site.mounted.skin.positions
    apart = p - p.mean(axis=0)
    if surface == "flat":
        centres = felt @ apart / felt.sum(axis=1, keepdims=True)
        way = np.linalg.norm(np.diff(centres, axis=0))
        assert way / np.ptp(times) == pytest.approx(speed / 100, rel=0.02)
    assert np.hypot(*touch.velocity) == pytest.approx(speed / 100)


@pytest.mark.parametrize("name", TOUCHES)
def test_touch_ends_in_its_clip(name):
    for seed in range(5):
        touch = draw_touch(
            name, setting(name, seed), site_of("round", PITCH), rng(seed)
        )
        start, end = touch.contacts[0][0], touch.contacts[-1][1]
        if name == "resting hand":
            assert start < 0.5 and end > CLIP
        else:
            assert 0 <= start < end <= CLIP - 0.1 + 1e-9


@pytest.mark.parametrize("name", TOUCHES)
def test_edge_of_the_skin_is_never_touched(name):
    site = site_of("round" if name == "grab" else "flat", PITCH)
    apart = np.abs(site.points)
    outer = apart > apart.max(axis=0) - PITCH / 2
    edge = site.taxel[outer[:, 1] if name == "grab" else outer.any(axis=1)]
    for seed in range(30):
        touch = draw_touch(name, setting(name, seed), site, rng(seed))
        felt = site.pressure(touch, np.linspace(*touch.contacts[0], 9))
        assert felt.any() and not felt[:, edge].any()


def test_hand_turns_as_one():
    hand = flat_hand(5.0, 2e-4)
    turned = laid(hand, np.pi / 2, (0.01, 0.02))
    for before, after in zip(hand, turned, strict=True):
        s, t = before.centre
        assert after.centre == pytest.approx((0.01 - t, 0.02 + s))
        assert after.angle == pytest.approx(np.pi / 2)
        assert (after.force, after.axes) == (before.force, before.axes)


def test_sensor_counts_pressure_and_white_noise():
    site = site_of("flat", PITCH)
    touch = Touch("poke", (Spot((0.0, 0.0), axes_of(2e-4), 5.0),), ((1.0, 1.5),), 0.05)
    clip = scans_of(touch, site, 50.0, rng())
    rest = clip.counts[clip.times < 0.9] - REST
    assert rest.mean() == pytest.approx(0, abs=0.1)
    assert rest.std() * GAIN == pytest.approx(NOISE, rel=0.1)
    held = clip.counts[(clip.times > 1.1) & (clip.times < 1.4)].mean(axis=0) - REST
    assert force(site, held * GAIN) == pytest.approx(5.0, rel=0.1)


def test_same_seed_is_the_same_clip():
    site = site_of("round", PITCH)
    first, second, other = (
        scans_of(
            draw_touch("grab", setting("grab", seed), site, rng(seed)),
            *(site, 50.0, rng(seed)),
        )
        for seed in (3, 3, 4)
    )
    assert np.array_equal(first.counts, second.counts)
    assert not np.array_equal(first.counts, other.counts)


def test_one_factor_alone_is_swept():
    low, high = setting(force=1.0), setting(force=20.0)
    assert replace(low, force=20.0) == high


def test_others_are_drawn_from_their_middle_halves():
    for factor in FACTORS:
        low, high = factor.middle
        drawn = [
            getattr(setting(seed=n), factor.name) / factor.scale for n in range(50)
        ]
        assert low * 0.999 <= min(drawn) < max(drawn) <= high * 1.001


def test_verdict_is_of_the_middle_half_alone():
    points = [
        Point("force", 1.0, "press", False, {"poke": 10}, {}),
        Point("force", 4.0, "press", True, {"none": 9, "poke": 1}, {"poke": 10}),
        Point("force", 4.0, "poke", True, {"none": 9, "poke": 1}, {"poke": 10}),
    ]
    assert verdicts(points, "force") == {"poke": False, "press": True}
    assert share(points[1:2]) == 0.9
    assert "| press | 0 | 90 | 90.0% | 0.0% | met | poke |" in table(points, "force")


def test_short_form_runs(tmp_path, capsys):
    picture, answers = tmp_path / "sweeps.png", tmp_path / "sweeps.json"
    factors = ("duration", "gap")
    main(Command(form="short", factors=factors, picture=picture, json=answers))
    out = capsys.readouterr().out
    assert "| duration of a poke [s] | 0.15 | **0.346** | 0.8 |" in out
    assert "6 clips" in out
    found = json.loads(answers.read_text())
    assert [p["touch"] for p in found["points"]] == 3 * ["poke"] + 3 * ["double_pat"]
    assert list(found["met"]) == list(factors)
    assert picture.stat().st_size > 10_000


def test_unknown_factor_is_refused():
    with pytest.raises(ValueError, match="--factors names colour; allowed are force"):
        main(Command(factors=("colour",)))
