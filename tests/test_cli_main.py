"""Tests of what all commands share: help, one line of JSON, one line of error."""

import ast
import contextlib
import errno
import inspect
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

import pytest

import eskin.__main__
import eskin.cli.main as main_module
from eskin.cli.main import BAD_INPUT, COMMANDS, STOPPED, load_command, main, run
from eskin.cli.options import find_field_text, list_options
from eskin.cli.parse_errors import REWRITTEN, flatten, rewrite_parse_error
from eskin.errors import PlatformError
from eskin.registry import advise_install
from helpers.guided import make_scans, record, rest

ARGUMENTS = {
    "convert": "sleeve in out",
    "generate": "out",
    "label": "a.mcap",
    "train": "a.mcap --out m",
    "evaluate": "m a.mcap",
    "compare": "--train a --test b",
    "run": "--source replay:a.mcap",
    "device": "gone --play a.mcap",
    "export": "gone.mcap --rosbag bag",
    "calibrate": "replay:gone.mcap --out a.json",
    "view": "a.mcap",
    "record": "replay:gone.mcap --out a.mcap --gestures a b",
    "demo": "--headless",
    "replay": "a.mcap --model m",
    "report": "gone.mcap --out a.html",
    "skin show": "gone",
    "skin check": "gone",
    "skin design": "gone.urdf --out skin",
    "skin place": "gone.urdf --link a --rows 2 --columns 2 --pitch-mm 5 -o b",
    "skin paint": "gone.urdf --spec spec.yaml",
    "skin convert": "gone out",
    "skin pose": "replay:gone.mcap --points p.csv --out skin",
    "skin points": "gone --out p.csv",
    "bench latency": "--steps 10",
    "bench throughput": "--seconds 1",
    "doctor": "",
}
"""Arguments of each command that are valid but for paths that do not exist."""
WITHOUT_PATH = {"generate", "demo", "bench latency", "bench throughput", "doctor"}
NESTED = {"train", "config"}
"""Fields that are configurations of their own."""


def call(capsys, words):
    code = run(words.split())
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def refuse(tmp_path, monkeypatch, capsys):
    """Call a command that must be refused in one line and leave nothing."""
    monkeypatch.chdir(tmp_path)

    def refuse(words, *parts):
        code, out, err = call(capsys, words)
        assert (code, out) == (2, ""), err
        assert err.startswith("error: ") and err.count("\n") == 1
        assert all(part in err for part in parts), err
        assert list(tmp_path.iterdir()) == []

    return refuse


@pytest.mark.parametrize("words", ["", "-h", "--help"])
def test_overview_lists_commands(words, capsys):
    code, out, err = call(capsys, words)
    assert (code, err) == (0, "")
    for name in COMMANDS:
        assert re.search(rf"^  eskin {name} +[a-z].*$", out, re.MULTILINE)


def test_options_of_commands_are_told_without_large_packages():
    code = (
        "import sys; from eskin.cli.main import COMMANDS, load_command; "
        "[load_command(name) for name in COMMANDS]; "
        "print(*sys.modules.keys() & {'torch', 'igl', 'trimesh', 'matplotlib'})"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (told.stdout, told.stderr) == ("\n", "")


def test_help_of_a_group_lists_its_commands(capsys):
    code, out, err = call(capsys, "skin --help")
    assert (code, err) == (0, "")
    listed = re.findall(r"^  eskin (.*?)  ", out, re.MULTILINE)
    assert [one.strip() for one in listed] == [c for c in COMMANDS if c[:5] == "skin "]


@pytest.mark.parametrize("is_terminal", [False, True])
@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("words", ["", "skin", *COMMANDS])
def test_help_is_as_wide_as_the_terminal_and_breaks_between_words(
    words, width, is_terminal, monkeypatch, capsys
):
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr("sys.stdout.isatty", lambda: is_terminal)
    with contextlib.suppress(SystemExit):
        run([*words.split(), "--help"])
    shown = re.sub("\x1b\\[[0-9;]*m", "", capsys.readouterr().out)
    assert max(map(len, shown.splitlines())) <= width
    if words in COMMANDS:
        _, command_type = load_command(words)
        paragraphs = (inspect.getdoc(command_type) or "").split("\n\n")
        usage, *described = shown.split("\n\n")[: len(paragraphs) + 1]
        assert usage.startswith(f"usage: eskin {words}")
        assert [each.split() for each in described] == [p.split() for p in paragraphs]


@pytest.mark.parametrize("shell", ["bash", "zsh"])
@pytest.mark.parametrize("words", ["run", "skin check"])
def test_script_that_completes_options_holds_no_description(words, shell, capsys):
    with pytest.raises(SystemExit) as stop:
        run([*words.split(), "--tyro-print-completion", shell])
    script = capsys.readouterr().out
    _, command_type = load_command(words)
    first = (inspect.getdoc(command_type) or "").splitlines()[0]
    assert not stop.value.code and "tyro" in script and first not in script


def test_first_interrupt_stops_and_a_hasty_second_one_does_not_hang(monkeypatch):
    raised = []
    now = [0.0]
    monkeypatch.setattr(main_module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(main_module.signal, "signal", lambda *_: None)
    monkeypatch.setattr(main_module.signal, "raise_signal", raised.append)
    interrupt = main_module.Interrupt()
    with pytest.raises(KeyboardInterrupt):
        interrupt(2, None)
    for now[0], count in ((0.2, 0), (3.0, 1)):
        interrupt(2, None)
        assert len(raised) == count


def test_interrupt_before_the_command_is_read_ends_the_process(monkeypatch):
    before = signal.getsignal(signal.SIGINT)
    seen = []
    look = lambda: seen.append(signal.getsignal(signal.SIGINT))  # noqa: E731
    monkeypatch.setattr(main_module, "main", look)
    try:
        eskin.__main__.main()
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIG_DFL]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemError("returned")])
def test_interrupted_command_says_so_in_one_line(error, monkeypatch, capsys):
    def interrupt(name, rest):
        raise error from (None if error.args == () else KeyboardInterrupt())

    monkeypatch.setattr(main_module, "run_command", interrupt)
    assert call(capsys, "doctor") == (STOPPED, "", "error: stopped\n")


@pytest.mark.parametrize("lacking", ["fcntl", "termios"])
def test_system_that_lacks_what_linux_has_is_refused_in_one_line(
    lacking, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, lacking, None)
    code, out, err = call(capsys, "run --source sim:ur5")
    assert (code, out) == (BAD_INPUT, "")
    assert len(err.splitlines()) == 1 and "Windows" in err and lacking in err
    monkeypatch.delitem(vars(eskin), "load_robot", raising=False)
    with pytest.raises(PlatformError, match=lacking):
        _ = eskin.load_robot


def test_version_is_that_of_the_package(capsys):
    assert call(capsys, "--version") == (0, f"eskin {version('eskin')}\n", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_describes_command_and_names_every_option(name, capsys):
    _, command_type = load_command(name)
    with pytest.raises(SystemExit) as stop:
        run([*name.split(), "--help"])
    assert stop.value.code == 0
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert command_type.__doc__.splitlines()[0] in words
    assert "--json" in words
    assert not re.search(r"\(default: ?(None|False|True)?\)|\{None|\[\[", words)
    for field in fields(command_type):
        if "Positional" not in str(field.type) and field.name not in NESTED:
            assert "--" + field.name.replace("_", "-") in words


@pytest.mark.parametrize("name", COMMANDS)
def test_unknown_option_is_refused(name, refuse):
    words = f"{name} {ARGUMENTS[name]} --colour red"
    refuse(words, "--colour is no option", f"see eskin {name} --help")


def test_messages_name_options_that_exist():
    known = {"--json", "--help", "--version", "--head", "--results"}
    for name in COMMANDS:
        known |= set(list_options(load_command(name)[1]))
    named = {
        (path.name, option.replace(".no-", "."))
        for path in Path(eskin.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for option in re.findall(r"(?<![\w-])--[a-z][\w.-]*\w", node.value)
    }
    groups = {one.rpartition(".")[0] for one in known}
    assert {(path, one) for path, one in named if one not in known | groups} == set()


@pytest.mark.parametrize("name", ["convert", "generate", "evaluate", "run", "train"])
def test_missing_argument_is_refused(name, refuse):
    refuse(name, "is missing: ", f"see eskin {name} --help")


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - WITHOUT_PATH))
def test_missing_path_is_refused(name, refuse):
    refuse(f"{name} {ARGUMENTS[name]}")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (
            "skin convert ur5 y --to sking",
            ("--to is 'sking'; allowed are gentact, icub, skin, urdf; see",),
        ),
        ("dance", ("'dance'", "run, demo, record")),
        ("skin", ("'skin'", "skin show, skin check")),
        ("skin dye", ("'skin dye'",)),
        ("--json train", ("'--json'",)),
        ("convert glove in out", ("dataset is 'glove'; allowed are sleeve, s",)),
        ("train a --out m --seed x", ("--seed is 'x'; allowed is a whole number",)),
        ("run --source a --seconds x", ("--seconds is 'x'; allowed is a number;",)),
        ("run --source a --q 1 b", ("--q is '1 b'; allowed is a number for each",)),
        (
            "skin place ur5 --link a --rows 1 --columns 1 --pitch-mm 1 --out b --at 1",
            ("--at is '1'; allowed is a number 3 times",),
        ),
        ("export a --to parquet", ("--to is 'parquet'; allowed is a name and a path",)),
        ("run --source a --pace", ("--pace has no value; give one",)),
        ("calibrat x", ("did you mean calibrate?",)),
        ("skin chek a", ("no command 'skin chek'", "did you mean skin check?")),
        ("record x --out y --gesture a b", ("did you mean --gestures?",)),
        ("train a --out m --epochs 3", ("did you mean --train.epochs?",)),
        ("calibrate x --out y --robot a", ("did you mean --robot-urdf?",)),
        ("demo --headles", ("--headles is no option", "did you mean --headless?")),
        (
            "train a --out m --train.shares a b",
            ("--train.shares is no name and number",),
        ),
        ("train a --out m --train.epochs 0", ("--train.epochs is 0", "allowed is")),
        ("train a --out m --train.rate nan", ("--train.rate is nan", "1e-09 to 1")),
        (
            "train a --out m --skins -1",
            ("--skins is -1; allowed are finite numbers from 0",),
        ),
        ("label a --threshold nan", ("--threshold is nan", "from 0")),
        (
            "view a.mcap --seconds nan",
            ("--seconds is nan; allowed are numbers above 0",),
        ),
        ("train a --out", ("--out has no value",)),
        ("label a --threshold much", ("--threshold is 'much'; allowed is",)),
        ("skin check sleeve --tolerance much", ("--tolerance is 'much'; allowed",)),
        ("skin check sleeve --tolerance -1", ("--tolerance is -1", "from 0")),
        ("run --source sim:a --record b --piece-mb inf", ("finite",)),
        ("run --source a --ros2-reliable", ("is given without --ros2; allowed",)),
        ("run --source a --foxglove-port 1", ("is given without --foxglove;",)),
        (
            "run --source a --joints b --robot sim:ur5",
            ("--robot is given with --joints",),
        ),
    ],
)
def test_invalid_word_is_refused_and_named(words, parts, refuse):
    refuse(words, *parts)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("first\n  second"), "first second"),
        (
            ModuleNotFoundError("No module named 'torch'", name="torch"),
            f"torch is missing; install it: {advise_install()}",
        ),
        (
            OSError(errno.ENOSPC, "No space left on device", "/data/a.mcap"),
            "no space left on device (/data/a.mcap); free some space, or write to "
            "another disk",
        ),
        (
            OSError(errno.EIO, "Input/output error", "/data/a.mcap"),
            "input/output error (/data/a.mcap); see that the file can be used",
        ),
    ],
)
def test_error_becomes_one_line(error, message, fail_check, capsys):
    fail_check(error)
    assert call(capsys, "skin check sleeve") == (2, "", f"error: {message}\n")


def test_bug_is_not_taken_for_bad_input(fail_check):
    fail_check(ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        run(["skin", "check", "sleeve"])


@pytest.fixture
def fail_check(monkeypatch):
    """Make `eskin skin check` raise an error."""
    from eskin.design.commands import check

    def replace(error):
        def fail(command: check.CheckCommand) -> None:
            raise error

        monkeypatch.setattr(check, "run", fail)

    return replace


@pytest.mark.parametrize(("word", "code"), [("sleeve", 0), ("gone", 2)])
def test_program_exits_with_code(word, code, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["eskin", "skin", "check", word])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == code


def test_json_is_last_line_where_asked(capsys):
    _, out, _ = call(capsys, "skin show sleeve --json")
    keys = {"name", "taxels", "area_cm2", "density_per_cm2", "calibrated", "patches"}
    assert set(json.loads(out.splitlines()[-1])) == keys | {"picture"}
    _, out, _ = call(capsys, "skin show sleeve")
    assert "{" not in out
    _, out, _ = call(capsys, "skin check sleeve --json")
    assert json.loads(out.splitlines()[-1]) == {"problems": []}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "╭─ Parsing error ──╮\n│ two words │\n├───┤\n│ help │\n╰───╯\n",
            "two words help",
        ),
        ("-----------\ntwo words\n-----------\nhelp\n", "two words help"),
        (
            "for argument '0.dataset': 0.5, 10.x and a.0.b are not 1.json",
            "for argument 'dataset': 0.5, 10.x and a.0.b are not json",
        ),
    ],
)
def test_error_of_parser_is_reduced_to_its_words(text, expected):
    assert rewrite_parse_error(text, "eskin train") == f"eskin train: {expected}"


@pytest.mark.parametrize("name", COMMANDS)
def test_only_words_without_other_capitals_begin_small_in_a_message(name):
    command = load_command(name)[1]
    for field in fields(command):
        text = find_field_text(command, field.name) or "Name"
        missing = f"Missing from eskin: --it PATH {text} (required)"
        told = rewrite_parse_error(missing, f"eskin {name}")
        first = told.removeprefix("--it is missing: ").split()[0].rstrip(".,;:")
        own = text.split()[0].rstrip(".,;:")
        has_others = any(letter.isupper() for letter in own[1:])
        assert first == (own if has_others else own.lower())


TOLD_BY_TYRO = (
    "train",
    "train a --out",
    "convert glove in out",
    "train a --out m --seed x",
    "run --source a --seconds x",
    "run --source a --q 1 b",
    "export a --to parquet",
    "train a --out m --train.shares a b",
    "train a --out m --train.shares a b c",
    "train a --out m --train.epochs 0",
    "train a --out m --train.epochs x",
)
"""Words that tyro refuses, each in a form of its own."""


def test_patterns_are_those_of_what_the_installed_tyro_prints(monkeypatch, capsys):
    texts = []

    def note(message, name, options=()):
        texts.append(flatten(message))
        return "refused"

    monkeypatch.setattr(main_module, "rewrite_parse_error", note)
    for words in TOLD_BY_TYRO:
        assert run(words.split()) == BAD_INPUT
    assert len(texts) == len(TOLD_BY_TYRO)
    used = {
        pattern
        for pattern, _ in REWRITTEN
        for text in texts
        if re.search(pattern, text)
    }
    assert used == {pattern for pattern, _ in REWRITTEN}
    assert all(any(re.search(one, text) for one in used) for text in texts)


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_closed_output_is_refused_in_one_line(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, name, None)
    assert run(["--version"]) == 2
    out, err = capsys.readouterr()
    assert (out + err).count("\n") == 1 and "is closed" in out + err


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["skin", "show", "ur5"]])
def test_full_disk_behind_the_output_is_said_in_one_line(words, monkeypatch, capsys):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert run(words) == 2
        monkeypatch.undo()
        with pytest.raises(OSError):
            full.flush()
        os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())
    assert re.fullmatch("error: no space left on device.*\n", capsys.readouterr().err)


def test_too_little_memory_is_said_in_one_line(monkeypatch, capsys):
    def exhaust(_):
        raise MemoryError("cannot allocate 9 GiB")

    monkeypatch.setattr("eskin.cli.main.split_command", exhaust)
    assert run(["doctor"]) == 2
    assert re.fullmatch("error: too little memory .*9 GiB.*\n", capsys.readouterr().err)


def test_closed_output_ends_a_command_quietly():
    script = Path(sys.executable).with_name("eskin")
    words = [str(script), "skin", "check", "sleeve", "--json"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == STOPPED


KEPT = "kept.mcap"
OUTPUTS = {
    "run": "--source sim:ur5 --seconds 1 --record OUT",
    "record": "replay:gone.mcap --gestures a b --out OUT",
    "replay": "made.mcap --record OUT",
    "train": "made.mcap --out OUT",
    "evaluate": "ur5 made.mcap --picture OUT",
    "export": "ur5 --onnx OUT",
    "report": "made.mcap --out OUT",
    "calibrate": "replay:made.mcap --out OUT",
    "device": "ur5 --calibration OUT",
    "label": "made.mcap --out FOLDER",
    "skin show": "ur5 --out OUT",
    "skin design": "ur5 --out skin --picture OUT",
    "skin place": "ur5 --link forearm_link --rows 2 --columns 2 --pitch-mm 5 -o skin"
    " --picture OUT",
    "skin paint": "ur5 --spec OUT",
    "skin convert": "ur5 OUT --to gentact",
    "skin points": "ur5 --out OUT",
}
"""Arguments by which a command would write to a file that is there."""
WRITE_NO_FILES_THAT_ARE_NAMED = {
    "demo",
    "view",
    "generate",
    "convert",
    "skin check",
    "skin pose",
    "bench latency",
    "bench throughput",
    "doctor",
}
"""Commands that write nothing, or into folders; tests of their own say what they keep.
"""


@pytest.mark.parametrize("name", OUTPUTS)
def test_no_command_replaces_a_recording(name, tmp_path, monkeypatch, capsys):
    """Whatever it would write there, and also what is left of one that was stopped."""
    assert OUTPUTS.keys() | WRITE_NO_FILES_THAT_ARE_NAMED == COMMANDS.keys()
    monkeypatch.chdir(tmp_path)
    made = record(tmp_path / "made.mcap", make_scans(rest(20)))
    folder = tmp_path / "folder"
    folder.mkdir()
    kept = folder / ("made.mcap" if "FOLDER" in OUTPUTS[name] else KEPT)
    kept.write_bytes(made.read_bytes())
    before = sorted(tmp_path.rglob("*"))
    words = OUTPUTS[name].replace("OUT", str(kept)).replace("FOLDER", str(folder))
    code, _, err = call(capsys, f"{name} {words}")
    assert code in (1, 2) and err.splitlines()[-1].startswith("error: ")
    assert kept.name in err and ("already" in err or "a recording" in err)
    assert sorted(tmp_path.rglob("*")) == before
    assert kept.read_bytes() == made.read_bytes()
