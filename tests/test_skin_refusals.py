"""Wrong skins are refused, each in one line that names what is wrong."""

from hashlib import sha256
from types import SimpleNamespace

import pytest

from eskin.errors import RobotError, SkinError, SkinMismatchError
from eskin.robot import load_robot
from eskin.skin import (
    SKIN_PRESETS,
    MountedSkin,
    Skin,
    build_grid_skin,
    load_skin,
    mount_skin,
    skin_from_bytes,
)
from eskin.skin.layout import build_outline_skin
from eskin.skin.presets import UR5_OUTLINES, UR5_PARTS
from helpers.refusals import REFUSALS, check_refusal, refusal
from helpers.skins import BOX_ARM, MANIFEST, TABLE, write_files, write_skin

UR5 = load_skin("ur5")
DOCTYPE = BOX_ARM.replace("<robot", '<!DOCTYPE a [<!ENTITY b "c">]><robot')
TWO_WRONG = MANIFEST.replace("rows: 2", "rows: x").replace("address: 2", "address: -1")


def change(old, new, *parts):
    """Return the row of the files of a skin of which some text is replaced."""

    def call(folder):
        load_skin(write_files(folder, *files))

    files = [text.replace(old, new) for text in (MANIFEST, TABLE)]
    assert files != [MANIFEST, TABLE]
    return refusal(new or f"no {old}", SkinError, call, *parts)


def table(name, data, part):
    """Return the row of a skin with some bytes as the table of its taxels."""

    def call(folder):
        (write_files(folder) / "taxels.csv").write_bytes(data)
        load_skin(folder)

    return refusal(name, SkinError, call, part)


def stored(name, data, part):
    """Return the row of a skin that is stored as some bytes in another file."""

    def call(folder):
        skin_from_bytes(data, "touch.mcap")

    return refusal(name, SkinError, call, "touch.mcap", part)


def digest(text, error, *parts):
    """Return the row of a skin that gives a digest for a robot with entities."""

    def call(folder):
        skin = write_skin(folder)
        (skin / "robot.urdf").write_text(DOCTYPE)
        manifest = (skin / "skin.yaml").read_text()
        kept = manifest.partition("robot_sha256: ")[2].split()[0]
        (skin / "skin.yaml").write_text(manifest.replace(kept, text))
        mount_skin(skin)

    return refusal(f"robot with digest {text:.12}", error, call, *parts)


def link_out(folder):
    """Load a skin whose table is a link to a file outside of its folder."""
    (folder / "skin").mkdir()
    inside = write_files(folder / "skin") / "taxels.csv"
    inside.rename(folder / "secret.csv")
    inside.symlink_to(folder / "secret.csv")
    load_skin(folder / "skin")


def link_in_a_circle(folder):
    """Load a skin whose table is a link to itself."""
    inside = write_files(folder) / "taxels.csv"
    inside.unlink()
    inside.symlink_to("taxels.csv")
    load_skin(folder)


def check_short_areas(folder):
    """Check the arrays of a skin whose areas are too few."""
    skin = load_skin("shearsense")
    short = SimpleNamespace(**vars(skin) | {"areas": skin.areas[1:]})
    Skin.__post_init__(short)  # Constructing one fails in the check of shapes.


ROWS = [
    refusal(
        "unknown skin",
        SkinError,
        lambda folder: load_skin(folder / "none"),
        ", ".join(SKIN_PRESETS),
    ),
    refusal("empty folder", SkinError, load_skin, "skin.yaml does not exist"),
    change(",nz", "", "taxels.csv line 1", "'nz' is missing"),
    change("nz,", "nz,colour,", "line 1", "'colour'"),
    change("ny,nz", "ny,ny,nz", "line 1", "'ny'", "twice"),
    change("area_mm2", "area_mm2,tx", "line 1", "'ty', 'tz' is missing"),
    change("0.058", "wide", "line 6, column x", "'wide'", "finite"),
    change("0.058", "inf", "line 6, column x", "'inf'", "finite"),
    change("0.058", "", "line 6, column x", "''", "finite"),
    change("4,right,0", "3,right,0", "line 6, column id", "got 3", "line 5"),
    change("4,right,0", "9,right,0", "id 4 is missing", "0 to 4"),
    change("4,right,0", "-4,right,0", "column id", "'-4'", "from 0"),
    change("4,right", "4,top", "column patch", "'top'"),
    change("4,right,0", "4,right,1", "column row", "'1'", "integer from 0 to"),
    change("4,right,0,1", "4,right,0,2", "column column", "'2'", "integer"),
    change("4,right,0,1", "4,right,0,1.0", "column column", "'1.0'", "integer"),
    change("1,64\n", "1,0\n", "column area_mm2", "'0'", "above 0"),
    change("1,64\n", "1,big\n", "column area_mm2", "'big'", "above 0"),
    change("1,64\n", "1,64,5\n", "line 5", "12 cells, allowed 11"),
    change("1,64\n", "1\n", "line 5", "10 cells, allowed 11"),
    change("0,0,1,64", "0,0,0,64", "'right', taxel 3", "normal", "length 0,"),
    change("name: small\n", "", "skin.yaml", "name is missing"),
    change("address: 1", "address: one", "patches[0].address", "'one'"),
    change("rows: 2", "rows: 0", "patches[0].rows: got 0, allowed is 1 or more"),
    change("rows: 2", "rows: 2, rows: 3", "line 3, column 48", "the key"),
    change("kind: shear", "kind: heat", "patches[1].kind", "'heat'", "'pressure'"),
    change("link: arm, address: 1", "address: 1", "patches[0].link is missing"),
    change("kind: shear", "colour: red", "patches[1].colour", "allowed id"),
    change("id: right", "id: left", "patch 'left'", "2 times"),
    change("name: small", "name: [small", "YAML", "expected"),
    change("name: small", "name: &a small\nunits: *a", "aliases"),
    change("name: small", "name: !!python/name:os.system", "YAML", "tag"),
    change("name: small", "version: 2\nname: small", "version", "got 2", "1"),
    change("name: small", "name: small\ntaxels: ../t.csv", "leaves the folder"),
    change("name: small", "name: small\ntaxels: other.csv", "other.csv", "not exist"),
    change(MANIFEST, "- 1\n- 2\n", "skin.yaml", "[1, 2]", "mapping"),
    change(MANIFEST, "", "skin.yaml", "None", "mapping"),
    change(MANIFEST, "name: a\npatches: []\n", "patches", "[]"),
    change(MANIFEST, "[" * 500 + "]" * 500, "more than 20"),
    refusal(
        "two wrong entries",
        SkinError,
        lambda folder: load_skin(write_files(folder, TWO_WRONG)),
        "patches[0].rows",
        "patches[1].address",
    ),
    change("0.0", "?", "column x: got '?1'", "3 more", "eskin skin check"),
    table("table of other bytes", b"id,\xff\n", "taxels.csv: byte 3 "),
    table("empty table", b"", "line 1: column 'id', 'patch'"),
    table("table without taxels", TABLE.splitlines()[0].encode(), "no taxels"),
    refusal("link out of the folder", SkinError, link_out, "leaves the folder"),
    refusal(
        "links in a circle",
        SkinError,
        link_in_a_circle,
        "cannot be read: Too many levels of symbolic links",
    ),
    stored("other bytes", b"\xff\xfe", "byte 0 "),
    stored("no table", b"name: a\n", "'...'"),
    stored("wrong table", MANIFEST.encode() + b"...\n" + b"id\n", "taxels line 1"),
    refusal(
        "areas of too few taxels",
        ValueError,
        check_short_areas,
        "areas",
        "(35,)",
        "(36,)",
    ),
    refusal(
        "robot without its links",
        SkinMismatchError,
        lambda folder: MountedSkin(UR5, load_robot("table")),
        "'table'",
        ": forearm_link, upper",
    ),
    *(
        refusal(
            f"grid of {size}",
            ValueError,
            lambda _, size=size: build_grid_skin(*size),
            f"{size[0]} x {size[1]} taxels with pitch {size[2]} m",
            "at least 1 x 1 and a pitch above 0",
        )
        for size in ((0, 4, 0.01), (4, 0, 0.01), (4, 4, 0.0), (4, 4, float("nan")))
    ),
    refusal(
        "unknown patch",
        ValueError,
        lambda folder: UR5.find_taxels("knee"),
        "'knee'",
        "upper_arm_front",
    ),
    refusal(
        "unknown patch of outlines",
        ValueError,
        lambda folder: build_outline_skin("ur5", UR5_OUTLINES, UR5_PARTS, ("knee",)),
        "'knee'",
        "upper_arm_front",
    ),
    *(
        digest(wrong, SkinError, "robot_sha256", wrong[:9], "allowed is 64")
        for wrong in ("a" * 63, "G" * 64, "../arm.urdf")
    ),
    digest(sha256(DOCTYPE.encode()).hexdigest(), RobotError, "DOCTYPE"),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_skin_is_refused_in_one_line(error, call, parts, tmp_path):
    check_refusal(error, call, parts, tmp_path)
