"""Tests of the pose of a mounted patch: what is found, how sure it is, the command."""

from dataclasses import replace

import numpy as np
import pytest

import helpers.guided
from eskin.calibration.pose import (
    KnownPoint,
    PoseGuide,
    choose_taxels,
    estimate_pose,
    find_felt_point,
    linearise,
    move_patch,
    read_points,
)
from eskin.cli.guided import guide_person
from eskin.cli.main import run
from eskin.design.commands.pose import PoseDialogue
from eskin.errors import SkinError
from eskin.skin import fit_surface, load_skin
from eskin.transforms import apply, exp_so3, log_so3, make_transform, rotate
from helpers.cli import assert_refused, call_json
from helpers.guided import (
    CALIBRATION,
    MOUNTED,
    SKIN,
    RememberedPage,
    act_during_next_press,
    press,
    record,
    rest,
)

UR5 = load_skin("ur5")
PATCHES = ("forearm_front", "elbow_cap", "wrist_1_cap")
SHIFT = 0.010
TURN = np.deg2rad(10.0)


def draw_unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def draw_motion(skin, patch, rng):
    centre = skin.positions[skin.find_taxels(patch)].mean(axis=0)
    turn = exp_so3(TURN * draw_unit(rng))
    return make_transform(turn, centre + SHIFT * draw_unit(rng) - turn @ centre)


def draw_presses(patch, T, rng, count=10, along=1e-3, across=3e-4):
    """Press random points of a moved patch."""
    own = UR5.find_taxels(patch)
    # One in each part of the patch, so that they are never along a line.
    taxels = np.array([rng.choice(part) for part in np.array_split(own, count)])
    return press_taxels_of_moved(taxels, T, rng, along, across)


def press_taxels_of_moved(taxels, T, rng, along=1e-3, across=3e-4):
    """Press taxels of a moved patch, with errors along its surface and across it."""
    felt = UR5.positions[taxels]
    normals = UR5.normals[taxels]
    noise = along * rng.normal(size=(len(taxels), 3))
    lean = np.sum(noise * normals, axis=1, keepdims=True)
    noise += (across / along - 1) * lean * normals
    return apply(T, felt + noise), felt, normals


def measure_error(found, T):
    turn = log_so3(found.T_true_file[:3, :3] @ T[:3, :3].T)
    away = apply(found.T_true_file, found.centre) - apply(T, found.centre)
    return np.linalg.norm(away), np.linalg.norm(turn)


@pytest.mark.parametrize("patch", PATCHES)
def test_motion_is_found_exactly_from_exact_presses(patch):
    rng = np.random.default_rng(1)
    T = draw_motion(UR5, patch, rng)
    presses = draw_presses(patch, T, rng, along=1e-12, across=1e-12)
    found = estimate_pose(UR5, patch, *presses)
    assert max(measure_error(found, T)) < 1e-8
    moved = move_patch(UR5, found)
    taxels = UR5.find_taxels(patch)
    assert moved.positions[taxels] == pytest.approx(apply(T, UR5.positions[taxels]))
    assert moved.normals[taxels] == pytest.approx(rotate(T, UR5.normals[taxels]))
    assert moved.tangents[taxels] == pytest.approx(rotate(T, UR5.tangents[taxels]))
    others = np.setdiff1d(np.arange(UR5.count), taxels)
    assert np.array_equal(moved.positions[others], UR5.positions[others])


def test_offset_of_a_large_patch_is_found_to_a_millimetre_and_a_degree():
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(60):
        T = draw_motion(UR5, "forearm_front", rng)
        presses = draw_presses("forearm_front", T, rng)
        found = estimate_pose(UR5, "forearm_front", *presses)
        errors.append(measure_error(found, T))
    shift, turn = np.median(errors, axis=0)
    assert shift < 1e-3 and turn < np.deg2rad(1.0)


@pytest.mark.parametrize("patch", PATCHES)
def test_intervals_contain_the_truth_as_often_as_they_say(patch):
    """Also of few presses, from which the noise is not known well."""
    rng = np.random.default_rng(5)
    taxels = choose_taxels(UR5, patch, 8)
    inside = []
    for _ in range(200):
        T = draw_motion(UR5, patch, rng)
        found = estimate_pose(UR5, patch, *press_taxels_of_moved(taxels, T, rng))
        turn = log_so3(T[:3, :3] @ exp_so3(found.rotation).T)
        shift = apply(T, found.centre) - found.centre - found.shift
        inside.append(np.abs(np.concatenate([turn, shift])) <= found.half_widths)
    assert 0.93 <= np.mean(inside) <= 0.97


def test_more_presses_and_less_noise_make_it_surer():
    rng = np.random.default_rng(4)
    T = draw_motion(UR5, "elbow_cap", rng)

    def deviate(count, along):
        found = [
            estimate_pose(
                UR5, "elbow_cap", *draw_presses("elbow_cap", T, rng, count, along)
            )
            for _ in range(20)
        ]
        return np.mean([each.deviations for each in found], axis=0)

    few = deviate(10, 1e-3)
    many = deviate(40, 1e-3)
    noisy = deviate(40, 2e-3)
    assert (many < 0.75 * few).all()
    # Of the six components those that rest on places along the surface double.
    assert (noisy > many).sum() >= 5 and (noisy > 1.7 * many).any()


@pytest.mark.parametrize("patch", (*PATCHES, "wrist_1"))
def test_chosen_taxels_place_a_patch_better_than_others(patch):
    """Than ten in ten parts of the patch, by the rotation's variance."""
    rng = np.random.default_rng(6)
    own = UR5.find_taxels(patch)

    def measure_variance(taxels):
        arm = UR5.positions[taxels] - UR5.positions[own].mean(axis=0)
        jacobian, weights, _ = linearise(arm, UR5.normals[taxels], (0.8e-3, 0.3e-3))
        squares = np.einsum("pia,pij,pjb->ab", jacobian, weights, jacobian)
        return np.trace(np.linalg.inv(squares)[:3, :3])

    chosen = choose_taxels(UR5, patch, 10)
    assert len(set(chosen.tolist())) == 10 and set(chosen) <= set(own)
    for _ in range(50):
        others = [rng.choice(part) for part in np.array_split(own, 10)]
        assert measure_variance(chosen) < measure_variance(np.array(others))
    few = choose_taxels(UR5, patch, 5)
    many = choose_taxels(UR5, patch, 20)
    assert np.array_equal(few, chosen[:5]) and np.array_equal(chosen, many[:10])


def test_centre_of_pressure_lies_on_the_surface():
    for patch in ("forearm_front", "elbow_cap"):
        taxels = UR5.find_taxels(patch)
        middle = taxels[len(taxels) // 2]
        away = np.linalg.norm(UR5.positions[taxels] - UR5.positions[middle], axis=1)
        near = taxels[away < 0.02]
        pressure = 50.0 * np.exp(-((away[away < 0.02] / 0.01) ** 2))
        point, normal = find_felt_point(UR5, near, pressure)
        surface = fit_surface(UR5.positions[taxels], UR5.normals[taxels])
        assert surface is not None
        wrapped = surface.wrap(surface.unroll(point[None]))
        assert wrapped.positions[0] == pytest.approx(point, abs=5e-5)
        assert wrapped.normals[0] == pytest.approx(normal, abs=5e-3)


def test_presses_that_cannot_place_a_patch_are_refused():
    taxels = UR5.find_taxels("forearm_front")
    row = taxels[UR5.rows[taxels] == 10][:8]
    for chosen, words in ((taxels[:4], "4 presses"), (row[:6], "from a line")):
        points = UR5.positions[chosen]
        normals = UR5.normals[chosen]
        with pytest.raises(ValueError, match=words):
            estimate_pose(UR5, "forearm_front", points, points, normals)


# The guide and the command

PLACES = ((1, 1), (1, 6), (6, 1), (6, 6), (3, 4), (4, 2), (2, 3))
OFFSET = make_transform(exp_so3(np.array([0.0, 0.0, 0.1])), np.array([4e-3, -6e-3, 0]))


def find_taxel(patch, row, column):
    own = (SKIN.patch_index == patch) & (SKIN.rows == row) & (SKIN.columns == column)
    return int(np.flatnonzero(own)[0])


POINTS = tuple(
    KnownPoint(
        SKIN.patches[1].id, tuple(SKIN.positions[find_taxel(1, *place)].tolist())
    )
    for place in PLACES
)


def make_guide():
    return PoseGuide(MOUNTED, CALIBRATION, POINTS)


def guide_presses(places, wait=30.0, act=None):
    """Press places as a page asks for them; return the guide and the page."""
    guide = make_guide()
    page = RememberedPage(act)
    taxels = [find_taxel(1, *place) for place in places]
    guide_person(make_scans(taxels), PoseDialogue(guide), wait, page)
    assert guide.phase == "done"
    return guide, page


def make_scans(taxels):
    """Yield scans of rest, and of a press on each of some taxels."""
    above = rest(70)
    for taxel in taxels:
        above += press(taxel, force=6.0, offset=0.0)
    return helpers.guided.make_scans(above)


@pytest.fixture
def pressed(tmp_path):
    """Return a recording of presses of a moved patch, and the file of their points."""
    taxels = [find_taxel(1, *place) for place in PLACES]
    recording = record(tmp_path / "presses.mcap", make_scans(taxels))
    points = tmp_path / "points.csv"
    name = SKIN.patches[1].id
    lines = ["patch,x_mm,y_mm,z_mm"]
    for x, y, z in 1e3 * apply(OFFSET, SKIN.positions[taxels]):
        lines.append(f"{name},{x:.4f},{y:.4f},{z:.4f}")
    points.write_text("\n".join(lines) + "\n")
    return recording, points


@pytest.mark.slow
def test_command_writes_the_skin_with_the_patch_where_it_is(pressed, tmp_path, capsys):
    recording, points = pressed
    out = tmp_path / "corrected"
    command = ("skin", "pose", f"replay:{recording}", "--points", points, "--out", out)
    found, printed = call_json(capsys, *command)
    assert found["presses"] == len(PLACES)
    (patch,) = found["patches"]
    assert patch["id"] == SKIN.patches[1].id
    assert patch["rotation_deg"] == pytest.approx([0, 0, np.rad2deg(0.1)], abs=0.3)
    assert printed.count("felt on patch") == len(PLACES)
    assert printed.count("; so far to") == len(PLACES) - 4
    corrected = load_skin(out)
    taxels = SKIN.find_taxels(patch["id"])
    true = apply(OFFSET, SKIN.positions[taxels])
    assert corrected.positions[taxels] == pytest.approx(true, abs=3e-4)
    others = SKIN.find_taxels(SKIN.patches[0].id)
    assert np.array_equal(corrected.positions[others], SKIN.positions[others])


def test_press_on_another_patch_is_refused_and_asked_for_again():
    guide = make_guide()
    wrong = [find_taxel(0, 3, 3), find_taxel(1, 1, 1)]
    events = [event for scan in make_scans(wrong) if (event := guide.push(scan))]
    assert [event.kind for event in events] == ["rested", "refused", "pressed"]
    assert SKIN.patches[0].id in events[1].text
    assert len(guide.waiting) == len(POINTS) - 1


@pytest.mark.parametrize("rate", [1.0, 3.0, 20.0])
def test_presses_are_asked_for_once_the_skin_is_tared(rate):
    guide = make_guide()
    rested = None
    for number, scan in enumerate(make_scans([]), 1):
        event = guide.push(replace(scan, stamp=round(number * 1e9 / rate)))
        if event is not None and event.kind == "rested":
            rested = number
            break
    assert rested == max(20, 3 * rate + 1)
    assert guide.pipeline.front_end.is_tared.all()


def test_rest_without_enough_scans_is_refused():
    guide = make_guide()
    for scan in list(make_scans([]))[:10]:
        guide.push(scan)
    with pytest.raises(ValueError, match="not at rest"):
        guide.finish()


def repeat_second_and_skip_fifth(page, board):
    if board.presses == 2 and not page.clicks:
        page.repeated = 2
        page.clicks = 1
    if board.place is not None and board.place.name == "point 5":
        page.skipped = "point 5"


def test_page_marks_each_point_until_it_is_pressed_or_skipped(capsys):
    order = [*PLACES[:2], *PLACES[1:4], *PLACES[5:]]
    guide, page = guide_presses(order, act=repeat_second_and_skip_fifth)
    assert [press.point for press in guide.presses] == [*POINTS[:4], *POINTS[5:]]
    turns = [f"point {number}" for number in (1, 2, 3, 2, 3, 4, 5, 6, 7)]
    assert page.list_places() == turns
    for place in (board.place for board in page.boards if board.place is not None):
        assert place.p_link == POINTS[int(place.name.split()[1]) - 1].p_link
        assert place.n_link == (0.0, 0.0, 1.0)
    assert page.lines.count("the last press is not used") == 1
    assert page.lines.count("the point is left out") == 1
    shares = [board.share for board in page.boards if board.place is None]
    assert shares == sorted(shares)
    assert capsys.readouterr().out.count("press at x") >= len(POINTS)


def skip_third_and_repeat_second(page, board):
    name = board.place and board.place.name
    if name == "point 3":
        page.skipped = name
    if name == "point 4" and not page.clicks:
        page.repeated = 2
        page.clicks = 1


def test_point_that_is_repeated_after_a_skip_is_asked_for_and_kept():
    order = [*PLACES[:2], PLACES[1], *PLACES[3:]]
    guide, page = guide_presses(order, act=skip_third_and_repeat_second)
    assert [press.point for press in guide.presses] == [*POINTS[:2], *POINTS[3:]]
    turns = [f"point {number}" for number in (1, 2, 3, 4, 2, 4, 5, 6, 7)]
    assert page.list_places() == turns
    assert page.lines.count("the point is left out") == 1


@pytest.mark.parametrize(
    ("action", "last", "expected"), [("skip", 2, [0, 2]), ("withdraw", 0, [0])]
)
def test_press_that_goes_on_at_a_skip_or_a_repeat_counts_for_no_point(
    action, last, expected
):
    guide = make_guide()
    taxels = [find_taxel(1, *PLACES[n]) for n in (0, 1, last)]
    act_during_next_press(guide, action, make_scans(taxels))
    assert [press.number for press in guide.presses] == expected


def test_time_that_runs_out_during_a_press_leaves_no_point_out(capsys):
    """Each press begins before the time has run out, and ends after it."""
    guide, _ = guide_presses(PLACES, wait=0.8)
    assert [press.point for press in guide.presses] == list(POINTS)
    assert "nothing felt" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no points", "patch,x_mm,y_mm,z_mm"]),
        ("patch,x,y,z\np0,1,2,3\n", ["line 2", "patch,x_mm"]),
        ("patch,x_mm,y_mm,z_mm\nnose,1,2,3\n", ["line 2", "nose"]),
        ("patch,x_mm,y_mm,z_mm\np0,1,2,3\np0,1,x,3\n", ["line 3"]),
        ("patch,x_mm,y_mm,z_mm\np0,1,2,nan\n", ["line 2"]),
        ("patch,x_mm,y_mm,z_mm\np0,1,2\n", ["line 2"]),
    ],
)
def test_points_with_an_error_are_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(SkinError) as caught:
        read_points(path, SKIN)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_command_chooses_points_that_are_read_again(tmp_path, capsys):
    path = tmp_path / "points.csv"
    command = ("skin", "points", "ur5", "--patch", "wrist_1", "--out", path)
    found, _ = call_json(capsys, *command, "--presses", 8)
    points = read_points(path, UR5)
    assert found["points"] == len(points) == 8
    chosen = UR5.positions[choose_taxels(UR5, "wrist_1", 8)]
    assert [point.p_link for point in points] == pytest.approx(chosen, abs=1e-5)
    for options, part in (
        (("--presses", 4), "allowed are 5 to 100"),
        (("--patch", "nose"), "no patch 'nose'"),
    ):
        path.unlink(missing_ok=True)
        assert_refused(capsys, *command, *options, part=part)
        assert not path.exists()


def test_presses_that_do_not_fit_their_points_are_refused():
    """As where one was missed, and those after it counted for the wrong points."""
    guide = make_guide()
    for scan in make_scans([find_taxel(1, *place) for place in PLACES[1:]]):
        guide.push(scan)
    assert len(guide.presses) == len(PLACES) - 1
    with pytest.raises(ValueError, match=r"scatter by \d+\.\d mm; allowed are 5 mm"):
        guide.finish()


@pytest.mark.slow
def test_command_refuses_what_it_cannot_use(pressed, tmp_path, capsys):
    recording, points = pressed
    out = tmp_path / "corrected"
    few = tmp_path / "few.csv"
    few.write_text("\n".join(points.read_text().splitlines()[:4]) + "\n")
    for options, word in (
        (["--points", str(few)], "3 presses"),
        (["--points", str(tmp_path / "none.csv")], "No such file"),
        (["--points", str(points), "--wait", "0"], "--wait is 0"),
    ):
        command = ["skin", "pose", f"replay:{recording}", *options, "--out", str(out)]
        assert run(command) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and word in error
        assert not out.exists()
