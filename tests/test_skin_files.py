"""Tests of skin files: they keep every bit, and problems are named in one line."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import SkinError
from eskin.skin import (
    Patch,
    Skin,
    build_grid_skin,
    load_skin,
    parse_skin_folder,
    save_skin,
    skin_from_bytes,
    skin_to_bytes,
)
from helpers.skins import TABLE, write_files

FILES = {"skin.yaml", "taxels.csv"}
FLAT = replace(load_skin("flat"), calibrated=True)


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


def test_check_of_a_table_finds_every_invalid_entry(tmp_path):
    write_files(tmp_path, table=TABLE.replace("0.0", "?"))
    assert len(parse_skin_folder(tmp_path).problems) == 4
