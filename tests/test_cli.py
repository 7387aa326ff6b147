"""What every command has in common: help, one JSON line, one line of complaint."""

import json
import math
import sys
from dataclasses import fields

import numpy as np
import pytest

from eskin.cli.main import (
    COMMANDS,
    format_one_line,
    format_overview,
    load_command,
    main,
    run,
)
from eskin.errors import ReadingError
from eskin.skin import build_grid_skin, save_skin
from eskin.touch import Reading, Scan

# Of each command: arguments that are right but for what a test spoils.
RIGHT = {
    "convert": ("sleeve", "in", "out"),
    "generate": ("out",),
    "label": ("a.mcap",),
    "train": ("a.mcap", "--out", "m"),
    "evaluate": ("m", "a.mcap"),
    "compare": ("--train", "a", "--test", "b"),
    "study": ("a",),
    "run": ("--source", "replay:a.mcap"),
    "device": ("sleeve", "--play", "a.mcap"),
    "view": ("a.mcap",),
    "demo": ("--headless",),
    "replay": ("a.mcap", "--model", "m"),
    "skin show": ("sleeve",),
    "skin check": ("sleeve",),
    "bench latency": ("--steps", "10"),
    "bench throughput": ("--seconds", "1"),
    "doctor": (),
}

OF_NO_PATH = {"generate", "demo", "bench latency", "bench throughput", "doctor"}

NESTED = {"train", "config"}  # fields that are configurations of their own


def call(capsys, *argv):
    code = run([str(word) for word in argv])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def assert_refused(result, message, folder):
    code, out, err = result
    assert (code, out) == (2, ""), err
    assert message in err
    assert len(err.splitlines()) == 1 and err.startswith("error: ")
    assert "Traceback" not in err
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("argv", [(), ("-h",), ("--help",)])
def test_eskin_alone_lists_its_commands(argv, capsys):
    code, out, err = call(capsys, *argv)
    assert (code, err) == (0, "")
    assert out.strip() == format_overview().strip()
    for name in COMMANDS:
        assert f"eskin {name}\n" in out


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_every_option_and_says_what_it_is_for(name, capsys):
    _, command_type = load_command(name)
    with pytest.raises(SystemExit) as stop:
        run([*name.split(), "--help"])
    assert stop.value.code == 0
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert command_type.__doc__.splitlines()[0] in words
    assert "--json" in words
    for field in fields(command_type):
        if "Positional" not in str(field.type) and field.name not in NESTED:
            assert "--" + field.name.replace("_", "-") in words


@pytest.mark.parametrize("name", COMMANDS)
def test_an_unknown_option_is_one_line(name, empty, capsys):
    result = call(capsys, *name.split(), *RIGHT[name], "--colour", "red")
    says = f"error: eskin {name}: Unrecognized options: --colour, red"
    assert_refused(result, says, empty)


@pytest.mark.parametrize(
    "name", ["convert", "generate", "evaluate", "run", "replay", "train"]
)
def test_a_missing_argument_is_one_line(name, empty, capsys):
    result = call(capsys, *name.split())
    assert_refused(result, f"error: eskin {name}: ", empty)


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - OF_NO_PATH))
def test_a_path_that_does_not_exist_is_one_line(name, empty, capsys):
    argv = [word if word != "sleeve" else "gone" for word in RIGHT[name]]
    if name == "convert":
        argv[0] = "sleeve"
    assert_refused(call(capsys, *name.split(), *argv), "error: ", empty)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("dance",), "no command 'dance'; commands: convert, label, train"),
        (("skin",), "no command 'skin'; commands: skin show, skin check; see"),
        (("skin", "paint"), "no command 'skin'"),
        (("--json", "train"), "no command '--json'"),
        (("convert", "glove", "in", "out"), "'glove' for argument 'dataset'"),
        (("train", "a", "--out", "m", "--seed", "x"), "--seed"),
        (("train", "a", "--out", "m", "--train.epochs", "0"), "epochs is 0; allowed"),
        (("train", "a", "--out"), "--out"),
        (("label", "a", "--threshold", "much"), "--threshold"),
        (("skin", "check", "sleeve", "--tolerance", "much"), "--tolerance"),
        (("run", "--source", "sim:a", "--record", "b", "--piece-mb", "inf"), "finite"),
    ],
)
def test_a_wrong_word_is_one_line_that_names_it(argv, message, empty, capsys):
    assert_refused(call(capsys, *argv), message, empty)


def test_a_complaint_of_many_lines_becomes_one(monkeypatch, capsys):
    from eskin.cli import skin

    def fail(command: skin.CheckCommand) -> None:
        raise ValueError("first\n  second")

    monkeypatch.setattr(skin, "run_check", fail)
    code, _, err = call(capsys, "skin", "check", "sleeve")
    assert (code, err) == (2, "error: first second\n")


def test_a_library_that_is_missing_is_named_with_what_installs_it(monkeypatch, capsys):
    from eskin.cli import skin

    def fail(command: skin.CheckCommand) -> None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    monkeypatch.setattr(skin, "run_check", fail)
    code, _, err = call(capsys, "skin", "check", "sleeve")
    message = "error: torch is missing; install it: pip install 'eskin[train]'\n"
    assert (code, err) == (2, message)


def test_a_bug_is_not_taken_for_bad_input(monkeypatch):
    from eskin.cli import skin

    def fail(command: skin.CheckCommand) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(skin, "run_check", fail)
    with pytest.raises(ZeroDivisionError):
        run(["skin", "check", "sleeve"])


@pytest.mark.parametrize(("word", "code"), [("sleeve", 0), ("gone", 2)])
def test_the_program_exits_with_the_code(word, code, monkeypatch, empty):
    monkeypatch.setattr(sys, "argv", ["eskin", "skin", "check", word])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == code


def test_json_is_one_object_on_the_last_line_and_only_where_asked(capsys):
    _, out, _ = call(capsys, "skin", "show", "sleeve", "--json")
    result = json.loads(out.splitlines()[-1])
    assert set(result) == {
        "name",
        "taxels",
        "area_cm2",
        "density_per_cm2",
        "calibrated",
        "patches",
        "picture",
    }
    _, plain, _ = call(capsys, "skin", "show", "sleeve")
    assert "{" not in plain
    _, out, _ = call(capsys, "skin", "check", "sleeve", "--json")
    assert json.loads(out.splitlines()[-1]) == {"problems": []}


@pytest.mark.parametrize("command", ["show", "check"])
def test_a_skin_table_without_a_column_is_one_line(command, tmp_path, capsys):
    save_skin(build_grid_skin(2, 3), tmp_path / "skin")
    table = tmp_path / "skin" / "taxels.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    column = rows[0].index("nz")
    lines = [",".join(row[:column] + row[column + 1 :]) for row in rows]
    table.write_text("\n".join(lines))
    code, _, err = call(capsys, "skin", command, tmp_path / "skin")
    assert code == 2
    assert "nz" in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (math.nan, "frame 1 holds nan; allowed are 0 to 255"),
        (math.inf, "frame 1 holds inf; allowed are 0 to 255"),
        (256.5, "frame 1 holds 256.5; allowed are 0 to 255"),
        (None, "frame 1"),
    ],
)
def test_a_number_that_no_sensor_sends_is_not_converted(
    value, message, tmp_path, capsys
):
    source = tmp_path / "in"
    source.mkdir()
    frames = [{"label": "None", "data": np.zeros((19, 27)).tolist()} for _ in range(3)]
    frames[1]["data"][2][3] = value
    text = json.dumps({"timestamp": "20250521150749", "frames": frames})
    (source / "Grab_20250521150749.json").write_text(text)
    code, out, err = call(capsys, "convert", "sleeve", source, tmp_path / "out")
    assert (code, out) == (2, "")
    assert message in err and "Grab_20250521150749.json" in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [source]


def test_a_sleeve_file_of_another_size_is_not_converted(tmp_path, capsys):
    source = tmp_path / "in"
    source.mkdir()
    frames = [{"label": "None", "data": np.zeros((18, 27)).tolist()}]
    text = json.dumps({"timestamp": "20250521150749", "frames": frames})
    (source / "Grab_20250521150749.json").write_text(text)
    code, _, err = call(capsys, "convert", "sleeve", source, tmp_path / "out")
    assert code == 2
    assert "shape (18, 27); allowed is (19, 27)" in err
    assert list(tmp_path.iterdir()) == [source]


COUNTS, HEARD, Q = np.zeros(4, np.int32), np.ones(4, bool), np.zeros(2)
PRESSURE = np.array([0, np.nan, 0, 0], np.float32)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Scan(0, COUNTS, HEARD[:3], Q),
            "received has shape (3,); allowed is (4,); give every taxel of the skin",
        ),
        (
            lambda: Scan(0, COUNTS.astype(np.float64), HEARD, Q),
            "counts is float64; allowed is an array of signed integers; convert it",
        ),
        (
            lambda: Scan(0, [0, 0, 0, 0], HEARD, Q),
            "counts is list; allowed is an array of signed integers; convert it",
        ),
        (
            lambda: Scan(0, COUNTS, HEARD, Q, np.zeros((4, 3), np.int32)),
            "shear has shape (4, 3); allowed is (4, 2); give every taxel",
        ),
        (
            lambda: Scan(0.5, COUNTS, HEARD, Q),
            "stamp is float 0.5; allowed is int, nanoseconds since the epoch; convert",
        ),
        (
            lambda: Scan(0, COUNTS, HEARD, np.array([0.0, np.nan])),
            "q of joint 1 is nan; allowed are finite numbers [rad]; send the last",
        ),
        (
            lambda: Reading(0, PRESSURE, HEARD, Q),
            "pressure of taxel 1 is nan but marked valid; allowed are finite numbers; "
            "mark the taxel as not valid",
        ),
        (
            lambda: Reading(0, PRESSURE, HEARD[:1], Q),
            "valid has shape (1,); allowed is (4,); give every taxel of the skin",
        ),
    ],
)
def test_an_instant_that_cannot_be_says_what_is_wrong_and_what_to_do(make, message):
    with pytest.raises(ReadingError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "boxed",
    [
        "╭─ Parsing error ──╮\n│ two words │\n├───┤\n│ full help │\n╰───╯\n",
        "-----------\ntwo words\n-----------\nfull help\n",
    ],
)
def test_the_box_around_a_complaint_leaves_no_trace(boxed):
    assert format_one_line(boxed, "train") == "eskin train: two words full help"


def test_numbers_in_a_complaint_stay_and_positions_go():
    text = "for argument '0.dataset': 0.5, 10.x and a.0.b are not 1.json"
    expected = "for argument 'dataset': 0.5, 10.x and a.0.b are not json"
    assert format_one_line(text, "convert") == f"eskin convert: {expected}"
