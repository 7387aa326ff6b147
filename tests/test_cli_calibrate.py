"""Tests of `eskin calibrate`: rest and presses of a recording or a device to a file."""

import json
import re
import socket
from dataclasses import replace

import numpy as np
import pytest

import eskin.app
import helpers.guided
from eskin.calibration import CalibrationGuide, GuideConfig, PressRefusal
from eskin.calibration.guide import PLACES
from eskin.cli import calibrate
from eskin.cli.guided import await_page, guide_person
from eskin.drivers import STEPPED, ManualClock, PlayedSource, SourceInfo
from eskin.recording import read_recording
from eskin.skin import mount_skin, save_skin
from eskin.skin.wiring import find_nearest_taxel
from eskin.touch import Calibration, Scan
from helpers.cli import assert_refused, call, call_json
from helpers.guided import (
    CALIBRATION,
    MOUNTED,
    RATE,
    REST,
    SKIN,
    RememberedPage,
    act_during_next_press,
    press_counts,
    record,
    rest,
)

pytestmark = pytest.mark.slow

NOISE = 2.0
REST_SCANS = 102
GAINS = (1.0, 2.0)
"""True gain of each patch, by the assumed one."""
STUCK = 0


def press(taxel, width=0):
    return helpers.guided.press(taxel, width=width, gain=GAINS[SKIN.patch_index[taxel]])


def make_scans(above, seed=0):
    return helpers.guided.make_scans(above, NOISE, seed, [STUCK])


def places(patch):
    return [find_nearest_taxel(SKIN, SKIN.patches[patch].id, place) for place in PLACES]


def all_presses():
    return [
        scan for patch in (0, 1) for taxel in places(patch) for scan in press(taxel)
    ]


def make_slow_scans(rate, seconds, is_heard=lambda number: ()):
    """Yield scans at rest at a rate [1/s]; of some numbers patches are not received."""
    scans = make_scans(rest(round(rate * seconds)))
    for number, scan in enumerate(scans, 1):
        received = ~np.isin(SKIN.patch_index, is_heard(number))
        yield replace(scan, stamp=round(number * 1e9 / rate), received=received)


def push_all(above, config=None, guide=None):
    guide = guide or CalibrationGuide(MOUNTED, CALIBRATION, config)
    return guide, [e for scan in make_scans(above) if (e := guide.push(scan))]


@pytest.fixture
def recording(tmp_path):
    """Record rest and five presses of each patch; return the path."""
    return record(
        tmp_path / "presses.mcap", make_scans(rest(REST_SCANS) + all_presses())
    )


def test_recording_of_presses_gives_a_calibration_file(recording, tmp_path, capsys):
    out = tmp_path / "new" / "calibration.json"
    found, printed = call_json(
        capsys, "calibrate", f"replay:{recording}", "--out", out, "--force", "4"
    )
    counts = {key: found[key] for key in ("taxels", "noisy", "dead", "stuck")}
    assert counts == {"taxels": SKIN.count, "noisy": 0, "dead": 0, "stuck": 1}
    assert found["presses"] == 10
    assert (
        "left out: taxel 0 (row 0 of 0 to 7, column 0 of 0 to 7 of patch 'p0'), out of "
        "order while hands were off\n" in printed
    )
    assert "10 presses felt, and all of them used\n" in printed
    measured = Calibration.from_bytes(out.read_bytes())
    assert measured.source == "presses"
    np.testing.assert_allclose(np.delete(measured.rest, STUCK), REST, atol=1.0)
    np.testing.assert_allclose(np.median(measured.noise), NOISE, rtol=0.1)
    ratio = np.log(measured.gain / CALIBRATION.gain)
    for patch, gain in enumerate(GAINS):
        deviation = measured.gain_deviation[patch]
        assert 0.02 < deviation < 0.25
        assert (
            abs(ratio[SKIN.patch_index == patch] - np.log(gain)).max() < 2 * deviation
        )


def test_file_replaces_the_recorded_calibration_and_travels(
    recording, tmp_path, capsys
):
    out = tmp_path / "calibration.json"
    copy = tmp_path / "copy.mcap"
    call(capsys, "calibrate", f"replay:{recording}", "--out", out, "--presses", "0")
    words = ("replay", recording, "--calibration", out, "--record", copy)
    assert call(capsys, *words)[0] == 0
    again = read_recording(copy).calibration
    assert again.source == "rest" and again.to_bytes() == out.read_bytes()
    live = eskin.app.SourceConfig(calibration=out)
    with eskin.app.open_source(f"replay:{recording}", config=live) as source:
        assert source.info.calibration.source == "rest"


def test_calibration_of_another_skin_is_refused(recording, tmp_path, capsys):
    other = tmp_path / "other.json"
    other.write_bytes(Calibration.uniform(3, 4095, 100.0).to_bytes())
    part = "calibration has 3 taxels"
    assert_refused(capsys, "replay", recording, "--calibration", other, part=part)


@pytest.mark.parametrize("last", [0, 15])
def test_recording_that_is_touched_all_the_time_is_refused(last, tmp_path, capsys):
    """Also if its last scans are touched."""
    out = tmp_path / "calibration.json"
    above = rest(50) + press(19) * 4
    scans = make_scans(above[: len(above) - last])
    path = record(tmp_path / "touched.mcap", scans)
    printed = assert_refused(
        capsys, "calibrate", f"replay:{path}", "--out", out, part="not at rest for 5 s"
    )
    assert "patch 'p0' is touched" in printed
    assert not out.exists()


@pytest.mark.parametrize("rate", [0.5, 2.0, 3.0, 7.0, 20.0])
def test_rest_is_that_of_the_skin_however_slow_its_scans_are(rate):
    guide = CalibrationGuide(MOUNTED, CALIBRATION, GuideConfig(presses=0))
    scans = make_slow_scans(rate, 60.0)
    events = [event for scan in scans if (event := guide.push(scan))]
    kinds = [event.kind for event in events]
    assert kinds == (["rested"] if rate * 5.0 > 20 else ["awaited", "rested"])
    measured = np.delete(guide.finish().calibration.rest, STUCK)
    np.testing.assert_allclose(measured, REST, atol=4 * NOISE)


def test_patch_that_sends_seldom_is_waited_for_and_a_silent_one_is_not():
    def find_missing(number):
        return [1] if number % 10 else []

    guide = CalibrationGuide(MOUNTED, CALIBRATION, GuideConfig(presses=0))
    scans = list(make_slow_scans(20.0, 12.0, find_missing))
    events = [event for scan in scans if (event := guide.push(scan))]
    assert [event.kind for event in events] == ["awaited", "rested"]
    assert "of patch 'p1' in 5.0 s" in events[0].text
    own = SKIN.patch_index == 1
    assert guide.rest.measured[own].all()

    silent = CalibrationGuide(MOUNTED, CALIBRATION, GuideConfig(presses=0))
    scans = make_slow_scans(20.0, 6.0, lambda number: [1] if number > 10 else [])
    events = [event for scan in scans if (event := silent.push(scan))]
    assert [event.kind for event in events] == ["rested"]
    assert [fault.patch for fault in silent.finish().faults[:1]] == ["p1"]


@pytest.mark.parametrize(
    ("silent", "part"),
    [([], "16 scans of patch"), ([0, 1], "no patch that is in order")],
)
@pytest.mark.parametrize("presses", ["0", "5"])
def test_too_few_scans_are_refused_and_nothing_is_written(
    silent, part, presses, tmp_path, capsys
):
    scans = make_slow_scans(2.0, 8.0, lambda number: silent)
    path = record(tmp_path / "slow.mcap", scans)
    out = tmp_path / "c.json"
    words = ("calibrate", f"replay:{path}", "--out", out, "--presses", presses)
    assert_refused(capsys, *words, part=part)
    assert not out.exists()


def test_person_is_told_once_that_more_scans_are_needed(capsys):
    guide = CalibrationGuide(MOUNTED, CALIBRATION, GuideConfig(presses=0))
    dialogue = calibrate.CalibrationDialogue(guide)
    guide_person(make_slow_scans(2.0, 30.0), dialogue, 30.0)
    lines = capsys.readouterr().out.splitlines()
    [told] = [line for line in lines if "keep your hands off" in line]
    assert told.startswith("11 scans of patch 'p0' in 5.0 s, 2 a second")
    assert lines.index("hands off for 5 s") < lines.index(told)


def presses_of(bits, force):
    """Return scans of rest and presses by a converter of so many bits."""
    full_scale = 2**bits - 1
    nominal = replace(eskin.app.nominal_calibration(SKIN), matrix=False)
    true = nominal.with_full_scale(full_scale)
    pressures = [
        CALIBRATION.compute_pressure(scan.astype(float))
        for patch in (0, 1)
        for taxel in places(patch)
        for scan in helpers.guided.press(taxel, force=force)
    ]
    counts = [np.round(true.compute_counts(each)).astype(int) for each in pressures]
    return nominal, true, list(helpers.guided.make_scans(rest(REST_SCANS) + counts))


@pytest.mark.parametrize("bits", [10, 12])
def test_full_scale_is_found_from_the_counts(bits):
    nominal, true, scans = presses_of(bits, force=4.0)
    guide = CalibrationGuide(MOUNTED, nominal)
    for scan in scans:
        guide.push(scan)
    found = guide.finish().calibration
    assert found.full_scale == true.full_scale
    np.testing.assert_allclose(found.gain, true.gain, rtol=0.4)


def test_unfelt_presses_are_told_with_what_would_be_felt():
    nominal, _, scans = presses_of(10, force=1.5)
    guide = CalibrationGuide(MOUNTED, nominal)
    for scan in scans:
        guide.push(scan)
    told = r"rise was \d+ counts = \d\.\d kPa.*allowed are 0.5 N.* --bits 10"
    with pytest.raises(ValueError, match=told):
        guide.finish()


def test_presses_that_cannot_be_used_are_told_with_the_reason():
    nominal, _, scans = presses_of(12, force=4.0)
    guide = CalibrationGuide(MOUNTED, nominal)
    guide.find_refusal = lambda press, taxel: PressRefusal.MOVED.reason()
    for scan in scans:
        guide.push(scan)
    with pytest.raises(ValueError, match="used, the last since the finger moved"):
        guide.finish()


def test_calibration_without_a_press_writes_nothing(tmp_path, capsys):
    out = tmp_path / "calibration.json"
    path = record(tmp_path / "light.mcap", make_scans(rest(REST_SCANS + 50)))
    part = "no press was felt"
    assert_refused(capsys, "calibrate", f"replay:{path}", "--out", out, part=part)
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("sim:ur5",), "source is 'sim:ur5'"),
        (("serial:/dev/gone",), "--skin"),
        (("csv:/dev/gone", "--skin", "bent"), "cannot open serial port"),
        (("replay:x.mcap", "--seconds", "0"), "--seconds is 0"),
        (("replay:x.mcap", "--force", "-1"), "--force is -1"),
        (("replay:x.mcap", "--presses", "99"), "--presses is 99"),
        (("replay:x.mcap", "--port", "8081"), "--port is given without --view"),
        (("RECORDING", "--patch", "p9"), "no patch 'p9'; allowed are p0, p1"),
    ],
)
def test_bad_input_is_refused_in_one_line(words, part, recording, tmp_path, capsys):
    words = [word.replace("RECORDING", f"replay:{recording}") for word in words]
    out = tmp_path / "calibration.json"
    assert_refused(capsys, "calibrate", *words, "--out", out, part=part)
    assert list(tmp_path.iterdir()) == [recording]


def test_interrupted_calibration_writes_nothing(
    recording, tmp_path, monkeypatch, capsys
):
    def stop(*_):
        raise KeyboardInterrupt

    out = tmp_path / "calibration.json"
    out.write_text("before")
    monkeypatch.setattr(calibrate.CalibrationDialogue, "describe_event", stop)
    words = ("calibrate", f"replay:{recording}", "--out", out)
    assert call(capsys, *words)[0] == 130
    assert out.read_text() == "before"
    assert sorted(p.name for p in tmp_path.iterdir()) == [out.name, recording.name]


def test_device_is_asked_for_presses_and_may_leave_a_patch_out(
    tmp_path, monkeypatch, capsys
):
    above = (
        rest(REST_SCANS)
        + [scan for taxel in places(0) for scan in press(taxel)]
        + rest(200)
    )
    info = SourceInfo("test:", mount_skin(SKIN, "table"), CALIBRATION, float(RATE))
    source = PlayedSource(info, make_scans(above), STEPPED, ManualClock())
    monkeypatch.setattr(eskin.app, "open_source", lambda *_, **__: source)
    save_skin(SKIN, tmp_path / "skin")
    own = ("--skin", tmp_path / "skin", "--robot-urdf", "table")
    words = ("calibrate", "udp://127.0.0.1:9", *own, "--wait", "3")
    found, out = call_json(capsys, *words, "--out", tmp_path / "calibration.json")
    assert found["presses"] == 5
    assert out.index("press 5 of 5: patch 'p0'") < out.index("press 1 of 5: patch 'p1'")
    assert "patch 'p1' is left out" in out
    assert json.loads((tmp_path / "calibration.json").read_bytes())["rest"]


def guide_in_page(page, above, config=None):
    guide = CalibrationGuide(MOUNTED, CALIBRATION, config)
    dialogue = calibrate.CalibrationDialogue(guide)
    guide_person(make_scans(above), dialogue, 3.0, page)
    return guide


def test_page_shows_what_terminal_prints(capsys):
    page = RememberedPage()
    above = rest(REST_SCANS) + press(19, width=2) + all_presses()
    guide = guide_in_page(page, above, GuideConfig(forces=(4.9,)))
    printed = capsys.readouterr().out.splitlines()
    requests = list(dict.fromkeys(board.request for board in page.boards))
    assert requests[-1] == "" and guide.phase == "done"
    # The terminal prints faults with their time, which the page's log has anyway.
    texts = [re.sub(r"^ *[\d.]+s  (fault|mended) +", "", line) for line in printed]
    assert sorted(texts) == sorted([*requests[:-1], *page.lines, requests[1]])
    assert requests[1].startswith("press 1 of 5 with 4.9 N: patch 'p0'")
    assert "not used" in "".join(page.lines)
    for board in page.boards:
        assert ("press" in board.request) == (board.place is not None)
    asked = list(dict.fromkeys(board.place for board in page.boards))
    for place, taxel in zip(asked[1:], places(0) + places(1), strict=True):
        assert place.p_link == tuple(SKIN.positions[taxel])
        assert place.n_link == tuple(SKIN.normals[taxel])


def test_progress_grows_to_the_whole_in_each_phase():
    page = RememberedPage()
    guide_in_page(page, rest(REST_SCANS) + all_presses())
    for is_rest in (True, False):
        shares = [b.share for b in page.boards if ("hands off" in b.request) == is_rest]
        assert shares == sorted(shares) and min(shares) >= 0.0
        assert shares[0] < 0.1 and shares[-1] > 0.9


def test_page_skips_the_patch_that_it_showed_and_no_other(capsys):
    page = RememberedPage(skipped="p0")
    only = [s for taxel in places(1) for s in press(taxel)]
    guide = guide_in_page(page, rest(REST_SCANS) + only)
    assert [one.patch for one in guide.presses] == [1] * 5
    assert guide.skipped == {0} and guide.phase == "done"
    assert any("patch 'p0' is left out" in line for line in page.lines)
    assert "nothing felt" not in capsys.readouterr().out


def repeat_third_press_twice(page, board):
    # The second click comes when the press is withdrawn already.
    if page.clicks == 1 or (board.presses == 3 and not page.clicks):
        page.repeated = 3
        page.clicks = page.clicks + 1


def test_last_press_is_repeated_once_where_the_page_asks_for_that():
    page = RememberedPage(repeat_third_press_twice)
    guide = guide_in_page(page, rest(REST_SCANS) + all_presses())
    assert guide.count_presses(0) == 4 and guide.count_presses(1) == 5
    assert page.lines.count("the last press is not used") == 1
    asked = [board.place for board in page.boards if board.presses == 2]
    assert len(set(asked)) == 1
    counts = [board.presses for board in page.boards]
    assert counts[counts.index(3) :].count(2) > 0


def skip_patch_then_repeat_its_press(page, board):
    if board.presses == 2 and page.clicks == 0:
        page.skipped = "p0"
        page.clicks = 1
    elif page.clicks == 1 and board.place.name == "p1":
        page.repeated = 2
        page.clicks = 2


def test_patch_that_was_skipped_is_asked_for_again_where_its_press_is_repeated():
    page = RememberedPage(skip_patch_then_repeat_its_press)
    own = [scan for taxel in places(0) for scan in press(taxel)]
    others = [scan for taxel in places(1) for scan in press(taxel)]
    above = rest(REST_SCANS) + own[: 2 * len(own) // 5] + own[len(own) // 5 :] + others
    guide = guide_in_page(page, above)
    assert guide.phase == "done" and not guide.skipped
    assert (guide.count_presses(0), guide.count_presses(1)) == (5, 5)
    assert page.list_places() == ["p0", "p1", "p0", "p1"]
    assert sum("patch 'p0' is left out" in line for line in page.lines) == 1


@pytest.mark.parametrize(("action", "counts"), [("skip", (1, 0)), ("withdraw", (0, 0))])
def test_press_that_goes_on_at_a_skip_or_a_repeat_is_not_used(action, counts):
    guide = CalibrationGuide(MOUNTED, CALIBRATION)
    above = rest(REST_SCANS) + press(places(0)[0]) + press(places(0)[1])
    act_during_next_press(guide, action, make_scans(above))
    assert (guide.count_presses(0), guide.count_presses(1)) == counts


def test_guide_begins_once_a_browser_has_opened_the_page():
    scans = list(make_scans(rest(20)))
    info = SourceInfo("test:", mount_skin(SKIN, "table"), CALIBRATION, float(RATE))
    source = PlayedSource(info, iter(scans), STEPPED, ManualClock())
    page = RememberedPage(opened_at=5)
    given = await_page(source, page, is_live=True)
    assert [scan.stamp for scan in given] == [scan.stamp for scan in scans[5:]]


def test_port_that_is_taken_is_refused(recording, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as server:
        words = (f"replay:{recording}", "--view", "--port", server.getsockname()[1])
        out = tmp_path / "c.json"
        part = "not available"
        assert_refused(capsys, "calibrate", *words, "--out", out, part=part)
    assert not out.exists()


def test_touch_during_rest_begins_it_again():
    guide, events = push_all(rest(80) + press(19) + rest(60))
    assert [event.kind for event in events] == ["touched"]
    assert guide.rest is None
    with pytest.raises(ValueError, match="not at rest for 5 s"):
        guide.finish()
    _, events = push_all(rest(80) + press(19) + rest(160))
    assert [event.kind for event in events] == ["touched", "rested"]


@pytest.mark.parametrize("trembling", [False, True])
def test_hand_that_rests_from_the_start_is_noticed(trembling):
    """It is noticed by its trembling, or else when it lifts."""
    rng = np.random.default_rng(0)
    hand = press_counts(19, width=1) // 4
    scans = [
        hand + (hand > 0) * np.round(trembling * 12 * rng.standard_normal(SKIN.count))
        for _ in range(REST_SCANS if trembling else 60)
    ]
    _, events = push_all(scans + rest(50))
    assert {event.kind for event in events} == {"touched"}
    assert trembling or "has left" in events[0].text


def test_presses_that_are_no_fingertips_are_refused():
    slides = [s for t in (17, 18, 19, 20, 21) for s in [press_counts(t)] * 4]
    guide, events = push_all(rest(REST_SCANS) + press(19, width=2) + slides + rest(30))
    assert [event.kind for event in events] == ["rested", "refused", "refused"]
    causes = [reason.cause for reason in guide.refusals]
    assert causes == [PressRefusal.WIDE, PressRefusal.MOVED]
    assert not guide.presses


def test_every_press_that_was_felt_is_counted_as_used_or_not_with_the_reason():
    wide = press(19, width=2)
    above = rest(REST_SCANS) + wide + all_presses()[: 24 * 3] + wide
    guide, events = push_all(above)
    felt = [event for event in events if event.kind in ("pressed", "refused")]
    result = guide.finish()
    assert len(felt) == len(result.presses) + len(result.refusals) == 5
    [line] = [
        line for line in calibrate.describe_result(result, SKIN) if "felt" in line
    ]
    why = "that was wider than one fingertip (2)"
    assert line == f"5 presses felt: 3 used, 2 not used since {why}"


@pytest.mark.parametrize("interval", [7, 10, 20])
def test_every_taxel_that_no_press_uses_is_told_as_a_fault_or_as_restless(interval):
    above = rest(REST_SCANS)
    for number in range(0, REST_SCANS, interval):
        above[number] = above[number].copy()
        above[number][[30, 50]] = 60
    guide, _ = push_all(above, GuideConfig(presses=0))
    result = guide.finish()
    assert guide.ignored[[STUCK, 30, 50]].all()
    assert np.count_nonzero(result.codes >= 0) + result.restless == 3
    told = "".join(calibrate.describe_result(result, SKIN))
    assert told.count("not used for presses") == (result.restless > 0)


def test_forces_are_asked_for_in_turn_and_known_places_have_no_fault():
    guide, _ = push_all(rest(REST_SCANS), GuideConfig(forces=(1.0, 5.0), presses=3))
    asked = []
    while guide.request is not None:
        asked.append(guide.request.force)
        assert not guide.has_fault(guide.request.taxel)
        push_again = press(guide.request.taxel)
        stamp = guide.pipeline.reading.stamp
        for scan in make_scans(push_again, seed=len(asked)):
            guide.push(Scan(stamp + scan.stamp, scan.counts, scan.received, scan.q))
    assert asked == [1.0, 5.0, 1.0] * 2
    assert [one.force for one in guide.presses] == asked
    assert guide.phase == "done"
