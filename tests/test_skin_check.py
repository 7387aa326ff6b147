"""The check finds each fault that is planted, and says in which patch and taxel."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.robot import load_robot
from eskin.skin import check_skin, load_skin, save_skin

SKIN = load_skin("ur5")
ROBOT = load_robot("ur5")
VICTIM = int(SKIN.find_taxels("wrist_1")[17])


def with_value(name, value, taxel=VICTIM):
    array = getattr(SKIN, name).copy()
    array[taxel] = value
    return replace(SKIN, **{name: array})


def with_patch(number, **changes):
    patches = list(SKIN.patches)
    patches[number] = replace(patches[number], **changes)
    return replace(SKIN, patches=tuple(patches))


def one_problem(skin, robot=ROBOT):
    problems = check_skin(skin, robot)
    assert len(problems) == 1, [str(p) for p in problems]
    assert "\n" not in str(problems[0])
    return problems[0]


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("normals", 0.5 * SKIN.normals[VICTIM], "normal has length 0.5, allowed 1 +-"),
        ("tangents", 2 * SKIN.tangents[VICTIM], "tangent has length 2, allowed 1 +-"),
        ("tangents", SKIN.normals[VICTIM], "tangent is not at a right angle to the n"),
        ("areas", 100 * SKIN.areas[VICTIM], "has an area of 4489 mm2, allowed 8.9"),
        ("areas", 0.01 * SKIN.areas[VICTIM], "has an area of 0.4489 mm2, allowed 8.9"),
        ("areas", np.nan, "has an area of nan mm2"),
        ("areas", -1e-6, "has an area of -1 mm2"),
    ],
)
def test_a_wrong_taxel_is_named(field, value, text):
    problem = one_problem(with_value(field, value))
    assert (problem.patch, problem.taxel) == ("wrist_1", VICTIM)
    assert text in str(problem)
    assert str(problem).startswith(f"patch 'wrist_1', taxel {VICTIM}: ")


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("rows", 9, "lies in row 9, column"),
        ("columns", -1, "column -1; allowed rows 0 to 8, columns 0 to 11"),
    ],
)
def test_a_taxel_in_no_cell_of_its_patch_is_named(field, value, text):
    problem = check_skin(with_value(field, value), ROBOT)[0]
    assert (problem.patch, problem.taxel) == ("wrist_1", VICTIM)
    assert text in problem.text


def test_a_normal_turned_inward_is_found_with_and_without_a_robot():
    skin = with_value("normals", -SKIN.normals[VICTIM])
    assert "against its neighbours" in str(one_problem(skin, None))
    texts = [p.text for p in check_skin(skin, ROBOT)]
    assert any("does not point out of link 'wrist_1_link'" in text for text in texts)


def test_a_whole_patch_turned_inside_out_is_found_on_the_robot():
    normals = SKIN.normals.copy()
    normals[SKIN.find_taxels("wrist_2")] *= -1
    problems = check_skin(replace(SKIN, normals=normals), ROBOT)
    assert [p.taxel for p in problems] == SKIN.find_taxels("wrist_2").tolist()


@pytest.mark.parametrize(("offset", "side"), [(0.008, "off"), (-0.008, "below")])
def test_a_taxel_off_its_links_surface_is_found(offset, side):
    place = SKIN.positions[VICTIM] + offset * SKIN.normals[VICTIM]
    skin = with_value("positions", place)
    said = str(one_problem(skin))
    assert (
        f"lies 8 mm {side} the surface of link 'wrist_1_link', allowed up to 5" in said
    )
    assert check_skin(skin) == []


def test_a_patch_in_millimetres_is_found():
    positions = SKIN.positions.copy()
    positions[SKIN.find_taxels("wrist_2")] *= 1000
    problems = check_skin(replace(SKIN, positions=positions), ROBOT)
    off = {p.taxel for p in problems if "off the surface" in p.text}
    assert off == set(SKIN.find_taxels("wrist_2").tolist())


def test_taxels_on_one_another_are_found():
    other = VICTIM - 1
    skin = with_value("positions", SKIN.positions[other])
    texts = [str(p) for p in check_skin(skin, ROBOT)]
    wanted = f"taxel {VICTIM}: lies 0 mm from taxel {other} of patch 'wrist_1'"
    assert any(wanted in text for text in texts)


def test_two_taxels_in_one_cell_are_found():
    skin = with_value("columns", SKIN.columns[VICTIM - 1])
    texts = [str(p) for p in check_skin(skin, ROBOT)]
    assert any(
        f"taxel {VICTIM}: lies in row" in t and "where taxel" in t for t in texts
    )


def test_a_position_that_is_no_number_is_found():
    problems = check_skin(with_value("positions", np.nan), ROBOT)
    assert any(p.taxel == VICTIM and "position" in p.text for p in problems)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"id": "wrist_1"}, "2 patches have this id, allowed one"),
        ({"address": 1}, "address 1 is that of patch 'upper_arm_front' too"),
        (
            {"link": "tail"},
            "link 'tail', which robot 'ur5' does not have; allowed base",
        ),
    ],
)
def test_a_wrong_patch_is_named(changes, text):
    problems = check_skin(with_patch(8, **changes), ROBOT)
    here = changes.get("id", "wrist_3")
    assert {(p.patch, p.taxel) for p in problems} == {(here, None)}
    assert all(text in p.text for p in problems)


def test_a_patch_without_taxels_is_found():
    empty = replace(SKIN.patches[0], id="empty", address=50)
    skin = replace(SKIN, patches=(*SKIN.patches, empty))
    assert str(one_problem(skin)) == "patch 'empty': has no taxels, allowed one or more"


def test_several_faults_are_all_listed():
    skin = with_patch(8, address=1, link="tail")
    skin = replace(skin, areas=np.where(np.arange(skin.count) < 3, 1.0, skin.areas))
    assert len(check_skin(skin, ROBOT)) == 5


def spoil(folder):
    """Plant one fault that cannot be read, and one that can, under other ids."""
    save_skin(SKIN, folder)
    table = folder / "taxels.csv"
    lines = table.read_text().splitlines()
    lines[1] = lines[1].replace("upper_arm_front,0", "nowhere,0")
    cells = lines[1 + VICTIM].split(",")
    cells[10] = "9999"
    lines[1 + VICTIM] = ",".join(cells)
    table.write_text("\n".join(lines))


def test_the_command_lists_every_problem_of_a_folder_and_exits_with_2(tmp_path, capsys):
    spoil(tmp_path)
    assert run(["skin", "check", str(tmp_path), "--robot", "ur5"]) == 2
    out, err = capsys.readouterr()
    unread, wrong = out.splitlines()
    assert unread.startswith("patch 'nowhere', taxel 0: ")
    assert "taxels.csv line 2, column patch: got 'nowhere'" in unread
    assert wrong.startswith(f"patch 'wrist_1', taxel {VICTIM}: has an area of 9999 mm2")
    assert err.count("\n") == 1 and "has 2 problems" in err


def test_the_command_says_that_a_good_skin_has_no_problems(tmp_path, capsys):
    assert run(["skin", "check", "ur5", "--json"]) == 0
    *said, last = capsys.readouterr().out.splitlines()
    assert json.loads(last) == {"problems": []}
    assert said == ["skin ur5: no problems, checked on robot ur5"]
    save_skin(load_skin("sleeve"), tmp_path)
    assert run(["skin", "check", str(tmp_path)]) == 0
    assert "without a robot's surface" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["check", "nothing"], "skin.yaml does not exist"),
        (["check", "ur5", "--robot", "nothing"], "no robot 'nothing'"),
        (["show", "nothing"], "no skin 'nothing'; allowed a preset (ur5, ur5-half"),
        (["show", "ur5", "--out", "a.foo"], "no picture format '.foo' for a.foo; all"),
        (["show", "ur5", "--out", "no/a.png"], "no folder no for a.png; make it first"),
        (["show", "ur5", "--out", "a.png", "--robot", "table"], "lies on links that"),
    ],
)
def test_bad_input_to_the_commands_is_one_line(
    argv, expected, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run(["skin", *argv]) == 2
    err = capsys.readouterr().err
    assert expected in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [], "nothing half-written"


@pytest.mark.parametrize("name", ["ur5", "shearsense"])
def test_the_command_shows_a_skin_and_draws_it(name, tmp_path, capsys):
    picture = tmp_path / "skin.png"
    assert run(["skin", "show", name, "--out", str(picture), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out.splitlines()[-1])
    skin = load_skin(name)
    assert shown["taxels"] == skin.count == sum(p["taxels"] for p in shown["patches"])
    assert shown["area_cm2"] == pytest.approx(1e4 * skin.areas.sum(), abs=1e-3)
    assert shown["calibrated"] == skin.calibrated
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["skin.png"]


def test_a_skin_without_its_robot_is_drawn_rolled_out_only(tmp_path):
    save_skin(SKIN, tmp_path / "own")
    own = str(tmp_path / "own")
    assert run(["skin", "show", own, "--out", str(tmp_path / "a.svg")]) == 0
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_without_matplotlib_the_picture_names_the_extra_to_install(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert run(["skin", "show", "ur5", "--out", str(tmp_path / "a.png")]) == 2
    err = capsys.readouterr().err
    assert "eskin[train]" in err and "matplotlib" in err and err.count("\n") == 1
