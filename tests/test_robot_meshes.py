"""Tests of lengths: units are applied, and lengths in another unit are not silent."""

import re
import sys

import numpy as np
import pytest

from eskin.errors import RobotError
from eskin.registry import advise_install
from eskin.robot import Box, build_shape_mesh, load_urdf
from eskin.robot.urdf import warn_once

MESH = build_shape_mesh(Box((20.0, 10.0, 30.0)))
ROBOT = """<robot name="toy"><link name="part"><collision>{origin}
<geometry>{shape}</geometry></collision></link></robot>"""
COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"
version="1.4.1"><asset>{unit}<up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="s">
<float_array id="f" count="24">{numbers}</float_array><technique_common>
<accessor source="#f" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v">
<input semantic="POSITION" source="#s"/></vertices><triangles count="12">
<input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes>
<visual_scene id="w"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


@pytest.fixture
def read_part(tmp_path):
    """Return a function that reads the one shape of a robot."""

    def read(shape, origin=""):
        warn_once.cache_clear()
        path = tmp_path / "toy.urdf"
        path.write_text(ROBOT.format(shape=shape, origin=origin))
        return load_urdf(path).links[0].geoms[0].shape

    return read


@pytest.fixture
def read_collada(read_part, tmp_path):
    """Return a function that reads a COLLADA file of some unit."""
    pytest.importorskip("trimesh")
    pytest.importorskip("collada", reason="pycollada is not installed: extra design")

    def read(unit, up="Z_UP", scale="1 1 1"):
        numbers, faces = (
            " ".join(map(str, array.ravel().tolist()))
            for array in (MESH.vertices, MESH.faces)
        )
        text = COLLADA.format(unit=unit, up=up, numbers=numbers, faces=faces)
        (tmp_path / "part.dae").write_text(text)
        return read_part(f'<mesh filename="part.dae" scale="{scale}"/>')

    return read


@pytest.mark.parametrize("up", ["Z_UP", "Y_UP"])
@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ('<unit name="centimeter" meter="0.01"/>', 0.01),
        ("<unit meter='1e-3' name='millimeter'/>", 0.001),
        ('<unit name="inch" meter="0.0254"/>', 0.0254),
        ('<unit name="meter"/>', 1.0),
        ("", 1.0),
    ],
)
def test_unit_of_a_collada_file_is_applied_and_its_axes_kept(
    read_collada, unit, up, metres
):
    found = read_collada(unit, up, "1 2 1")
    corners = found.vertices[found.faces]
    expected = metres * MESH.vertices[MESH.faces] * [1, 2, 1]
    np.testing.assert_allclose(
        np.sort(corners.mean(axis=1), axis=0), np.sort(expected.mean(axis=1), axis=0)
    )
    np.testing.assert_allclose(np.ptp(corners, axis=(0, 1)), np.ptp(expected, (0, 1)))


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "0,01", "cm"])
def test_unit_that_is_no_length_is_refused(read_collada, text):
    with pytest.raises(RobotError, match=f"part.dae has <unit meter='{text}'>"):
        read_collada(f'<unit meter="{text}"/>')


def test_reader_that_is_missing_is_named_with_the_file(read_collada, monkeypatch):
    monkeypatch.setitem(sys.modules, "collada", None)
    text = "part.dae cannot be read: needs pycollada; " + advise_install("design")
    with pytest.raises(RobotError, match=re.escape(text)):
        read_collada("")


LARGE = [
    ('<sphere radius="1000"/>', "", "2e+03 x 2e+03 x 2e+03 m", "divide by 1000"),
    ('<cylinder radius="0.1" length="39"/>', "", "0.2 x 0.2 x 39 m", "divide by 1000"),
    ('<box size="0.1 0.1 6"/>', "", "0.1 x 0.1 x 6 m", "divide by 1000"),
    ('<box size="1 1 1"/>', '<origin xyz="0 0 300"/>', "300 m", "divide by 1000"),
    ('<mesh filename="part.off"/>', "", "20 x 10 x 30 m", 'scale="0.001 0.001 0.001"'),
]


@pytest.mark.parametrize(("shape", "origin", "size", "remedy"), LARGE)
def test_large_part_is_warned_of_with_its_size_and_remedy(
    read_part, tmp_path, caplog, shape, origin, size, remedy
):
    write_off(tmp_path)
    read_part(shape, origin)
    (record,) = caplog.records
    text = record.getMessage()
    assert all(part in text for part in ("link 'part'", size, remedy))


def write_off(folder):
    """Write the mesh as an OFF file, and skip where none can be read."""
    pytest.importorskip("trimesh")
    lines = ["OFF", "8 12 0", *(f"{x} {y} {z}" for x, y, z in MESH.vertices)]
    lines += [f"3 {a} {b} {c}" for a, b, c in MESH.faces]
    (folder / "part.off").write_text("\n".join(lines) + "\n")


def test_remedy_of_a_large_mesh_and_parts_of_usual_size_are_not_warned_of(
    read_part, tmp_path, caplog
):
    write_off(tmp_path)
    read_part('<mesh filename="part.off" scale="0.001 0.001 0.001"/>')
    read_part('<box size="5 5 5"/>', '<origin xyz="0 0 5"/>')
    assert caplog.records == []


@pytest.mark.parametrize(
    ("scale", "part"),
    [
        ("0 0 0", "scale is '0 0 0'"),
        ("1 0 1", "other than 0"),
        ("1e300 1 1", "allowed: 1e\\+06 m"),
        ("1e308 1e308 1e308", "allowed: 1e\\+06 m"),
    ],
)
def test_scale_that_leaves_no_body_is_refused(read_part, tmp_path, scale, part):
    write_off(tmp_path)
    with pytest.raises(RobotError, match=part):
        read_part(f'<mesh filename="part.off" scale="{scale}"/>')
