"""Tests of `eskin skin` and its checks: each planted problem is found and named."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.registry import advise_install
from eskin.robot import Box, Geom, Link, Robot, load_robot
from eskin.skin import (
    SkinProblem,
    check_skin,
    describe_problems,
    load_skin,
    save_skin,
)
from eskin.skin.picture import build_robot_triangles
from eskin.skin.wiring import PressResponse, check_wiring, choose_press_targets

SKIN = load_skin("ur5")
ROBOT = load_robot("ur5")
TAXEL = int(SKIN.find_taxels("wrist_1")[17])
PLACE = SKIN.positions[TAXEL]
NORMAL = SKIN.normals[TAXEL]
WRIST_2 = SKIN.find_taxels("wrist_2")


def change_taxel(taxel=TAXEL, **values):
    """Return the skin with other values of one taxel, or of several."""
    arrays = {name: getattr(SKIN, name).copy() for name in values}
    for name, value in values.items():
        arrays[name][taxel] = value
    return replace(SKIN, **arrays)


def change_last_patch(**changes):
    """Return the skin with another last patch, which is `wrist_3`."""
    return replace(
        SKIN, patches=(*SKIN.patches[:-1], replace(SKIN.patches[-1], **changes))
    )


@pytest.mark.parametrize(
    ("field", "value", "texts", "others"),
    [
        ("normals", 0.5 * NORMAL, ["normal", "length 0.5"], 0),
        ("normals", -NORMAL, ["does not point out of link 'wrist_1_link'"], 1),
        ("normals", -NORMAL, ["against its neighbours"], 1),
        ("tangents", 2 * SKIN.tangents[TAXEL], ["tangent", "length 2"], 0),
        ("tangents", NORMAL, ["tangent", "right angle"], 0),
        ("areas", 100 * SKIN.areas[TAXEL], ["area", "4489 mm2"], 0),
        ("areas", 0.01 * SKIN.areas[TAXEL], ["area", "0.4489 mm2"], 0),
        ("areas", np.nan, ["area", "nan mm2"], 0),
        ("areas", -1e-6, ["area", "-1 mm2"], 0),
        ("rows", 9, ["row 9 of 0 to 8"], 3),
        ("columns", -1, ["column -1 of 0 to 11"], 3),
        ("columns", SKIN.columns[TAXEL - 1], [f"where taxel {TAXEL - 1} is"], 3),
        ("positions", PLACE + 0.008 * NORMAL, ["8 mm off the surface", "5 mm"], 0),
        ("positions", PLACE - 0.008 * NORMAL, ["8 mm below the surface"], 0),
        ("positions", SKIN.positions[TAXEL - 1], ["0 mm from", f"{TAXEL - 1}"], 3),
        ("positions", np.nan, ["position", "nan"], 3),
        ("positions", 1e200, ["position", "1e+200", "up to 1e+06 m"], 9),
    ],
)
def test_problem_of_a_taxel_is_named(field, value, texts, others):
    problems = check_skin(change_taxel(**{field: value}), ROBOT)
    assert len(problems) <= 1 + others
    [problem] = [p for p in problems if all(text in p.text for text in texts)]
    assert (problem.patch, problem.taxel) == ("wrist_1", TAXEL)
    assert str(problem) == f"patch 'wrist_1', taxel {TAXEL}: {problem.text}"
    assert "\n" not in problem.text


def test_check_without_a_robot_finds_all_but_surface_problems():
    lifted = change_taxel(positions=PLACE + 0.008 * NORMAL)
    assert check_skin(lifted) == []
    [problem] = check_skin(change_taxel(normals=-NORMAL))
    assert "against its neighbours" in problem.text


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"normals": -SKIN.normals[WRIST_2]}, "does not point out"),
        ({"positions": 1000 * SKIN.positions[WRIST_2]}, "off the surface"),
    ],
    ids=["inside out", "in millimetres"],
)
def test_every_taxel_of_a_wrong_patch_is_named(changes, text):
    problems = check_skin(change_taxel(WRIST_2, **changes), ROBOT)
    assert {p.taxel for p in problems if text in p.text} == set(WRIST_2.tolist())


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({"id": "wrist_1"}, ["2 patches"]),
        ({"address": 1}, ["address 1", "upper_arm_front"]),
        ({"link": "tail"}, ["tail", "ur5", "base"]),
    ],
)
def test_wrong_patch_is_named(changes, texts):
    problems = check_skin(change_last_patch(**changes), ROBOT)
    patch = changes.get("id", "wrist_3")
    assert {(p.patch, p.taxel) for p in problems} == {(patch, None)}
    assert all(text in p.text for p in problems for text in texts)


def test_all_problems_are_listed():
    skin = change_last_patch(address=1, link="tail")
    areas = np.where(np.arange(skin.count) < 3, 1.0, skin.areas)
    empty = replace(SKIN.patches[0], id="empty", address=50)
    skin = replace(skin, areas=areas, patches=(*skin.patches, empty))
    problems = check_skin(skin, ROBOT)
    assert sorted((p.patch, p.taxel or 0) for p in problems) == [
        ("empty", 0),
        ("upper_arm_front", 0),
        ("upper_arm_front", 1),
        ("upper_arm_front", 2),
        ("wrist_3", 0),
        ("wrist_3", 0),
    ]


def test_check_command_lists_problems_of_files_and_of_the_skin(tmp_path, capsys):
    save_skin(change_taxel(areas=9999e-6), tmp_path)
    table = tmp_path / "taxels.csv"
    text = table.read_text()
    table.write_text(text.replace("upper_arm_front,0", "nowhere,0", 1))
    assert run(["skin", "check", str(tmp_path), "--robot", "ur5"]) == 2
    out, err = capsys.readouterr()
    unread, wrong = out.splitlines()
    assert unread.startswith("patch 'nowhere', taxel 0: ")
    assert "line 2, column patch" in unread
    assert wrong.startswith(f"patch 'wrist_1', taxel {TAXEL}: ") and "9999" in wrong
    assert err.count("\n") == 1 and "2 problems" in err


def test_what_is_wrong_with_all_taxels_of_a_patch_is_one_line(tmp_path, capsys):
    save_skin(replace(SKIN, normals=-SKIN.normals), tmp_path)
    assert run(["skin", "check", str(tmp_path), "--robot-urdf", "ur5"]) == 2
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == len(SKIN.patches)
    assert f"{SKIN.count} problems" in err


def test_check_command_finds_nothing_wrong_with_a_good_skin(tmp_path, capsys):
    assert run(["skin", "check", "ur5", "--json"]) == 0
    text, result = capsys.readouterr().out.splitlines()
    assert json.loads(result) == {"problems": []}
    assert "no problems" in text and "robot ur5" in text
    save_skin(load_skin("sleeve"), tmp_path)
    assert run(["skin", "check", str(tmp_path)]) == 0
    assert "without a robot" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["check", "nothing"], "skin.yaml"),
        (["check", "ur5", "--robot", "nothing"], "'nothing'"),
        (["show", "nothing"], "(ur5, ur5-half"),
        (
            ["show", "ur5", "--out", "a.foo"],
            "a.foo is no picture that can be drawn; allowed are .png, .svg, .pdf",
        ),
        (["show", "ur5", "--out", "no/a.png"], "no folder no"),
        (["show", "ur5", "--out", "a.png", "--robot", "table"], "links"),
    ],
)
def test_invalid_input_is_refused_in_one_line(
    argv, expected, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run(["skin", *argv]) == 2
    err = capsys.readouterr().err
    assert expected in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_show_command_prints_and_draws_a_skin(tmp_path, capsys):
    picture = tmp_path / "skin.png"
    skin = load_skin("bent")
    assert run(["skin", "show", "bent", "--out", str(picture), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert shown["taxels"] == skin.count == sum(p["taxels"] for p in shown["patches"])
    assert shown["area_cm2"] == pytest.approx(1e4 * skin.areas.sum(), abs=1e-3)
    assert shown["calibrated"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [picture]


def test_show_command_draws_a_nominal_skin_without_its_robot(tmp_path, capsys):
    save_skin(load_skin("shearsense"), tmp_path / "own")
    own = str(tmp_path / "own")
    picture = tmp_path / "a.svg"
    assert run(["skin", "show", own, "--out", str(picture), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out.splitlines()[-1])["calibrated"]
    assert picture.stat().st_size > 5_000


def test_picture_without_matplotlib_names_the_extra(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert run(["skin", "show", "ur5", "--out", str(tmp_path / "a.png")]) == 2
    err = capsys.readouterr().err
    assert (
        advise_install("train") in err and "matplotlib" in err and err.count("\n") == 1
    )


def check_responses(move):
    """Check the wiring when a press at row and column is felt at `move(row, column)`.

    Rows and columns are shares of the patch's grid; None is no response.
    """
    responses = []
    for target in choose_press_targets(SKIN):
        taxels = SKIN.find_taxels(target.patch)
        cells = np.column_stack([SKIN.rows, SKIN.columns])
        last = cells[taxels].max(axis=0)
        moved = move(*(cells[target.taxel] / last))
        taxel = None
        if moved is not None:
            distances = np.linalg.norm(cells[taxels] - np.array(moved) * last, axis=1)
            taxel = int(taxels[np.argmin(distances)])
        responses.append(PressResponse(target, taxel))
    return check_wiring(SKIN, responses)


def test_response_at_or_beside_the_target_is_right():
    assert check_responses(lambda row, column: (row, column)) == []
    assert check_responses(lambda row, column: (row + 0.05, column - 0.05)) == []


@pytest.mark.parametrize(
    ("move", "text"),
    [
        (lambda row, column: (1 - row, column), "has rows reversed;"),
        (lambda row, column: (row, 1 - column), "has columns reversed;"),
        (lambda row, column: (1 - row, 1 - column), "rows reversed and columns rev"),
        (lambda row, column: (column, row), "has rows and columns exchanged;"),
        (lambda row, column: (0.5, 0.5), "responded elsewhere"),
        (lambda row, column: None, "did not respond at 3 of 3"),
    ],
)
def test_wrong_wiring_of_a_patch_is_named(move, text):
    for patch, line in zip(SKIN.patches, check_responses(move), strict=True):
        assert f"'{patch.id}'" in line and text in line


def test_summary_of_a_wrong_patch_lists_what_was_felt_where():
    """Also where some of its targets were not felt at all."""
    targets = choose_press_targets(SKIN)[:3]
    elsewhere = int(SKIN.find_taxels(SKIN.patches[-1].id)[0])
    felt = (targets[0].taxel, elsewhere, None)
    answers = [PressResponse(*pair) for pair in zip(targets, felt, strict=True)]
    [line] = check_wiring(SKIN, answers)
    places = [SKIN.describe_taxel(target.taxel) for target in targets]
    assert f"{places[0]} felt there" in line
    assert f"{places[1]} felt at {SKIN.describe_taxel(elsewhere)}" in line
    assert f"{places[2]} not felt" in line


def test_picture_of_a_large_robot_is_made_of_a_bounded_number_of_pieces():
    """Such as one in millimetres, taken as metres."""
    large = Link("link", (Geom(Box((200.0, 100.0, 300.0)), np.eye(4)),))
    robot = Robot("large", (large,), ())
    assert len(build_robot_triangles(robot, np.zeros(0), 0.02)) < 500_000


def test_problems_of_a_kind_on_a_patch_are_one_line_and_all_are_counted():
    kinds = ("area", "same place")
    problems = [
        SkinProblem(f"{kind} {taxel}", kind, patch, taxel)
        for patch in ("a", "b")
        for kind in kinds
        for taxel in range(20)
    ]
    lines = describe_problems(problems)
    assert [line.split("; so ")[0] for line in lines] == [
        str(problem) for problem in problems if problem.taxel == 0
    ]
    assert all("; so 19 more: taxels 1, 2, " in line for line in lines)
    assert describe_problems(problems[:1]) == [str(problems[0])]
