"""Tests of lengths: units are applied, and lengths in another unit are not silent."""

import numpy as np
import pytest

from helpers.robots import PART_MESH, read_collada, read_part, write_off


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
    tmp_path, unit, up, metres
):
    found = read_collada(tmp_path, unit, up, "1 2 1")
    corners = found.vertices[found.faces]
    expected = metres * PART_MESH.vertices[PART_MESH.faces] * [1, 2, 1]
    np.testing.assert_allclose(
        np.sort(corners.mean(axis=1), axis=0), np.sort(expected.mean(axis=1), axis=0)
    )
    np.testing.assert_allclose(np.ptp(corners, axis=(0, 1)), np.ptp(expected, (0, 1)))


LARGE = [
    ('<sphere radius="1000"/>', "", "2e+03 x 2e+03 x 2e+03 m", "divide by 1000"),
    ('<cylinder radius="0.1" length="39"/>', "", "0.2 x 0.2 x 39 m", "divide by 1000"),
    ('<box size="0.1 0.1 6"/>', "", "0.1 x 0.1 x 6 m", "divide by 1000"),
    ('<box size="1 1 1"/>', '<origin xyz="0 0 300"/>', "300 m", "divide by 1000"),
    ('<mesh filename="part.off"/>', "", "20 x 10 x 30 m", 'scale="0.001 0.001 0.001"'),
]


@pytest.mark.parametrize(("shape", "origin", "size", "remedy"), LARGE)
def test_large_part_is_warned_of_with_its_size_and_remedy(
    tmp_path, caplog, shape, origin, size, remedy
):
    write_off(tmp_path)
    read_part(tmp_path, shape, origin)
    (record,) = caplog.records
    text = record.getMessage()
    assert all(part in text for part in ("link 'part'", size, remedy))


def test_remedy_of_a_large_mesh_and_parts_of_usual_size_are_not_warned_of(
    tmp_path, caplog
):
    write_off(tmp_path)
    read_part(tmp_path, '<mesh filename="part.off" scale="0.001 0.001 0.001"/>')
    read_part(tmp_path, '<box size="5 5 5"/>', '<origin xyz="0 0 5"/>')
    assert caplog.records == []
