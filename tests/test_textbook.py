"""These tests check textbook touches: their formulas, clips, sweeps and report."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab import textbook
from lab.textbook.__main__ import Command, main
from lab.textbook.clips import NOISE, build_clip
from lab.textbook.draws import CLIP, TOUCHES, draw_touch
from lab.textbook.report import share, table, verdicts
from lab.textbook.skins import GAIN, REST, build_site
from lab.textbook.sweeps import FACTORS, Point, draw_setting
from lab.textbook.touches import Spot, TextbookTouch, compute_semi_axes

PITCH = 0.008


def make_setting(name="poke", seed=0, **given):
    return draw_setting(name, np.random.default_rng(seed), given)


def make_touch(name, site, seed=0, **given):
    setting = make_setting(name, seed, **given)
    return draw_touch(name, setting, site, np.random.default_rng(seed))


def press_spot(site, *spot, **options):
    """Return the pressure on every taxel under a spot that stays [kPa]."""
    spot = Spot(*spot, **options)
    touch = TextbookTouch("poke", (spot,), ((-9.0, 9.0),), 0.1)
    return site.pressure(touch, np.array([1.0]))[0]


def compute_force(site, pressure):
    """Return the force on the skin [N]."""
    return 1e3 * pressure @ site.mounted.skin.areas


def test_no_module_imports_the_simulator():
    for path in Path(textbook.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in getattr(node, "names", ())]
            module = getattr(node, "module", "") or ""
            assert not any("sim" in f"{module}.{n}".split(".") for n in names), path


@pytest.mark.parametrize(
    ("surface", "name"),
    [
        ("flat", "poke"),
        ("flat", "double_pat"),
        ("flat", "stroke"),
        ("round", "stroke"),
        ("round", "grab"),
    ],
)
@pytest.mark.parametrize("pitch", [0.004, 0.012])
def test_taxels_bear_the_force_of_the_spots(surface, name, pitch):
    site = build_site(surface, pitch)
    touch = make_touch(name, site, 1)
    middle = np.array([np.mean(touch.contacts[0])])
    expected = sum(spot.force for spot in touch.spots) * touch.share(middle)[0]
    pressure = site.pressure(touch, middle)[0]
    assert compute_force(site, pressure) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("surface", ["flat", "round"])
def test_spot_lies_where_it_is_asked_for(surface):
    site, centre = build_site(surface, 0.005), (0.021, -0.033)
    pressure = press_spot(site, centre, (0.006, 0.018), 5.0, angle=0.7)[site.taxel]
    found = pressure @ site.points / pressure.sum()
    assert found == pytest.approx(centre, abs=3e-4)
    length, width = (
        np.sqrt(pressure @ ((site.points - found) @ (np.cos(a), np.sin(a))) ** 2)
        for a in (0.7 + np.pi / 2, 0.7)
    )
    assert length > 2 * width
    if surface == "round":
        there, back = (
            press_spot(site, (s, 0.0), (0.01, 0.01), 5.0)
            for s in (0.04, 0.04 - site.girth)
        )
        assert np.allclose(there, back)


def test_ramps_are_raised_cosines_no_longer_than_half_a_contact():
    touch = TextbookTouch("poke", (), ((0.5, 0.9),), 0.1)
    times = np.array([0.5, 0.525, 0.55, 0.6, 0.8, 0.85, 0.9])
    quarter = 0.5 - 0.5 * np.cos(np.pi / 4)
    assert touch.share(times) == pytest.approx([0, quarter, 0.5, 1, 1, 0.5, 0])
    short = replace(touch, contacts=((0.5, 0.6),))
    assert short.share(np.array([0.525, 0.55, 0.575])) == pytest.approx([0.5, 1, 0.5])


def test_poke_and_pats_have_the_times_asked_for():
    site, times = build_site("flat", PITCH), np.arange(0, CLIP, 0.001)
    for seconds in (0.15, 0.4, 0.8):
        touch = make_touch("poke", site, duration=seconds)
        pressed = times[touch.share(times) > 0]
        assert np.ptp(pressed) == pytest.approx(seconds, abs=0.003)
    for gap in (0.15, 0.3, 0.45):
        touch = make_touch("double_pat", site, gap=gap)
        (first, lifted), (second, end) = touch.contacts
        assert second - first == pytest.approx(gap)
        assert lifted < second
        assert end - second == pytest.approx(lifted - first)
    for seed in range(20):
        [(start, _)] = make_touch("one pat", site, seed).contacts
        # No second pat can come within the clip.
        assert CLIP - start >= 0.45 - 1e-9


@pytest.mark.parametrize("speed", [5.0, 40.0])
def test_stroke_moves_at_its_speed(speed):
    site = build_site("flat", 0.005)
    touch = make_touch("stroke", site, speed=speed)
    [(start, end)] = touch.contacts
    times = start + np.array([0.3, 0.7]) * (end - start)
    pressure = site.pressure(touch, times)
    centres = (
        pressure @ site.mounted.skin.positions / pressure.sum(axis=1, keepdims=True)
    )
    distance = np.linalg.norm(np.diff(centres, axis=0))
    assert distance / np.ptp(times) == pytest.approx(speed / 100, rel=0.02)
    assert np.hypot(*touch.velocity) == pytest.approx(speed / 100)


@pytest.mark.parametrize("name", TOUCHES)
def test_touch_stays_within_its_clip_and_off_the_edge(name):
    site = build_site("round" if name == "grab" else "flat", PITCH)
    apart = np.abs(site.points)
    outer = apart > apart.max(axis=0) - PITCH / 2
    edge = site.taxel[outer[:, 1] if name == "grab" else outer.any(axis=1)]
    for seed in range(10):
        touch = make_touch(name, site, seed)
        start, end = touch.contacts[0][0], touch.contacts[-1][1]
        if name == "resting hand":
            assert start < 0.5 and end > CLIP
        else:
            assert 0 <= start < end <= CLIP - 0.1 + 1e-9
        pressure = site.pressure(touch, np.linspace(*touch.contacts[0], 9))
        assert pressure.any() and not pressure[:, edge].any()


def test_sensor_counts_pressure_and_white_noise():
    site = build_site("flat", PITCH)
    spots = (Spot((0.0, 0.0), compute_semi_axes(2e-4), 5.0),)
    touch = TextbookTouch("poke", spots, ((1.0, 1.5),), 0.05)
    clip = build_clip(touch, site, 50.0, np.random.default_rng(0))
    rest = clip.counts[clip.times < 0.9] - REST
    assert rest.mean() == pytest.approx(0, abs=0.1)
    assert rest.std() * GAIN == pytest.approx(NOISE, rel=0.1)
    held = clip.counts[(clip.times > 1.1) & (clip.times < 1.4)].mean(axis=0) - REST
    assert compute_force(site, held * GAIN) == pytest.approx(5.0, rel=0.1)


def test_seed_decides_the_clip():
    site = build_site("round", PITCH)
    one, again, other = (
        build_clip(
            make_touch("grab", site, seed), site, 50.0, np.random.default_rng(seed)
        )
        for seed in (3, 3, 4)
    )
    assert np.array_equal(one.counts, again.counts)
    assert not np.array_equal(one.counts, other.counts)


def test_one_factor_is_swept_and_the_others_come_from_their_middle_halves():
    assert replace(make_setting(force=1.0), force=20.0) == make_setting(force=20.0)
    settings = [make_setting(seed=seed) for seed in range(50)]
    for factor in FACTORS:
        low, high = factor.middle
        drawn = [getattr(setting, factor.name) / factor.scale for setting in settings]
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


@pytest.mark.slow
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
    with pytest.raises(ValueError, match="colour.* force"):
        main(Command(factors=("colour",)))
