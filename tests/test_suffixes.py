"""Tests that each kind of file is told by its name in one module alone."""

import ast
import re

import pytest

from eskin.cli.checks import check_files, check_picture, check_writable
from eskin.errors import EskinError
from eskin.recording import find_recordings, is_recording, list_recordings
from eskin.skin import load_skin
from eskin.skin.picture import PICTURE_SUFFIXES, draw_skin
from helpers.learning import record
from helpers.source import MODULES, name_module, parse_module

SUFFIX = re.compile(
    r"\.(mcap|safetensors|png|svg|pdf|jpg|dxf|npz|npy|parquet|csv|tsv|txt|json|gz|ya?ml"
    r"|urdf|xacro|html)$"
)
"""End of the name of a file whose format eskin reads or writes."""
VARIABLE = re.compile(r"[*?%{}()\[\]\\]")
"""Characters of a pattern of names, or of a name that is filled in."""
OTHER_KINDS = {
    ".csv": {
        "eskin.design.files": "taxels of a patch that is to be made",
        "eskin.design.formats": "positions of GenTact",
        "eskin.sets.conversion": "tables of public sets",
    },
    ".json": {
        "eskin.design.files": "map of the taxels of a patch",
        "eskin.sets.conversion": "files of the sleeve set",
    },
    ".npz": {
        "eskin.learn.prepared_recording": "recordings that are prepared for training",
        "eskin.sets.conversion": "tables of public sets",
    },
    ".parquet": {
        "eskin.exports.lerobot": "parts of a LeRobot data set",
        "eskin.sets.conversion": "tables of public sets",
    },
    ".svg": {
        "eskin.design.files": "drawings of patches that are to be cut",
        "eskin.skin.picture": "pictures",
    },
}
"""Suffixes that files of several kinds have, by the modules that own a kind."""


def find_suffixes(path):
    """Yield the suffixes by which a module tells or names files of a kind.

    These are suffixes alone, patterns, and ends of names that are filled in. Texts with
    blanks are for people, and a name that is whole is of one file.
    """
    nodes = parse_module(path)
    docs = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    pieces = {
        id(piece)
        for node in nodes
        if isinstance(node, ast.JoinedStr)
        for piece in node.values
    }
    for node in nodes:
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        text = node.value
        found = SUFFIX.search(text)
        if id(node) in docs or found is None or re.search(r"\s", text):
            continue
        is_bare = text.startswith(".")
        if is_bare or id(node) in pieces or VARIABLE.search(text):
            yield found[0]


def test_each_kind_of_file_is_told_by_its_name_in_one_module():
    owners = {}
    for path in MODULES:
        module = name_module(path).removesuffix(".__init__")
        for suffix in find_suffixes(path):
            owners.setdefault(suffix, set()).add(module)
    several = {suffix: names for suffix, names in owners.items() if len(names) > 1}
    assert several == {suffix: set(kinds) for suffix, kinds in OTHER_KINDS.items()}
    assert owners[".mcap"] == {"eskin.recording.mcap_file"}
    assert owners[".safetensors"] == {"eskin.live.model_file"}


@pytest.fixture
def recording(tmp_path):
    return record(tmp_path / "a.mcap", ("tap",), calibrated=True)


@pytest.mark.parametrize("name", ["a.mcap", "a.bin", "a.png"])
@pytest.mark.parametrize("kept", ["whole", "cut", "damaged"])
def test_a_recording_is_one_by_its_name_or_by_its_first_bytes(recording, name, kept):
    path = recording.rename(recording.with_name(name))
    content = path.read_bytes()
    parts = {"whole": content, "cut": content[:100], "damaged": b"x" + content[1:]}
    path.write_bytes(parts[kept])
    known = name == "a.mcap" or kept != "damaged"
    assert is_recording(path) == known
    if known:
        with pytest.raises(EskinError, match="is a recording, which no command repl"):
            check_writable(path)
    else:
        check_writable(path)
    if known and kept == "damaged":
        with pytest.raises(EskinError, match=r"a\.mcap"):
            check_files(["train", str(path)])


def test_folders_are_searched_for_recordings_alike(recording, tmp_path):
    recording.with_name("b.bin").write_bytes(recording.read_bytes())
    (tmp_path / "c.mcap.txt").write_text("no recording")
    assert list_recordings(tmp_path) == [recording]
    assert find_recordings([tmp_path]) == (recording,)
    assert not is_recording(tmp_path)


@pytest.mark.parametrize("suffix", ["", ".jpg", ".txt", ".mcap", ".png.gz"])
def test_other_pictures_are_refused_alike_before_and_when_they_are_drawn(
    suffix, tmp_path
):
    path = tmp_path / f"a{suffix}"
    told = r"is no picture that can be drawn; allowed are \.png, \.svg, \.pdf"
    with pytest.raises(ValueError, match=told):
        check_picture(path)
    with pytest.raises(ValueError, match=told):
        draw_skin(load_skin("bent"), path)
    assert not path.exists()


@pytest.mark.parametrize("suffix", [*PICTURE_SUFFIXES, ".PNG"])
def test_pictures_that_are_allowed_are_drawn(suffix, tmp_path):
    path = tmp_path / f"a{suffix}"
    check_picture(path)
    draw_skin(load_skin("bent"), path)
    assert path.stat().st_size > 1000
