"""Tests of `eskin report`: forces, pressures, held values, limits and the page."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from eskin.exports.limits import build_open_limits, read_limits
from eskin.exports.loads import find_held, join_rows, measure_loads
from eskin.exports.report import NO_SAFETY, format_report
from eskin.recording import Label, read_recording
from helpers.cli import assert_refused, call_json
from helpers.live import SECOND, START, Press, mounted, record, scans

PRESSES = [Press(2.0, 2.4, 65, 65), Press(4.0, 6.0, 100, 100, 60.0)]
LIMITS = """
source: our own
quasi_static_after: 0.5
regions:
  - name: palm
    links: [{link}]
    transient: {{force: {force}, pressure: 1000}}
    quasi_static: {{pressure: 0.5}}
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A short press that is labelled, and a longer and stronger one."""
    label = Label(START + 19 * SECOND // 10, START + 25 * SECOND // 10, "<b>poke")
    stream = scans(mounted(), PRESSES, 50, 7.5)
    return record(
        tmp_path_factory.mktemp("report") / "a.mcap", mounted(), stream, [label]
    )


def measure(path, limits=None):
    recording = read_recording(path)
    return measure_loads(recording, limits or build_open_limits(recording.skin, 0.5))


def write_limits(folder, **values):
    skin = mounted().skin
    given = {"link": skin.patches[0].link, "force": 1000} | values
    path = folder / "limits.yaml"
    path.write_text(LIMITS.format(**given))
    return path


def test_loads_are_the_pressures_and_forces_that_press(path):
    found = measure(path)
    skin = mounted().skin
    assert [load.gesture for load in found.loads] == ["<b>poke", ""]
    for load, press in zip(found.loads, PRESSES, strict=True):
        truth = [press.pressure(skin, t) for t in load.seconds.tolist()]
        # At the end the pressure falls as it does where a hand lifts.
        felt = load.pressure > 0
        assert felt[: round(0.5 * len(felt))].all()
        expected = np.max(truth, 1)[felt]
        np.testing.assert_allclose(load.pressure[felt], expected, rtol=0.2, atol=1.5)
        force = np.array(truth) @ skin.areas * 1e3
        assert load.force.max() == pytest.approx(force.max(), rel=0.15)
        assert press.begin <= load.seconds[0] + 1e-6 < press.begin + 0.1
    assert found.peaks.max() == max(load.pressure.max() for load in found.loads)


def test_only_what_is_held_long_enough_is_quasi_static(path):
    short, long = measure(path).loads
    assert short.held_force == short.held_pressure == 0.0
    assert 0 < long.held_pressure < long.values["peak_pressure"][0]
    assert 0 < long.held_force < long.values["peak_force"][0]


@pytest.mark.parametrize("duration", [0.1, 0.3, 1.0])
def test_held_value_is_the_greatest_level_under_which_a_series_stays(duration):
    rng = np.random.default_rng(0)
    seconds = np.cumsum(rng.uniform(0.01, 0.05, 200))
    values = rng.uniform(0, 5, 200).round(1)
    held = find_held(seconds, values, duration)

    def is_held(level):
        start = None
        for time, value in zip(seconds, values, strict=True):
            start = None if value < level else time if start is None else start
            if start is not None and time - start >= duration - 1e-9:
                return True
        return False

    assert is_held(held) and not is_held(held + 0.05)


def test_forces_of_touches_that_became_one_add_up_and_pressures_do_not():
    rows = [(1, 2.0, 5.0, False), (2, 1.0, 1.0, False), (1, 3.0, 4.0, True)]
    times, force, pressure, clipped = join_rows(rows)
    assert times.tolist() == [1, 2] and force.tolist() == [5.0, 1.0]
    assert pressure.tolist() == [5.0, 1.0] and clipped.tolist() == [True, False]


def test_value_at_full_scale_is_a_lower_bound(tmp_path):
    stream = scans(mounted(), [Press(2.0, 3.0, 65, 65, 390.0)], 50, 4.5)
    cut = [replace(scan, counts=np.minimum(scan.counts, 4000)) for scan in stream]
    found = measure(record(tmp_path / "a.mcap", mounted(), cut))
    [load] = found.loads
    assert load.is_clipped
    assert any("lower bounds" in doubt for doubt in found.list_doubts())
    assert "≥" in format_report(found)


def test_page_is_well_formed_escapes_names_and_says_what_it_is_not(path, tmp_path):
    limits = read_limits(write_limits(tmp_path, force=0.001), mounted().skin)
    text = format_report(measure(path, limits))
    page = ElementTree.fromstring(
        text.split(">", 1)[1].replace('<meta charset="utf-8">', "")
    )
    assert (
        len(page.findall(".//svg")) == 3 and page.findall(".//b")[0].text == NO_SAFETY
    )
    assert text.count(NO_SAFETY) == 2
    assert "<b>poke" not in text and "&lt;b&gt;poke" in text
    assert "<script" not in text and "our own" in text


def test_command_tells_which_touches_are_above_limits(path, tmp_path, capsys):
    limits = write_limits(tmp_path, force=0.001)
    words = ("report", path, "--limits", limits, "--out", tmp_path / "a.html")
    result, out = call_json(capsys, *words)
    assert result["above"] == 2 and "no safety function" in out
    assert [load["above"] for load in result["loads"]] == [
        ["peak_force"],
        ["peak_force", "held_pressure"],
    ]
    assert (tmp_path / "a.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"link": "nose"}, "allowed are"),
        ({"force": -1}, "regions[0].transient.force"),
        ({"force": "{}"}, "limits.yaml"),
        ({"force": "1, torque: 2"}, "torque"),
    ],
)
def test_limits_that_do_not_fit_are_refused_before_anything_is_written(
    path, tmp_path, capsys, values, part
):
    limits = write_limits(tmp_path, **values)
    out = tmp_path / "a.html"
    assert_refused(capsys, "report", path, "--limits", limits, "--out", out, part=part)
    assert not out.exists()


def test_patch_in_two_regions_is_refused(tmp_path):
    target = write_limits(tmp_path)
    again = target.read_text().partition("regions:\n")[2].replace("palm", "back")
    target.write_text(target.read_text() + again)
    with pytest.raises(ValueError, match=r"'palm' and 'back'"):
        read_limits(target, mounted().skin)
