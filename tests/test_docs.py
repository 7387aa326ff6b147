"""Tests of the documentation: the commands and names on its pages exist as they say."""

import argparse
import ast
import importlib
import importlib.util
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest
import tyro

import eskin
from eskin.cli.main import load_command, parse, run, split_command
from eskin.registry import EXPORTERS, RECOGNISERS
from helpers.learning import record_people

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
BLOCK = re.compile(
    r"^ *```(?P<kind>\w*)\n(?P<text>.*?)^ *```", re.MULTILINE | re.DOTALL
)
COMMAND = re.compile(r"(?:torchrun .* )?(?P<command>(?:eskin|make|python) .*)")
SPAN = re.compile(r"`((?:eskin|make|python)\s[^`]+)`")
FILE = re.compile(r"<<'END'.*?^END$", re.MULTILINE | re.DOTALL)
"""A file that a block of commands writes."""
MARKS = re.compile(r"[\[\]]| &$|  #.*")
"""What a page adds to a command: brackets, a comment, that it runs beside others."""
NUMBER = re.compile(r"(?<= )N(?= |$)")
"""A number that the reader chooses."""
PART = re.compile(
    r" is missing: | has no value; | is named; |is '[A-Z]+'; |"
    r"Required options|arguments are required"
)
"""What is said of a command of which a sentence names only a part."""
NAME = re.compile(r"`((?:eskin|eskin_paper_network|lab)(?:\.\w+)+)`")
"""A module, or something in one."""
GROUPS = {EXPORTERS, RECOGNISERS}
"""Names of groups of entry points that are no modules."""
SOURCE = re.compile(r"`([\w.-]+(?:/[\w.-]+)+\.(?:c|h|ino|ipynb|md|py|toml|yaml))`")
"""A file in a folder, other than those that commands write."""
ENTRY = re.compile(r"^::: (\S+)", re.MULTILINE)
"""A module or function of the reference."""
PLACES = (ROOT, ROOT / "src" / "eskin", ROOT / "src" / "eskin" / "sim")
"""Folders in which pages name files; a table of the simulator is about the last."""


GENERATE = "eskin generate OUT --clips 20"
RUN = "eskin export ur5 --onnx ur5.onnx"
"""A command of a sentence that takes seconds and needs neither files nor devices; those
of blocks are run by `test_docs_run`."""


class Accepted(BaseException):
    """The arguments of a program have been accepted; it need not run."""


def find_lines():
    """Return the command lines of all blocks, once each."""
    lines = {}
    for page in PAGES:
        for kind, text in BLOCK.findall(page.read_text()):
            text = FILE.sub("", text.replace("\\\n", " ") * (kind in ("", "bash")))
            words = (
                " ".join(MARKS.sub("", line).split()) for line in text.splitlines()
            )
            found = filter(None, map(COMMAND.fullmatch, words))
            lines |= {NUMBER.sub("1", line["command"]): None for line in found}
    return list(lines)


def find_names(pattern):
    """Return the names in sentences and tables that match a pattern, once each."""
    prose = "\n".join(BLOCK.sub("", page.read_text()) for page in PAGES)
    return set(pattern.findall(prose))


def find_spans():
    """Return the commands that stand in sentences and tables, once each."""
    spans = (" ".join(MARKS.sub("", span).split()) for span in find_names(SPAN))
    return sorted({NUMBER.sub("1", span) for span in spans} - set(find_lines()))


def check_command(line, monkeypatch):
    """Give a command line to its program, which does not run; raise what it says."""
    program, *words = shlex.split(line)
    if program == "eskin":
        name, rest = split_command(words)
        parse(load_command(name)[1], name, rest)
    elif program == "make":
        targets = re.findall(
            r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE
        )
        assert {word for word in words if "=" not in word} <= set(targets)
    elif words[0] == "-m":
        check_benchmark(words[1], words[2:], monkeypatch)
    elif words[0].startswith("examples/"):
        assert (ROOT / words[0]).is_file()


def check_benchmark(module, words, monkeypatch):
    """Let a module parse its arguments; one that takes none must get none."""
    program = find_program(module)
    text = program.read_text()
    if not re.search("tyro.cli|parse_args|sys.argv|run_p", text):
        assert words == []
        return
    monkeypatch.setattr(tyro, "cli", stop_after(tyro.cli))
    parser = argparse.ArgumentParser
    monkeypatch.setattr(parser, "parse_args", stop_after(parser.parse_args))
    monkeypatch.setattr(sys, "argv", [module, *words])
    with pytest.raises(Accepted):
        runpy.run_path(str(program), run_name="__main__")


def find_program(module):
    """Return the file of a program that `python -m` runs."""
    spec = importlib.util.find_spec(module)
    if spec is not None and spec.submodule_search_locations is not None:
        spec = importlib.util.find_spec(f"{module}.__main__")
    assert spec is not None and spec.origin is not None, module
    return Path(spec.origin)


def stop_after(function):
    """Return a function that raises as soon as another one has returned."""

    def call(*args, **options):
        function(*args, **options)
        raise Accepted

    return call


@pytest.mark.parametrize("line", find_lines())
def test_commands_of_blocks_are_accepted_by_their_programs(line, monkeypatch):
    check_command(line, monkeypatch)


@pytest.mark.parametrize("span", find_spans())
def test_commands_in_sentences_have_only_options_that_exist(span, monkeypatch, capsys):
    try:
        check_command(span.replace("...", ""), monkeypatch)
    except (ValueError, SystemExit) as stop:
        said = f"{stop} {capsys.readouterr().err}"
        assert PART.search(said), said


def resolve(name):
    """Return what a dotted name stands for: a module, or something in one."""
    module, *rest = name.split(".")
    found = importlib.import_module(module)
    while rest:
        part = rest.pop(0)
        module = f"{module}.{part}"
        if not hasattr(found, part) and importlib.util.find_spec(module):
            importlib.import_module(module)
        found = getattr(found, part)
    return found


@pytest.mark.parametrize("name", sorted(find_names(NAME) - GROUPS))
def test_every_module_and_function_that_a_page_names_exists(name):
    resolve(name)


@pytest.mark.parametrize("path", sorted(find_names(SOURCE)))
def test_every_file_of_the_repository_that_a_page_names_exists(path):
    assert any((place / path).is_file() for place in PLACES)


def test_every_module_is_on_one_page_of_the_reference():
    """The reference is not built where a name has two pages."""
    pages = (ROOT / "docs" / "api").glob("*.md")
    modules = [name for page in pages for name in ENTRY.findall(page.read_text())]
    assert sorted(modules) == sorted(set(modules))


def find_code():
    """Return the blocks of Python."""
    texts = (page.read_text() for page in PAGES)
    return [
        block
        for text in texts
        for kind, block in BLOCK.findall(text)
        if kind == "python"
    ]


@pytest.mark.parametrize("code", find_code(), ids=lambda code: code.splitlines()[-1])
def test_names_that_python_blocks_take_from_eskin_exist(code):
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("eskin"):
            module = importlib.import_module(node.module or "")
            assert [a.name for a in node.names if not hasattr(module, a.name)] == []
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            assert node.value.id != "eskin" or hasattr(eskin, node.attr), node.attr


@pytest.mark.long
def test_quick_command_of_a_sentence_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    assert RUN in find_spans()
    monkeypatch.chdir(tmp_path)
    assert run(shlex.split(RUN)[1:]) == 0, capsys.readouterr().err


def test_code_of_the_python_page_runs_from_top_to_bottom(tmp_path, monkeypatch):
    """Its folder of recordings is of two people who tap and hold."""
    monkeypatch.chdir(tmp_path)
    record_people(tmp_path / "recordings", ("ann", "bob"), gestures=("hold", "tap") * 2)
    names: dict[str, object] = {}
    page = (ROOT / "docs" / "python.md").read_text()
    for code in [text for kind, text in BLOCK.findall(page) if kind == "python"]:
        exec(code, names)
    assert (tmp_path / "skin.png").is_file()
    assert (tmp_path / "mine.safetensors").is_file()
    recording = eskin.read_recording(tmp_path / "recordings" / "ann.mcap")
    shown = recording.start + names["hardest"] * recording.period
    assert any(label.start <= shown < label.end for label in recording.labels)


def test_loops_that_push_scans_finish():
    """A touch that is still open after the last scan would be lost."""
    for page in PAGES:
        codes = [text for kind, text in BLOCK.findall(page.read_text())]
        for code in codes:
            pushes = code.count("recognizer.push(")
            assert pushes == code.count("recognizer.finish()"), page


@pytest.mark.long
def test_code_of_the_readme_recognises_what_its_command_generates(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert GENERATE in find_spans() and run(shlex.split(GENERATE)[1:]) == 0
    [code] = [text for kind, text in BLOCK.findall(README.read_text()) if kind]
    capsys.readouterr()
    exec(code, {})
    said = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert len(said) >= 3
    assert set(said) <= {*eskin.load_model("ur5").card.vocabulary, "unknown"}
