"""Tests of skins in the formats of other projects: there, back, and what is refused."""

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.design.formats.gentact import read_gentact, write_gentact
from eskin.design.formats.icub import read_icub_positions, write_icub_positions
from eskin.design.formats.tactile_urdf import read_tactile_urdf, write_tactile_urdf
from eskin.errors import SkinError
from eskin.robot import load_robot, load_urdf
from eskin.skin import (
    SKIN_PRESETS,
    check_skin,
    load_robot_for_skin,
    load_skin,
    save_skin,
)
from helpers.cli import assert_refused, call_json

URDF = """<?xml version="1.0"?>
<robot name="hand">
  <link name="palm"/>
  <link name="tip"/>
  <joint name="bend" type="fixed"><parent link="palm"/><child link="tip"/>
    <origin xyz="0 0 0.1"/></joint>
  <sensor name="palm_pad" group="hand" update_rate="100">
    <parent link="palm"/>
    <origin xyz="0.01 0.02 0.03" rpy="0.3 -0.2 0.1"/>
    <tactile><array rows="4" cols="6" order="row-major" size="0.004 0.005"
      spacing="0.006 0.007" offset="0.001 0.002"/></tactile>
  </sensor>
  <sensor name="flipped" update_rate="50">
    <parent link="palm"/>
    <origin xyz="0 0 0.05" rpy="0 0 1.2"/>
    <tactile><array rows="3" cols="3" size="0.005 0.005" spacing="0.005 -0.005"/>
    </tactile>
  </sensor>
  <sensor name="fingertip" update_rate="100">
    <parent link="tip"/>
    <origin xyz="0 0 0.01" rpy="0 1.57 0"/>
    <tactile channel="tip_data">
      <taxel idx="0" xyz="0.004 0 0.002" rpy="0.1 0 0">
        <geometry><box size="0.003 0.002 0.001"/></geometry></taxel>
      <taxel idx="2" xyz="-0.004 0 0.002" rpy="-0.4 0.2 1.0">
        <geometry><cylinder radius="0.002" length="0.001"/></geometry></taxel>
      <taxel idx="1" xyz="0 0.004 0.002" rpy="3.1 0 0">
        <geometry><box size="0.003 0.003 0.001"/></geometry></taxel>
    </tactile>
  </sensor>
  <sensor name="camera" update_rate="30"><parent link="palm"/><camera/></sensor>
</robot>
"""

ICUB = """name\tl_lower_leg
spatial_sampling\ttaxel
taxel2Repr ( 3  3  -2  3  -1  -1  -1  -1  -1  -1  -1  -1  12  12 )
[calibration]
0.050174 -0.032375 -0.009974 1.000000 0.000000 0.000000
0.046302 -0.037577 -0.010781 0.980000 0.198997 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.047079 -0.034975 -0.004839 0.707107 0.000000 0.707107
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
0.050211 0.036098 -0.004496 0.000000 1.000000 0.000000
0.049544 0.030837 -0.010392 0.000000 1.000000 0.000000
"""

GENTACT = """Index,X,Y,Z,Radius,Parent
0,0.0375,0.0,0.05,0.004,/World/arm/tube
1,0.0,0.0375,0.06,0.004,/World/arm/tube
2,-0.0375,0.0,0.02,0.005,/World/arm/tube/back
3,0.0,-0.0375,0.03,0.005,/World/arm/tube/back
"""


def assert_same(one, other):
    """Two skins are equal; numbers to what is left of them in a text."""
    assert one.patches == other.patches
    for name in ("patch_index", "rows", "columns"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name in ("positions", "normals", "tangents", "areas"):
        np.testing.assert_allclose(
            getattr(one, name), getattr(other, name), atol=1e-12, rtol=1e-9
        )


@pytest.fixture
def hand(tmp_path):
    path = tmp_path / "hand.urdf"
    path.write_text(URDF)
    return path


def test_array_lies_as_its_urdf_says(hand):
    skin = read_tactile_urdf(hand, "hand")
    patch = skin.patches[0]
    assert (patch.id, patch.link, patch.rows, patch.columns) == (
        "palm_pad",
        "palm",
        4,
        6,
    )
    taxels = skin.find_taxels("palm_pad")
    places = skin.positions[taxels].reshape(4, 6, 3)
    rows, columns = np.diff(places, axis=0), np.diff(places, axis=1)
    assert np.linalg.norm(rows, axis=2) == pytest.approx(0.006)
    assert np.linalg.norm(columns, axis=2) == pytest.approx(0.007)
    # Rows follow x, columns y, and the normal is z.
    outward = np.cross(rows[0, 0], columns[0, 0])
    assert outward / np.linalg.norm(outward) == pytest.approx(skin.normals[0])
    assert skin.areas[taxels] == pytest.approx(20e-6)
    assert np.linalg.norm(places[0, 0] - [0.01, 0.02, 0.03]) == pytest.approx(
        np.hypot(0.001, 0.002)
    )


def test_taxels_of_a_list_are_ordered_by_their_index(hand):
    skin = read_tactile_urdf(hand, "hand")
    taxels = skin.find_taxels("fingertip")
    assert skin.columns[taxels].tolist() == [0, 1, 2]
    assert skin.areas[taxels] == pytest.approx([6e-6, 9e-6, np.pi * 4e-6])
    assert [patch.address for patch in skin.patches] == [1, 2, 3]


def test_urdf_read_written_and_read_again_is_the_same_skin(hand, tmp_path):
    skin = read_tactile_urdf(hand, "hand")
    robot = load_urdf(hand)
    for number, wearer in enumerate((None, robot)):
        out = tmp_path / f"again{number}.urdf"
        write_tactile_urdf(out, skin, wearer)
        assert_same(read_tactile_urdf(out, "hand"), skin)
        assert out.read_text().count("<array") == 2
    again = load_urdf(tmp_path / "again1.urdf")
    assert again.link_names == robot.link_names
    assert 'name="camera"' in (tmp_path / "again1.urdf").read_text()


def test_curved_skin_survives_a_urdf(tmp_path):
    skin = load_skin("ur5")
    write_tactile_urdf(tmp_path / "ur5.urdf", skin, load_robot("ur5"))
    again = read_tactile_urdf(tmp_path / "ur5.urdf", "ur5")
    assert again.link_names == skin.link_names
    np.testing.assert_allclose(again.positions, skin.positions, atol=1e-12)
    np.testing.assert_allclose(again.normals, skin.normals, atol=1e-12)
    np.testing.assert_allclose(again.tangents, skin.tangents, atol=1e-12)
    np.testing.assert_allclose(again.areas, skin.areas, rtol=1e-9)
    assert load_urdf(tmp_path / "ur5.urdf").joint_names == load_robot("ur5").joint_names


@pytest.fixture
def leg(tmp_path):
    path = tmp_path / "left_leg.txt"
    path.write_text(ICUB)
    return path


def test_icub_channels_keep_their_number_and_zeros_are_no_taxels(leg):
    skin = read_icub_positions([leg], "icub")
    (patch,) = skin.patches
    assert (patch.id, patch.link, patch.columns) == ("left_leg", "l_lower_leg", 12)
    assert (12 * skin.rows + skin.columns).tolist() == [0, 1, 3, 12, 13]
    assert np.linalg.norm(skin.normals, axis=1) == pytest.approx(1.0)
    assert check_skin(skin) == [] or skin.count == 5


def test_icub_files_read_written_and_read_again_are_the_same_skin(leg, tmp_path):
    other = tmp_path / "other.txt"
    other.write_text(ICUB.replace("l_lower_leg", "r_lower_leg"))
    skin = read_icub_positions([leg, other], "icub")
    write_icub_positions(tmp_path / "again", skin)
    files = sorted((tmp_path / "again").glob("*.txt"))
    assert_same(read_icub_positions(files, "icub"), skin)
    assert files[0].read_text().count("\n") == ICUB.count("\n") + 10
    seen = ICUB.splitlines()[4].split()
    written = files[0].read_text().splitlines()[4].split()
    assert list(map(float, written)) == list(map(float, seen))


def test_grid_of_any_width_survives_icub_files(tmp_path):
    skin = load_skin("ur5")
    write_icub_positions(tmp_path, skin)
    files = [tmp_path / f"{patch.id}.txt" for patch in skin.patches]
    again = read_icub_positions(files, "ur5")
    assert again.patches == skin.patches
    np.testing.assert_allclose(again.positions, skin.positions, atol=1e-12)
    np.testing.assert_allclose(again.normals, skin.normals, atol=1e-12)


def test_confidence_of_a_position_is_left_out(leg):
    lines = ICUB.splitlines()
    lines[4:] = [f"{line} 0.5" for line in lines[4:]]
    skin = read_icub_positions([leg], "icub")
    leg.write_text("\n".join(lines))
    assert_same(read_icub_positions([leg], "icub"), skin)


@pytest.fixture
def csv_file(tmp_path):
    path = tmp_path / "skin.csv"
    path.write_text(GENTACT)
    return path


def test_gentact_normals_are_those_of_the_robot(csv_file):
    skin = read_gentact(csv_file, "gentact", load_robot("tube"))
    assert [(patch.id, patch.link) for patch in skin.patches] == [
        ("tube", "tube"),
        ("back", "tube"),
    ]
    assert skin.normals == pytest.approx(skin.positions * [1, 1, 0] / 0.0375, abs=1e-9)
    assert skin.areas == pytest.approx(np.pi * np.array([16, 16, 25, 25]) * 1e-6)


def test_gentact_file_read_written_and_read_again_is_the_same_skin(csv_file, tmp_path):
    robot = load_robot("tube")
    skin = read_gentact(csv_file, "gentact", robot)
    write_gentact(tmp_path / "again.csv", skin)
    assert_same(read_gentact(tmp_path / "again.csv", "gentact", robot), skin)


def test_gentact_electrodes_are_in_millimetres(tmp_path):
    path = tmp_path / "electrode_config.csv"
    lines = ["Index,X (mm),Y (mm),Z (mm)", "0,37.5,0,10", "1,37.5,0,18", "2,37.5,0,26"]
    path.write_text("\n".join(lines))
    skin = read_gentact(path, "electrodes", load_robot("tube"), "tube")
    assert skin.positions[:, 2] == pytest.approx([0.010, 0.018, 0.026])
    assert skin.areas == pytest.approx(64e-6)


SENSOR = """<sensor name="{0}"><parent link="palm"/><tactile channel="{1}">{2}
</tactile></sensor>"""
TAXEL = """<taxel idx="{0}" xyz="0.0{0} 0 0"><geometry><box size="0.01 0.01 0.001"/>
</geometry></taxel>"""
ARRAY = '<array rows="2" cols="3" order="{}" size="0.01 0.02"/>'


def write_sensors(path, *sensors):
    texts = [SENSOR.format(*each) for each in sensors]
    path.write_text(f'<robot name="r"><link name="palm"/>{"".join(texts)}</robot>')
    return path


def list_urdf_numbers(folder):
    """Number k lies at row k % 2 and column k // 2; or at x = k cm."""
    taxels = ["".join(map(TAXEL.format, part)) for part in ((5, 1), (0, 3))]
    array = ("pad", "c", ARRAY.format("col-major"))
    skin = read_tactile_urdf(write_sensors(folder / "a.urdf", array), "a")
    yield np.rint(skin.positions[:, 0] / 0.01 + skin.positions[:, 1] / 0.01), 6
    assert (skin.rows + 2 * skin.columns).tolist() == list(range(6))
    shared = [(name, "c", own) for name, own in zip("ab", taxels, strict=True)]
    skin = read_tactile_urdf(write_sensors(folder / "b.urdf", *shared), "b")
    yield np.rint(skin.positions[:, 0] / 0.01), [0, 1, 3, 5]


def list_gentact_numbers(folder):
    """Number k lies at z = k cm."""
    tails = {
        "Index,X,Y,Z,Radius,Parent": ",0.004,/tube",
        "Index,X,Y,Z,NormX,NormY,NormZ,Radius,Parent,Object Name in Blender": (
            ",1,0,0,0.004,/tube,Skin.001"
        ),
        "Index,X,Y,Z,Stem X,Stem Y,Stem Z,Radius,Parent": ",0,0,0,0.004,/tube",
        "Index,X,Y,Z,Object Name": ",Skin.001",
    }
    for head, tail in tails.items():
        lines = [f"{k},0.0375,0,0.0{k}{tail}" for k in (2, 1, 4, 3)]
        path = folder / "g.csv"
        path.write_text("\n".join([head, *lines]))
        skin = read_gentact(path, "g", load_robot("tube"), "tube")
        yield np.rint(skin.positions[:, 2] / 0.01), [1, 2, 3, 4]


@pytest.mark.parametrize("read", [list_urdf_numbers, list_gentact_numbers])
def test_taxels_are_in_the_order_of_the_numbers_of_their_file(read, tmp_path):
    for found, wanted in read(tmp_path):
        wanted = list(range(wanted)) if isinstance(wanted, int) else wanted
        assert found.tolist() == wanted


def test_order_of_the_data_survives_every_format(tmp_path):
    folders = iter(range(9))
    taxels = ["".join(map(TAXEL.format, part)) for part in ((5, 1), (0, 3))]
    mixed = [(name, "c", own) for name, own in zip("ab", taxels, strict=True)]
    array = [("pad", "c", ARRAY.format("col-major"))]
    for sensors in (array, mixed):
        path = write_sensors(tmp_path / "in.urdf", *sensors)
        skin = read_tactile_urdf(path, "r")
        write_tactile_urdf(tmp_path / "out.urdf", skin)
        assert_same(read_tactile_urdf(tmp_path / "out.urdf", "r"), skin)
        folder = tmp_path / str(next(folders))
        write_icub_positions(folder, skin)
        again = read_icub_positions(sorted(folder.glob("*.txt")), "r")
        for patch in skin.patches:
            own = skin.find_taxels(patch.id)
            other = again.find_taxels(patch.id)
            assert np.array_equal(skin.positions[own], again.positions[other])


def test_arrays_that_share_a_channel_are_refused(tmp_path):
    array = ARRAY.format("row-major")
    path = write_sensors(tmp_path / "a.urdf", ("a", "c", array), ("b", "c", array))
    with pytest.raises(SkinError, match="number 0 of channel 'c' twice"):
        read_tactile_urdf(path, "a")


def test_what_is_no_taxel_is_left_out_and_counted(leg, tmp_path, caplog):
    places = leg.read_text().replace(" 3  3  -2  3 ", " 3  -1  -2  -2 ")
    leg.write_text(places)
    assert read_icub_positions([leg], "icub").count == 3
    (told,) = caplog.messages
    assert "3 of 14 channels" in told
    assert "2 thermal pads, 9 unused" in told
    caplog.clear()
    path = tmp_path / "sensor_config.csv"
    path.write_text(
        "Index,X,Y,Z,Stem X,Stem Y,Stem Z,Radius,Parent\n,,,,,,,,\n"
        "left,,,,,,,,\nCLIP,37.5,0,9,,,,100,/tube\n0,37.5,0,10,0,0,0,4,/tube\n"
        "right,,,,,,,,\n0,-37.5,0,20,0,0,0,4,/tube\n"
    )
    skin = read_gentact(path, "g", load_robot("tube"))
    assert [patch.id for patch in skin.patches] == ["left", "right"]
    assert skin.positions[:, 2] == pytest.approx([0.010, 0.020])
    assert "1 CLIP" in caplog.messages[0]
    assert "millimetres" in caplog.messages[1]


WRONG = {
    "hand.urdf": [
        ("</robot>", "", ["not XML"]),
        ('rows="4"', 'rows="x"', ["palm_pad", "rows is 'x'"]),
        ('rows="4"', 'rows="0"', ["rows is 0"]),
        ('rows="4"', 'rows="60000" extra=""', ["60000 x 6"]),
        ('size="0.004 0.005"', "", ["palm_pad", "size"]),
        ('size="0.004 0.005"', 'size="0.004"', ["size is '0.004'", "2 finite"]),
        ('size="0.004 0.005"', 'size="0 0.005"', ["size", "above 0"]),
        ('order="row-major"', 'order="spiral"', ["spiral", "col-major"]),
        ('<parent link="palm"/>', "", ["palm_pad", "<parent>"]),
        ('name="palm_pad"', "", ["<sensor>", "name"]),
        ('idx="2"', 'idx="0"', ["number 0", "'tip_data' twice", "allowed is once"]),
        ('idx="2"', 'idx="-2"', ["idx is -2"]),
        ('xyz="-0.004 0 0.002"', 'xyz="nan 0 0"', ["xyz is 'nan 0 0'"]),
        ("<array", "<grid", ["0 <array>"]),
        ('name="flipped"', 'name="palm_pad"', ["'palm_pad' twice"]),
        ("</tactile>", "</tactile><tactile/>", ["2 <tactile>", "one"]),
        ('<parent link="palm"/>', '<parent link="palm"/>' * 2, ["2 <parent>", "one"]),
        ("tactile", "haptic", ["no <sensor> with <tactile>"]),
    ],
    "leg.txt": [
        ("[calibration]", "[positions]", ["no line [calibration]"]),
        ("name\tl_lower_leg\n", "", ["no name", "--link"]),
        ("0.980000", "x", ["line 6", "allowed are x, y, z"]),
        ("0.980000", "nan", ["line 6"]),
        ("0.980000 ", "", ["line 6"]),
        ("0.980000 0.198997", "0.000000 0.100000", ["channel 1", "length 0.1"]),
        ("spatial_sampling\ttaxel", "columns\t0", ["columns is '0'"]),
        ("taxel2Repr", "\xe4", ["byte"]),
        (" 12  12 )", " 12 )", ["taxel2Repr", "13 numbers for 14 positions"]),
        (" 12  12 )", " 12  x )", ["taxel2Repr", "'x'"]),
    ],
    "skin.csv": [
        ("Index,X", "Number,X", ["begins with 'Number"]),
        ("0.0375,0.0,0.05,0.004", "0.0375,0.0,x,0.004", ["line 2"]),
        ("0.0375,0.0,0.05,0.004", "0.0375,0.0,0.05,0", ["line 2", "radius above 0"]),
        ("0.0375,0.0,0.05,0.004,/World", "0.0375,0.05,0.004,/World", ["line 2"]),
        ("/World/arm/tube\n1", "/World/nose\n1", ["'/World/nose'", "no link", "tube"]),
        (GENTACT.partition("\n")[2], "", ["0 taxels"]),
        ("\n1,", "\n0,", ["number 0", "twice"]),
        ("\n1,", "\n1.5,", ["line 3"]),
    ],
}
"""What makes a file wrong, and what is said of it."""
TEXTS = {"hand.urdf": URDF, "leg.txt": ICUB, "skin.csv": GENTACT}


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ([(6.5 * (n % 4), 6.5 * (n // 4), 20.0) for n in range(12)], ["19.5 m wide"]),
        ([(2.0, 0.0, 20.0 + n) for n in range(3)], ["m from the frame of link"]),
        ([(0.01, 0.02, 0.03)] * 12, ["12 of 12 taxels lie where another is"]),
        ([(0.01, 0.02, 0.03)] * 9 + [(0.0, 0.0, 0.01 * n) for n in range(4)], ["9 of"]),
    ],
)
def test_places_that_are_none_are_refused_in_every_format(
    places, words, tmp_path, capsys
):
    icub = tmp_path / "part.txt"
    rows = "".join(f"{x} {y} {z} 0 0 1\n" for x, y, z in places)
    icub.write_text(f"name\tarm\n[calibration]\n{rows}")
    refuse(capsys, icub, tmp_path / "skin", words)
    urdf = tmp_path / "hand.urdf"
    rows = "".join(
        f'<taxel idx="{n}" xyz="{x} {y} {z}"/>' for n, (x, y, z) in enumerate(places)
    )
    urdf.write_text(
        '<robot name="a"><link name="arm"/><sensor name="pad"><parent link="arm"/>'
        f"<tactile>{rows}</tactile></sensor></robot>"
    )
    refuse(capsys, urdf, tmp_path / "skin", words)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [(name, *row) for name, rows in WRONG.items() for row in rows],
)
def test_wrong_file_is_refused_in_one_line(name, old, new, words, tmp_path, capsys):
    assert old in TEXTS[name]
    path = tmp_path / name
    path.write_bytes(TEXTS[name].replace(old, new).encode("latin-1"))
    options = ("--robot-urdf", "tube") if name == "skin.csv" else ()
    refuse(capsys, path, tmp_path / "skin", words, *options)


def refuse(capsys, path, out, words, *options):
    assert run(["skin", "convert", str(path), str(out), *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    for word in words:
        assert word in error
    assert not out.exists()


def test_gentact_file_needs_a_robot_and_electrodes_a_link(csv_file, tmp_path, capsys):
    refuse(capsys, csv_file, tmp_path / "skin", ["no normals", "--robot-urdf"])
    csv_file.write_text("Index,X (mm),Y (mm),Z (mm)\n0,1,2,3\n")
    words = ["which link", "--link"]
    refuse(capsys, csv_file, tmp_path / "skin", words, "--robot-urdf", "tube")


def test_command_goes_through_every_format(hand, tmp_path, capsys):
    first = tmp_path / "skin"
    found, _ = call_json(capsys, "skin", "convert", hand, first)
    assert found == {"out": str(first), "format": "skin", "taxels": 36, "patches": 3}
    skin = load_skin(first)
    assert_same(skin, read_tactile_urdf(hand, "hand"))
    again = tmp_path / "again.urdf"
    call_json(capsys, "skin", "convert", first, again, "--robot-urdf", hand)
    assert_same(read_tactile_urdf(again, "hand"), skin)
    call_json(capsys, "skin", "convert", first, tmp_path / "icub", "--to", "icub")
    call_json(capsys, "skin", "convert", tmp_path / "icub", tmp_path / "back")
    assert load_skin(tmp_path / "back").count == skin.count
    call_json(capsys, "skin", "convert", "bent", tmp_path / "bent.csv")
    options = ("--robot-urdf", "tube", "--name", "bent")
    call_json(
        capsys, "skin", "convert", tmp_path / "bent.csv", tmp_path / "tube", *options
    )
    bent = load_skin("bent")
    np.testing.assert_allclose(
        load_skin(tmp_path / "tube").normals, bent.normals, atol=1e-6
    )


def test_skin_without_the_link_of_a_robot_is_not_found(tmp_path):
    path = tmp_path / "skin.csv"
    path.write_text(GENTACT)
    with pytest.raises(SkinError, match="no link of robot 'ur5'"):
        read_gentact(path, "x", load_robot("ur5"))
    save_skin(load_skin("bent"), tmp_path / "bent")
    assert run(["skin", "convert", str(tmp_path / "none"), str(tmp_path / "x")]) == 2


@pytest.mark.parametrize("name", SKIN_PRESETS)
def test_preset_in_any_format_and_back_has_no_problem(name, tmp_path):
    skin = load_skin(name)
    robot = load_robot_for_skin(name)
    write_tactile_urdf(tmp_path / "a.urdf", skin, robot)
    write_icub_positions(tmp_path / "a", skin)
    write_gentact(tmp_path / "a.csv", skin)
    for again in (
        read_tactile_urdf(tmp_path / "a.urdf", name),
        read_icub_positions(sorted((tmp_path / "a").iterdir()), name),
        read_gentact(tmp_path / "a.csv", name, robot),
    ):
        assert check_skin(again, robot) == []


@pytest.mark.parametrize("taxel", [0, 1000, 2111])
def test_flipped_normal_in_a_list_is_found(taxel, tmp_path):
    write_tactile_urdf(tmp_path / "a.urdf", load_skin("ur5"))
    skin = read_tactile_urdf(tmp_path / "a.urdf", "ur5")
    assert {patch.rows for patch in skin.patches} == {1}
    skin.normals[taxel] *= -1
    (problem,) = check_skin(skin)
    assert (problem.taxel, problem.kind) == (taxel, "flipped normal")


@pytest.mark.parametrize("there", ["file", "folder"])
@pytest.mark.parametrize(
    "words",
    [
        "points ur5 --out OUT",
        "convert ur5 OUT",
        "convert ur5 OUT --to urdf",
        "convert ur5 OUT --to icub",
        "convert ur5 OUT --to gentact",
        "convert sleeve OUT --to icub",
        "convert files OUT",
    ],
)
def test_what_is_at_a_path_is_never_replaced(
    words, there, tmp_path, monkeypatch, capsys
):
    """Coordinates in it may have been measured, and two skins must not be mixed."""
    monkeypatch.chdir(tmp_path)
    write_icub_positions(tmp_path / "files", load_skin("ur5"))
    out = tmp_path / "ur5"
    if there == "file":
        out.write_text("measured")
    else:
        save_skin(load_skin("ur5"), out, load_robot("ur5"))
    before = {
        each: each.is_file() and each.read_bytes() for each in tmp_path.rglob("*")
    }
    words = words.replace("OUT", "ur5").split()
    assert_refused(capsys, "skin", *words, part="ur5: it is there already")
    after = {each: each.is_file() and each.read_bytes() for each in tmp_path.rglob("*")}
    assert after == before


@pytest.mark.parametrize("source", ["own", "own/skin.yaml", "../SELF/own"])
def test_skin_is_mounted_on_another_robot_in_its_own_folder(
    source, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    save_skin(load_skin("ur5"), tmp_path / "own")
    source = source.replace("SELF", tmp_path.name)
    words = ("skin", "convert", source, tmp_path / "own", "--robot-urdf", "ur5")
    call_json(capsys, *words)
    assert load_robot_for_skin("own").joint_names == load_robot("ur5").joint_names
    assert_same(load_skin("own"), load_skin("ur5"))
