"""Tests of the page of results: its parts run again, and its figures stand once."""

import re
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from lab import results
from lab.program import run_program

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "results.md").read_text()
SECTIONS = {section.partition("\n")[0]: section for section in PAGE.split("\n## ")[1:]}
BLOCK = re.compile(r"^```\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"python -m lab\..+|eskin (?:bench|demo) .+")
COMMIT = re.compile(r"\b[0-9a-f]{8}\b|not known")
FIGURE = re.compile(r"\d(?:[\d.]*\d)?(?= ?(?:%|ms|s)\b| ?%)")
DECIMAL = re.compile(r"-?\d+\.\d+")


def find_commands(section):
    """Return the commands of a section: of its blocks, and of its sentences."""
    lines = "\n".join(BLOCK.findall(section)).splitlines()
    spans = re.findall(r"`([^`\n]+)`", BLOCK.sub("", section))
    return [each for each in [*lines, *spans] if COMMAND.fullmatch(each)]


def test_every_command_of_the_page_belongs_to_one_part_of_its_heading():
    on_page = Counter(
        (heading, command)
        for heading, section in SECTIONS.items()
        for command in find_commands(section)
    )
    of_parts = Counter(
        (part.heading, command) for part in results.PAGE for command in part.commands
    )
    assert on_page == of_parts
    assert set(of_parts.values()) == {1}
    assert len(results.PARTS) == len(results.PAGE)


def test_every_table_of_the_page_tells_its_commit():
    for heading, section in SECTIONS.items():
        before = ""
        for line in section.splitlines():
            if line.startswith("|") and not before.startswith("|"):
                is_told = heading == "Twelve figures" or COMMIT.search(before)
                assert is_told or "| commit |" in line, line
            before = line or before


ROWS = {
    "sleeve worn on an arm": "sleeve, 7, three seeds",
    "ShearSense pad, 18 gestures": "ShearSense, pressure, 18",
    "ShearSense pad with its shear": "with shear, 18",
    "SocialTouch array, 32 gestures": "SocialTouch, 32",
    "simulated UR5 skin, 4 gestures": "the paper's network, trained until it stops",
}
"""Rows of the README by their beginnings, each with its row of the results."""
PAPER = {"91.1"}
"""Figures of the README that the paper reports itself."""


def find_row(text, begin):
    """Return the one row of a table that begins so."""
    (row,) = [line for line in text.splitlines() if line.startswith(f"| {begin}")]
    return row


@pytest.mark.parametrize(("begin", "row"), ROWS.items())
def test_row_of_the_readme_has_the_figures_of_the_results(begin, row):
    figures = DECIMAL.findall(find_row((ROOT / "README.md").read_text(), begin))
    assert len(figures) >= 4
    assert set(figures) <= set(DECIMAL.findall(find_row(PAGE, row)))


def test_readme_has_no_figure_that_is_in_no_table():
    text = (ROOT / "README.md").read_text()
    rows = {find_row(text, begin) for begin in ROWS}
    rest = "\n".join(line for line in text.splitlines() if line not in rows)
    paper = (ROOT / "docs" / "paper.md").read_text()
    assert set(FIGURE.findall(rest.replace("[95 %]", ""))) == PAPER
    assert all(f"{figure} %" in paper for figure in PAPER)


@pytest.fixture
def part(monkeypatch):
    """A part of three commands, which write a line into a file of its folder each."""
    code = "import sys; open(sys.argv[1], 'a').write(sys.argv[2]); print(sys.argv[2])"
    commands = [f'python -c "{code}" FOLDER/log.txt {n}' for n in range(3)]
    part = results.Part("short", "Heading", tuple(commands))
    monkeypatch.setattr(results, "PAGE", (part,))
    monkeypatch.setattr(results, "PARTS", {"short": part})
    monkeypatch.setattr(results, "find_commit", lambda root: "11111111")
    monkeypatch.setattr(results, "find_changes", lambda root: [])
    return part


def run(tmp_path, *words):
    """Run the program on sets in a folder, and return its exit code."""
    argv = ["run", "--sets", str(tmp_path / "my sets"), *words]
    return run_program(results.run_results, argv)


def read_log(tmp_path, part):
    """Return what the commands have written, in their order."""
    return (results.find_folder(tmp_path / "my sets", part) / "log.txt").read_text()


def test_run_goes_on_where_it_was_cut(tmp_path, part, monkeypatch):
    whole = results.run_command
    begun = []

    def cut(argv, timeout):
        begun.append(argv)
        if len(begun) == 2:
            raise KeyboardInterrupt
        return whole(argv, timeout)

    monkeypatch.setattr(results, "run_command", cut)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path)
    assert read_log(tmp_path, part) == "0"
    assert run(tmp_path) == 0
    assert read_log(tmp_path, part) == "012"
    assert run(tmp_path) == 0
    assert read_log(tmp_path, part) == "012"
    outputs = results.read_outputs(tmp_path / "my sets", part)
    assert [each.output for each in outputs.values()] == ["0", "1", "2"]
    assert tuple(outputs) == part.commands


def test_output_of_another_commit_is_measured_again(
    tmp_path, part, monkeypatch, capsys
):
    assert run(tmp_path) == 0
    commit = "22222222"
    monkeypatch.setattr(results, "find_commit", lambda root: commit)
    argv = ["list", "--sets", str(tmp_path / "my sets")]
    assert run_program(results.run_results, argv) == 0
    assert "| short | Heading | 0 of 3 | 11111111 |" in capsys.readouterr().out
    assert run(tmp_path) == 0
    assert read_log(tmp_path, part) == "012", "the folder begins empty"
    outputs = results.read_outputs(tmp_path / "my sets", part).values()
    assert {each.commit for each in outputs} == {commit}


def test_command_that_fails_is_not_kept(tmp_path, part, monkeypatch, capsys):
    code = "print('a finding'); print('1 of 9'); exit(1)"
    bad = replace(part, commands=(*part.commands[:1], f'python -c "{code}"'))
    monkeypatch.setattr(results, "PAGE", (bad,))
    monkeypatch.setattr(results, "PARTS", {"short": bad})
    assert run(tmp_path) == 2
    out, err = capsys.readouterr()
    assert "a finding" in out
    assert "ended with 1, and printed last: 1 of 9" in err.splitlines()[-1]
    assert len(results.read_outputs(tmp_path / "my sets", bad)) == 1


def test_command_is_ended_when_the_time_is_over(tmp_path, part, monkeypatch, capfd):
    endless = replace(part, commands=('python -c "import time; time.sleep(60)"',))
    monkeypatch.setattr(results, "PAGE", (endless,))
    monkeypatch.setattr(results, "PARTS", {"short": endless})
    assert run(tmp_path, "--minutes", "0.001") == 0
    assert "are over" in capfd.readouterr().out
    assert not results.read_outputs(tmp_path / "my sets", endless)


MEASURED = (
    "src/a.py",
    "lab/paper/a.py",
    "plugins/paper_network/eskin_paper_network/a.py",
    "constraints.txt",
)
"""Files that a figure depends on."""
UNMEASURED = ("docs/a.py", "README.md", "lab/README.md", "lab/notes/a.md", "tests/a.py")
"""Files that no figure depends on."""


@pytest.fixture
def clone(tmp_path):
    """A folder with a commit of some files, and what runs git in it."""

    def git(*words):
        argv = ["git", "-c", "user.name=a", "-c", "user.email=a@b", *words]
        subprocess.run(argv, cwd=tmp_path, check=True, capture_output=True)

    git("init")
    for place in (*MEASURED, *UNMEASURED):
        path = tmp_path / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1\n")
    git("add", ".")
    git("commit", "-m", "first")
    return tmp_path, git


@pytest.mark.parametrize("place", [*MEASURED, *UNMEASURED])
def test_commit_is_the_last_that_changed_what_a_figure_depends_on(clone, place):
    root, git = clone
    first = results.find_commit(root)
    assert re.fullmatch("[0-9a-f]{8}", first)
    assert results.find_changes(root) == []
    (root / place).write_text("2\n")
    assert results.find_changes(root) == ([place] if place in MEASURED else [])
    git("commit", "-am", "second")
    assert (results.find_commit(root) != first) == (place in MEASURED)
    assert results.find_changes(root) == []


def test_new_file_is_a_change_too(clone):
    root, _ = clone
    (root / "lab" / "new.py").write_text("1\n")
    assert results.find_changes(root) == ["lab/new.py"]


def test_nothing_is_run_nor_lost_where_the_code_differs_from_its_commit(
    tmp_path, part, monkeypatch, capsys
):
    assert run(tmp_path) == 0
    paths = [path for path in (tmp_path / "my sets").rglob("*") if path.is_file()]
    before = {path: path.read_bytes() for path in paths}
    assert before
    monkeypatch.setattr(results, "find_changes", lambda root: ["lab/new.py"])
    capsys.readouterr()
    assert run(tmp_path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "such as lab/new.py; allowed is the code of commit 11111111" in line
    assert "commit or remove" in line
    assert before == {path: path.read_bytes() for path in paths}
    argv = ["list", "--sets", str(tmp_path / "my sets")]
    assert run_program(results.run_results, argv) == 0
    out = capsys.readouterr().out
    assert "| short | Heading | 3 of 3 | 11111111 |" in out
    assert "commit 11111111, and differs in lab/new.py" in out


@pytest.mark.parametrize(
    ("found", "changes", "got"),
    [
        ("11111111", ["lab/new.py"], "such as lab/new.py;"),
        ("22222222", [], "22222222;"),
    ],
)
def test_output_of_code_that_changed_while_it_ran_is_not_kept(
    tmp_path, part, monkeypatch, capsys, found, changes, got
):
    whole = results.run_command

    def change(argv, timeout):
        monkeypatch.setattr(results, "find_commit", lambda root: found)
        monkeypatch.setattr(results, "find_changes", lambda root: changes)
        return whole(argv, timeout)

    monkeypatch.setattr(results, "run_command", change)
    assert run(tmp_path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert got in line
    assert read_log(tmp_path, part) == "0", "no command is run after it"
    assert not results.read_outputs(tmp_path / "my sets", part)


def test_make_fuzz_runs_the_commands_of_its_part():
    """It runs them each time, and without git, so it names them itself."""
    recipe = (
        (ROOT / "Makefile").read_text().partition("\nfuzz:")[2].partition("\n\n")[0]
    )
    commands = [line.strip() for line in recipe.splitlines()[1:]]
    of_part = results.PARTS["fuzz"].commands
    assert commands == [f"$(BIN)/{command}" for command in of_part]


def test_unknown_part_is_refused_in_one_line(tmp_path, part, capsys):
    assert run(tmp_path, "long") == 2
    assert "part 'long'; allowed are short" in capsys.readouterr().err


def test_program_is_called_by_the_words_that_start_it(capsys):
    with pytest.raises(SystemExit):
        run_program(results.run_results, ["--help"])
    words = " ".join(capsys.readouterr().out.split())
    assert words.startswith("usage: python -m lab.results ")
    assert run_program(results.run_results, ["list", "--colour"]) == 2
    assert "see python -m lab.results --help" in capsys.readouterr().err
