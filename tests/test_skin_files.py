"""Skin files keep every bit, and say in one line what is wrong with them."""

from types import SimpleNamespace

import numpy as np
import pytest

from eskin.errors import SkinError
from eskin.skin import (
    SKIN_PRESETS,
    Patch,
    Skin,
    load_skin,
    parse_skin_folder,
    save_skin,
    skin_from_bytes,
    skin_to_bytes,
)

ARRAYS = ("patch_index", "rows", "columns", "positions", "normals", "areas", "tangents")

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


def write(folder, manifest=MANIFEST, table=TABLE):
    (folder / "skin.yaml").write_text(manifest)
    (folder / "taxels.csv").write_text(table)
    return folder


def message(folder):
    with pytest.raises(SkinError) as caught:
        load_skin(folder)
    text = str(caught.value)
    assert "\n" not in text
    return text


def random_skin(rng, count=50):
    normals = rng.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.cross(normals, rng.standard_normal((count, 3)))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return Skin(
        name="zufällig: yes, 'quoted'",
        patches=(
            Patch("a, b", "link one", 7, 1, count, "shear", "kPa"),
            Patch("null", "true", 0, 1, count),
        ),
        patch_index=rng.integers(0, 2, count),
        rows=np.zeros(count, dtype=np.int64),
        columns=np.arange(count),
        positions=rng.standard_normal((count, 3)) * 10.0 ** rng.integers(-9, 3),
        normals=normals,
        areas=rng.uniform(1e-7, 1e-3, count),
        tangents=tangents,
        calibrated=bool(rng.integers(2)),
    )


def assert_same(one, other):
    assert (one.name, one.patches) == (other.name, other.patches)
    assert one.calibrated == other.calibrated
    for name in ARRAYS:
        a, b = getattr(one, name), getattr(other, name)
        assert a.shape == b.shape
        assert a.tobytes() == b.tobytes(), name


@pytest.mark.parametrize("seed", range(5))
def test_text_and_folder_keep_a_random_skin_to_the_last_bit(tmp_path, seed):
    skin = random_skin(np.random.default_rng(seed))
    assert_same(skin, skin_from_bytes(skin_to_bytes(skin)))
    save_skin(skin, tmp_path / "deep" / "skin")
    assert_same(skin, load_skin(tmp_path / "deep" / "skin"))
    assert_same(skin, load_skin(tmp_path / "deep" / "skin" / "skin.yaml"))


@pytest.mark.parametrize("name", ["ur5", "sleeve", "shearsense"])
def test_text_keeps_every_preset_to_the_last_bit(name):
    skin = load_skin(name)
    assert_same(skin, skin_from_bytes(skin_to_bytes(skin)))


def test_saving_again_replaces_the_skin_and_leaves_nothing_else(tmp_path):
    save_skin(load_skin("ur5"), tmp_path)
    save_skin(load_skin("sleeve"), tmp_path)
    assert load_skin(tmp_path).name == "sleeve"
    assert {p.name for p in tmp_path.iterdir()} == {"skin.yaml", "taxels.csv"}


def test_a_save_that_fails_leaves_the_old_skin_whole(tmp_path, monkeypatch):
    save_skin(load_skin("sleeve"), tmp_path)

    def full(path, text, **_):
        path.touch()
        raise OSError("no space left")

    monkeypatch.setattr(type(tmp_path), "write_text", full)
    with pytest.raises(OSError, match="no space left"):
        save_skin(load_skin("ur5"), tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"skin.yaml", "taxels.csv"}
    assert load_skin(tmp_path).name == "sleeve"


def test_the_ids_fix_the_order_whatever_the_order_of_the_lines(tmp_path):
    head, *lines = TABLE.splitlines()
    straight = load_skin(write(tmp_path))
    write(tmp_path, table="\n".join([head, *lines[::-1]]))
    assert_same(straight, load_skin(tmp_path))


def test_a_file_without_tangents_gets_unit_ones_across_the_normals(tmp_path):
    skin = load_skin(write(tmp_path))
    assert np.allclose(np.linalg.norm(skin.tangents, axis=1), 1)
    assert np.allclose(np.sum(skin.tangents * skin.normals, axis=1), 0)
    assert skin.has_shear and skin.count == 5 and skin.link_names == ("arm", "arm")
    assert np.allclose(skin.areas, [1e-4, 1e-4, 1e-4, 6.4e-5, 6.4e-5])


def test_a_spreadsheets_byte_order_mark_and_blank_lines_do_no_harm(tmp_path):
    write(tmp_path, table="\ufeff" + TABLE.replace("\n", "\r\n") + "\r\n\r\n")
    assert load_skin(tmp_path).count == 5


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (",nz", "", "taxels.csv line 1: column 'nz' is missing"),
        ("nz,", "nz,colour,", "line 1: column 'colour' is not known"),
        ("ny,nz", "ny,ny,nz", "line 1: column 'ny' stands twice"),
        ("area_mm2", "area_mm2,tx", "line 1: column 'ty', 'tz' is missing"),
        ("0.058", "wide", "line 6, column x: got 'wide', allowed a finite number"),
        ("0.058", "nan", "line 6, column x: got 'nan', allowed a finite number"),
        ("0.058", "inf", "line 6, column x: got 'inf', allowed a finite number"),
        ("0.058", "", "line 6, column x: got '', allowed a finite number"),
        ("4,right,0", "3,right,0", "line 6, column id: got 3, which line 5 has too"),
        ("4,right,0", "9,right,0", "id 4 is missing; allowed the ids 0 to 4"),
        ("4,right,0", "-4,right,0", "column id: got '-4', allowed an integer from 0"),
        ("4,right", "4,top", "column patch: got 'top', allowed the patches of skin"),
        ("4,right,0", "4,right,1", "column row: got '1', allowed an integer from 0 to"),
        ("4,right,0,1", "4,right,0,2", "column column: got '2', allowed an integer"),
        ("4,right,0,1", "4,right,0,1.0", "column column: got '1.0', allowed an"),
        (
            "1,64\n",
            "1,0\n",
            "column area_mm2: got '0', allowed a finite number above 0",
        ),
        ("1,64\n", "1,NaN\n", "column area_mm2: got 'NaN', allowed a finite number"),
        ("1,64\n", "1,big\n", "column area_mm2: got 'big', allowed a finite number"),
        ("1,64\n", "1,64,5\n", "line 5: got 12 cells, allowed 11"),
        ("1,64\n", "1\n", "line 5: got 10 cells, allowed 11"),
        ("0,0,1,64", "0,0,0,64", "'right', taxel 3: normal has length 0, allowed 1"),
        ("0,0,1,64", "0,0,1.01,64", "normal has length 1.01, allowed 1 +- 0.001"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, old, new, expected):
    assert expected in message(write(tmp_path, table=TABLE.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("name: small\n", "", "skin.yaml: name is missing; add it"),
        ("address: 1", "address: one", "patches[0].address: got 'one', be a valid int"),
        ("rows: 2", "rows: 0", "patches[0].rows: got 0, be greater than or equal to 1"),
        ("rows: 2", "rows: 2, rows: 3", "line 3, column 48: not plain YAML: the key"),
        ("kind: shear", "kind: heat", "patches[1].kind: got 'heat', be 'pressure' or"),
        ("link: arm, address: 1", "address: 1", "patches[0].link is missing; add it"),
        ("kind: shear", "colour: red", "patches[1].colour is not known, allowed id, l"),
        ("id: right", "id: left", "patch 'left': stands 2 times in skin.yaml"),
        ("name: small", "name: [small", "not plain YAML"),
        ("name: small", "name: &a small\nunits: *a", "aliases are not allowed"),
        ("name: small", "name: !!python/name:os.system", "not plain YAML"),
        ("name: small", "version: 2\nname: small", "version: got 2, be 1"),
        ("name: small", "name: small\ntaxels: ../t.csv", "which leaves the folder"),
        ("name: small", "name: small\ntaxels: /etc/passwd", "which leaves the folder"),
        ("name: small", "name: small\ntaxels: other.csv", "other.csv does not exist"),
        (MANIFEST, "- 1\n- 2\n", "skin.yaml: got [1, 2], allowed a mapping"),
        (MANIFEST, "", "skin.yaml: got None, allowed a mapping"),
        (MANIFEST, "name: a\npatches: []\n", "patches: got [], List should have"),
        (MANIFEST, "[" * 5000 + "]" * 5000, "more than 20 collections lie in"),
    ],
)
def test_a_wrong_manifest_is_refused_in_one_line(tmp_path, old, new, expected):
    assert expected in message(write(tmp_path, manifest=MANIFEST.replace(old, new)))


def test_every_wrong_entry_of_the_manifest_is_named_at_once(tmp_path):
    text = MANIFEST.replace("rows: 2", "rows: x").replace("address: 2", "address: -1")
    said = message(write(tmp_path, manifest=text))
    assert "patches[0].rows" in said and "patches[1].address" in said


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    (tmp_path / "secret.csv").write_text(TABLE)
    folder = tmp_path / "skin"
    folder.mkdir()
    write(folder)
    (folder / "taxels.csv").unlink()
    (folder / "taxels.csv").symlink_to(tmp_path / "secret.csv")
    assert "which leaves the folder" in message(folder)


def test_the_first_problem_is_told_with_the_number_of_the_others(tmp_path):
    said = message(write(tmp_path, table=TABLE.replace("0.0", "?")))
    assert "column x: got '?1'" in said
    assert "(and 3 more; `eskin skin check" in said
    assert len(parse_skin_folder(tmp_path).problems) == 4


def test_what_is_no_skin_is_refused_in_one_line(tmp_path):
    allowed = f"allowed a preset ({', '.join(SKIN_PRESETS)})"
    assert allowed in message(tmp_path / "none")
    assert "skin.yaml does not exist" in message(tmp_path)
    write(tmp_path)
    (tmp_path / "taxels.csv").write_bytes(b"id,\xff\n")
    assert "taxels.csv: byte 3 is not UTF-8" in message(tmp_path)
    (tmp_path / "taxels.csv").write_text("")
    assert "line 1: column 'id', 'patch'" in message(tmp_path)
    (tmp_path / "taxels.csv").write_text(TABLE.splitlines()[0])
    assert "got no taxels" in message(tmp_path)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"\xff\xfe", "touch.mcap: byte 0 is not UTF-8"),
        (b"name: a\n", "touch.mcap: got no line '...'"),
        (MANIFEST.encode() + b"...\n" + b"id\n", "touch.mcap, taxels line 1: column"),
    ],
)
def test_a_text_that_is_no_skin_names_where_it_came_from(data, expected):
    with pytest.raises(SkinError, match=expected.replace("...", r"\.\.\.")):
        skin_from_bytes(data, "touch.mcap")


def test_arrays_of_different_lengths_make_no_skin():
    good = load_skin("shearsense")
    short = SimpleNamespace(**vars(good) | {"areas": good.areas[1:]})
    with pytest.raises(ValueError, match=r"areas has shape \(35,\), allowed \(36,\)"):
        Skin.__post_init__(short)  # As without the tests' own check of shapes.
