"""Tests of skin files: they keep every bit, and problems are named in one line."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.errors import SkinError
from eskin.skin import (
    SKIN_PRESETS,
    Patch,
    Skin,
    build_grid_skin,
    load_skin,
    parse_skin_folder,
    save_skin,
    skin_from_bytes,
    skin_to_bytes,
)

MANIFEST = """\
name: small
patches:
  - {id: left, link: arm, address: 1, rows: 2, columns: 2}
  - {id: right, link: arm, address: 2, rows: 1, columns: 2, kind: shear, units: kPa}
"""
TABLE = """\
id,patch,row,column,x,y,z,nx,ny,nz,area_mm2
0,left,0,0,0,0,0,0,0,1,100
1,left,0,1,0.01,0,0,0,0,1,100
2,left,1,0,0,0.01,0,0,0,1,100
3,right,0,0,0.05,0,0,0,0,1,64
4,right,0,1,0.058,0,0,0,0,1,64
"""
FILES = {"skin.yaml", "taxels.csv"}
FLAT = replace(load_skin("flat"), calibrated=True)


def write_files(folder, manifest=MANIFEST, table=TABLE):
    """Write the files of a skin and return their folder."""
    (folder / "skin.yaml").write_text(manifest)
    (folder / "taxels.csv").write_text(table)
    return folder


def get_error(folder):
    """Return the message with which a folder is refused."""
    with pytest.raises(SkinError) as error:
        load_skin(folder)
    assert "\n" not in str(error.value)
    return str(error.value)


def random_skin(rng, count=50):
    """Build a skin of random taxels, with names that YAML could misread."""
    normals, other = rng.standard_normal((2, count, 3))
    tangents = np.cross(normals, other)
    return Skin(
        name="zufällig: yes, 'quoted'",
        patches=(
            Patch("a, b", "link one", 7, 1, count, "shear", "kPa"),
            Patch("null", "true", 0, 1, count),
        ),
        patch_index=rng.integers(0, 2, count),
        rows=np.zeros(count, dtype=np.int64),
        columns=np.arange(count),
        positions=rng.standard_normal((count, 3)) * 10.0 ** rng.integers(-9, 0),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        areas=rng.uniform(1e-7, 1e-3, count),
        tangents=tangents / np.linalg.norm(tangents, axis=1, keepdims=True),
        calibrated=bool(rng.integers(2)),
    )


def to_plain(skin):
    """Return the fields of a skin, arrays as shapes and bytes."""
    return {
        name: (value.shape, value.tobytes()) if hasattr(value, "tobytes") else value
        for name, value in vars(skin).items()
    }


@pytest.mark.parametrize("seed", range(5))
def test_bytes_and_folder_keep_a_random_skin_exactly(tmp_path, seed):
    skin = random_skin(np.random.default_rng(seed))
    folder = tmp_path / "deep" / "skin"
    save_skin(skin, folder)
    again = skin_from_bytes(skin_to_bytes(skin))
    for other in (again, load_skin(folder), load_skin(folder / "skin.yaml")):
        assert to_plain(other) == to_plain(skin)


@pytest.mark.parametrize("name", ["ur5", "sleeve", "shearsense"])
def test_bytes_keep_a_preset_exactly(name):
    skin = load_skin(name)
    assert to_plain(skin_from_bytes(skin_to_bytes(skin))) == to_plain(skin)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"positions": 1e3 * FLAT.positions}, "m wide, allowed up to 5 m: are its"),
        ({"positions": FLAT.positions + 20.0}, "from the frame of link"),
        ({"positions": 0 * FLAT.positions}, "in one place"),
        ({"positions": np.nan * FLAT.positions}, "nan"),
        ({"areas": 0 * FLAT.areas}, "area_mm2"),
        ({"normals": -2 * FLAT.normals}, "normal has length 2"),
        ({"rows": FLAT.rows + 999}, "row"),
        ({"name": " flat"}, "name"),
        ({"patches": (replace(FLAT.patches[0], id="a\nb"),)}, "patches[0].id"),
        ({"patches": FLAT.patches * 2}, "2 times"),
    ],
)
def test_skin_that_cannot_be_read_is_not_written(tmp_path, changes, text):
    save_skin(load_skin("sleeve"), tmp_path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(SkinError) as error:
        save_skin(replace(FLAT, **changes), tmp_path)
    assert text in str(error.value) and "\n" not in str(error.value)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_nominal_lengths_of_a_wide_table_are_kept(tmp_path):
    save_skin(build_grid_skin(1, 2000, 0.01), tmp_path)
    assert load_skin(tmp_path).count == 2000


def test_saving_replaces_a_skin(tmp_path):
    save_skin(load_skin("flat"), tmp_path)
    save_skin(load_skin("sleeve"), tmp_path)
    assert load_skin(tmp_path).name == "sleeve"
    assert {path.name for path in tmp_path.iterdir()} == FILES


def test_order_of_lines_byte_order_mark_and_blank_lines_change_nothing(tmp_path):
    head, *lines = TABLE.splitlines()
    expected = to_plain(load_skin(write_files(tmp_path)))
    for table in (
        "\n".join([head, *lines[::-1]]),
        "\ufeff" + TABLE.replace("\n", "\r\n") + "\r\n\r\n",
    ):
        assert to_plain(load_skin(write_files(tmp_path, table=table))) == expected


def test_skin_of_a_file_without_tangents_gets_some(tmp_path):
    skin = load_skin(write_files(tmp_path))
    np.testing.assert_allclose(np.linalg.norm(skin.tangents, axis=1), 1)
    np.testing.assert_allclose(np.sum(skin.tangents * skin.normals, axis=1), 0)
    np.testing.assert_allclose(skin.areas, [1e-4, 1e-4, 1e-4, 6.4e-5, 6.4e-5])
    assert skin.has_shear and skin.link_names == ("arm", "arm")


@pytest.mark.parametrize(
    ("old", "new", "texts"),
    [
        (",nz", "", ["taxels.csv line 1", "'nz' is missing"]),
        ("nz,", "nz,colour,", ["line 1", "'colour'"]),
        ("ny,nz", "ny,ny,nz", ["line 1", "'ny'", "twice"]),
        ("area_mm2", "area_mm2,tx", ["line 1", "'ty', 'tz' is missing"]),
        ("0.058", "wide", ["line 6, column x", "'wide'", "finite"]),
        ("0.058", "inf", ["line 6, column x", "'inf'", "finite"]),
        ("0.058", "", ["line 6, column x", "''", "finite"]),
        ("4,right,0", "3,right,0", ["line 6, column id", "got 3", "line 5"]),
        ("4,right,0", "9,right,0", ["id 4 is missing", "0 to 4"]),
        ("4,right,0", "-4,right,0", ["column id", "'-4'", "from 0"]),
        ("4,right", "4,top", ["column patch", "'top'"]),
        ("4,right,0", "4,right,1", ["column row", "'1'", "integer from 0 to"]),
        ("4,right,0,1", "4,right,0,2", ["column column", "'2'", "integer"]),
        ("4,right,0,1", "4,right,0,1.0", ["column column", "'1.0'", "integer"]),
        ("1,64\n", "1,0\n", ["column area_mm2", "'0'", "above 0"]),
        ("1,64\n", "1,big\n", ["column area_mm2", "'big'", "above 0"]),
        ("1,64\n", "1,64,5\n", ["line 5", "12 cells, allowed 11"]),
        ("1,64\n", "1\n", ["line 5", "10 cells, allowed 11"]),
        ("0,0,1,64", "0,0,0,64", ["'right', taxel 3", "normal", "length 0,"]),
        ("name: small\n", "", ["skin.yaml", "name is missing"]),
        ("address: 1", "address: one", ["patches[0].address", "'one'"]),
        ("rows: 2", "rows: 0", ["patches[0].rows", "got 0", "1"]),
        ("rows: 2", "rows: 2, rows: 3", ["line 3, column 48", "the key"]),
        ("kind: shear", "kind: heat", ["patches[1].kind", "'heat'", "'pressure'"]),
        ("link: arm, address: 1", "address: 1", ["patches[0].link is missing"]),
        ("kind: shear", "colour: red", ["patches[1].colour", "allowed id"]),
        ("id: right", "id: left", ["patch 'left'", "2 times"]),
        ("name: small", "name: [small", ["YAML"]),
        ("name: small", "name: &a small\nunits: *a", ["aliases"]),
        ("name: small", "name: !!python/name:os.system", ["YAML"]),
        ("name: small", "version: 2\nname: small", ["version", "got 2", "1"]),
        ("name: small", "name: small\ntaxels: ../t.csv", ["leaves the folder"]),
        ("name: small", "name: small\ntaxels: other.csv", ["other.csv", "not exist"]),
        (MANIFEST, "- 1\n- 2\n", ["skin.yaml", "[1, 2]", "mapping"]),
        (MANIFEST, "", ["skin.yaml", "None", "mapping"]),
        (MANIFEST, "name: a\npatches: []\n", ["patches", "[]"]),
        (MANIFEST, "[" * 500 + "]" * 500, ["more than 20"]),
    ],
)
def test_invalid_file_is_refused_with_its_place(tmp_path, old, new, texts):
    files = (text.replace(old, new) for text in (MANIFEST, TABLE))
    error = get_error(write_files(tmp_path, *files))
    assert all(text in error for text in texts), error


def test_every_invalid_entry_is_named_or_counted(tmp_path):
    text = MANIFEST.replace("rows: 2", "rows: x").replace("address: 2", "address: -1")
    error = get_error(write_files(tmp_path, manifest=text))
    assert "patches[0].rows" in error and "patches[1].address" in error
    error = get_error(write_files(tmp_path, table=TABLE.replace("0.0", "?")))
    assert "column x: got '?1'" in error
    assert "3 more" in error and "eskin skin check" in error
    assert len(parse_skin_folder(tmp_path).problems) == 4


def test_missing_and_empty_files_are_refused(tmp_path):
    assert ", ".join(SKIN_PRESETS) in get_error(tmp_path / "none")
    assert "skin.yaml" in get_error(tmp_path)
    for table, text in (
        (b"id,\xff\n", "taxels.csv: byte 3 "),
        (b"", "line 1: column 'id', 'patch'"),
        (TABLE.splitlines()[0].encode(), "no taxels"),
    ):
        (write_files(tmp_path) / "taxels.csv").write_bytes(table)
        assert text in get_error(tmp_path)


def test_link_out_of_the_folder_is_not_followed(tmp_path):
    (tmp_path / "skin").mkdir()
    folder = write_files(tmp_path / "skin")
    (folder / "taxels.csv").rename(tmp_path / "secret.csv")
    (folder / "taxels.csv").symlink_to(tmp_path / "secret.csv")
    assert "leaves the folder" in get_error(folder)


def test_links_in_a_circle_are_refused(tmp_path):
    table = write_files(tmp_path) / "taxels.csv"
    table.unlink()
    table.symlink_to("taxels.csv")
    assert "cannot be read: Too many levels of symbolic links" in get_error(tmp_path)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\xff\xfe", "byte 0 "),
        (b"name: a\n", "'...'"),
        (MANIFEST.encode() + b"...\n" + b"id\n", "taxels line 1"),
    ],
)
def test_invalid_bytes_are_refused_with_their_source(data, text):
    with pytest.raises(SkinError) as error:
        skin_from_bytes(data, "touch.mcap")
    assert str(error.value).startswith("touch.mcap") and text in str(error.value)


def test_arrays_of_different_lengths_are_refused():
    skin = load_skin("shearsense")
    short = SimpleNamespace(**vars(skin) | {"areas": skin.areas[1:]})
    with pytest.raises(ValueError, match=r"areas.*\(35,\).*\(36,\)"):
        Skin.__post_init__(short)  # Constructing one fails in the check of shapes.
