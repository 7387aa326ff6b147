"""Tests of surfaces: distances are true distances, and meshes of shapes are closed."""

from collections import Counter

import numpy as np
import pytest

from eskin.robot import (
    Box,
    Cylinder,
    Geom,
    Link,
    Sphere,
    TriangleMesh,
    build_geom_mesh,
    build_shape_mesh,
    compute_surface_distance,
)
from eskin.robot.triangles import compute_solid_angles, find_nearest_points
from eskin.transforms import apply, make_transform, random_rotation

CYLINDER = Cylinder(0.05, 0.25)
SPHERE = Sphere(0.1)
BOX = Box((0.1, 0.2, 0.3))
SHAPES = [CYLINDER, SPHERE, BOX]
SPHERE_MESH = build_shape_mesh(SPHERE, 24)
BOX_MESH = build_shape_mesh(BOX)


def get_name(shape):
    """Return the name of a shape's class."""
    return type(shape).__name__


EVERY_SHAPE = pytest.mark.parametrize("shape", SHAPES, ids=get_name)


def build_link(shape):
    """Build a link with one shape in a random pose."""
    rng = np.random.default_rng(0)
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    return Link("link", (Geom(shape, T),))


def build_union(*shapes):
    """Build a link of shapes, each with its position."""
    return Link(
        "link",
        tuple(Geom(s, make_transform(np.eye(3), np.array(p))) for s, p in shapes),
    )


def sample_around(link, count):
    """Return points in the box around a link's shape, twice its size."""
    geom = link.geoms[0]
    span = 2 * np.abs(build_shape_mesh(geom.shape).vertices).max(axis=0)
    points = np.random.default_rng(1).uniform(-span, span, (count, 3))
    return apply(geom.T_link_shape, points)


def sample_mesh(mesh, count):
    """Return points spread evenly over a mesh."""
    rng = np.random.default_rng(2)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.uniform(size=(2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return (1 - u - v) * a[face] + u * b[face] + v * c[face]


@pytest.mark.parametrize("shape", [*SHAPES, SPHERE_MESH], ids=get_name)
def test_point_moved_by_its_distance_lies_on_the_surface(shape):
    link = build_link(shape)
    points = sample_around(link, 200)
    distance, normal = compute_surface_distance(link, points)
    assert (distance > 0).any() and (distance < 0).any()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
    moved, _ = compute_surface_distance(link, points - distance[:, None] * normal)
    np.testing.assert_allclose(moved, 0, atol=1e-12)


@EVERY_SHAPE
def test_distance_is_that_of_the_nearest_point_and_normal_is_its_gradient(shape):
    link = build_link(shape)
    points = sample_around(link, 100)
    distance, normal = compute_surface_distance(link, points)
    surface = sample_mesh(build_geom_mesh(link.geoms[0], 200), 10_000)
    nearest = np.linalg.norm(points[:, None] - surface, axis=-1).min(axis=1)
    # Samples lie a few millimetres apart, and a little below round sides.
    np.testing.assert_allclose(np.abs(distance), nearest, atol=0.004)
    ahead, behind = (
        [compute_surface_distance(link, points + s * e)[0] for e in np.eye(3)]
        for s in (1e-6, -1e-6)
    )
    gradient = np.subtract(ahead, behind).T / 2e-6
    np.testing.assert_allclose(gradient, normal, atol=1e-4)


@EVERY_SHAPE
def test_mesh_of_a_shape_has_nearly_the_distances_of_the_shape(shape):
    exact = build_link(shape)
    points = sample_around(exact, 100)
    mesh = build_shape_mesh(shape, 64)
    meshed = Link("mesh", (Geom(mesh, exact.geoms[0].T_link_shape),))
    expected, _ = compute_surface_distance(exact, points)
    distance, normal = compute_surface_distance(meshed, points)
    np.testing.assert_allclose(distance, expected, atol=1e-12 if shape is BOX else 6e-4)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)


@pytest.mark.parametrize("shape", [*SHAPES, BOX_MESH], ids=get_name)
def test_normal_on_the_surface_is_that_of_the_face(shape):
    link = build_link(shape)
    mesh = build_geom_mesh(link.geoms[0], 400)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    faces = np.cross(b - a, c - a)
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    # Centres of long thin triangles of a round side lie on it to within a micrometre.
    distance, normal = compute_surface_distance(link, (a + b + c) / 3)
    np.testing.assert_allclose(distance, 0, atol=1e-5)
    np.testing.assert_allclose(np.sum(normal * faces, axis=1), 1, atol=1e-3)
    distance, _ = compute_surface_distance(link, mesh.vertices)
    np.testing.assert_allclose(distance, 0, atol=1e-12)


def test_special_points_have_known_distances():
    cylinder = build_union((Cylinder(1.0, 4.0), [0.0, 0, 0]))
    points = np.array([[0, 0, 0], [0, 0, 3], [4, 0, 5], [0.5, 0, 1.9], [0, -2, 0]])
    distance, normal = compute_surface_distance(cylinder, points.astype(float))
    np.testing.assert_allclose(distance, [-1, 1, np.sqrt(18), -0.1, 1])
    half = np.sqrt(0.5)
    expected = [[1, 0, 0], [0, 0, 1], [half, 0, half], [0, 0, 1], [0, -1, 0]]
    np.testing.assert_allclose(normal, expected)
    ball = build_union((Sphere(2.0), [0.0, 0, 0]))
    distance, normal = compute_surface_distance(ball, np.zeros((1, 3)))
    assert distance[0] == -2
    np.testing.assert_allclose(np.linalg.norm(normal), 1)


def test_surface_of_a_link_is_that_of_the_union_of_its_shapes():
    link = build_union((Sphere(0.5), [-1.0, 0, 0]), (Sphere(0.7), [1.0, 0, 0]))
    points = np.array([[-3.0, 0, 0], [3.0, 0, 0], [-1.0, 0, 0.1], [0.0, 0, 0]])
    distance, normal = compute_surface_distance(link, points)
    np.testing.assert_allclose(distance, [1.5, 1.3, -0.4, 0.3])
    np.testing.assert_allclose(normal, [[-1, 0, 0], [1, 0, 0], [0, 0, 1], [-1, 0, 0]])


@pytest.mark.parametrize("segments", [3, 4, 48])
@EVERY_SHAPE
def test_mesh_of_a_shape_is_closed_and_faces_outward(shape, segments):
    mesh = build_shape_mesh(shape, segments)
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = Counter(map(tuple, edges.tolist()))
    assert set(count.values()) == {1}
    assert all((b, a) in count for a, b in count)
    assert len(mesh.vertices) - len(count) // 2 + len(mesh.faces) == 2
    assert set(mesh.faces.ravel()) == set(range(len(mesh.vertices)))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    assert np.sum(a * np.cross(b, c)) > 0


def test_mesh_of_a_mesh_is_itself():
    assert build_shape_mesh(SPHERE_MESH) is SPHERE_MESH


def test_triangles_without_area_change_nothing():
    flat = np.array([[0, 0, 0], [0, 1, 1], [2, 3, 2]])
    padded = TriangleMesh(BOX_MESH.vertices, np.concatenate([flat, BOX_MESH.faces]))
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (100, 3))
    expected, got = (
        compute_surface_distance(build_union((mesh, [0.0, 0, 0])), points)
        for mesh in (BOX_MESH, padded)
    )
    np.testing.assert_allclose(got[0], expected[0], atol=1e-12)
    np.testing.assert_allclose(got[1], expected[1], atol=1e-9)


def test_few_triangles_are_compared_with_a_point_and_distances_are_those_of_all(
    monkeypatch,
):
    """Also with triangles of very different sizes, and parts that overlap."""
    compared = []

    def count(corners, points):
        compared.append(len(points))
        return find_nearest_points(corners, points)

    monkeypatch.setattr("eskin.robot.triangles.find_nearest_points", count)
    rng = np.random.default_rng(4)
    parts = [
        (build_shape_mesh(Sphere(0.1), 100), [0.0, 0, 0]),
        (build_shape_mesh(Sphere(0.1), 60), [0.1, 0, 0]),
        (build_shape_mesh(Box((100.0, 100.0, 0.01))), [0.0, 0, -0.2]),
    ]
    mesh = TriangleMesh(
        np.concatenate([part.vertices + place for part, place in parts]),
        np.concatenate([parts[0][0].faces, *shift_faces(parts)]),
    )
    points = rng.uniform(-0.3, 0.3, (25, 3))
    corners = mesh.vertices[mesh.faces]
    every = np.repeat(np.arange(len(points)), len(corners))
    pairs = np.tile(corners, (len(points), 1, 1)), points[every]
    away = np.linalg.norm(find_nearest_points(*pairs) - pairs[1], axis=1)
    solid = compute_solid_angles(*pairs).reshape(len(points), -1).sum(axis=1)
    distance, _ = compute_surface_distance(build_union((mesh, [0.0, 0, 0])), points)
    np.testing.assert_allclose(
        np.abs(distance), away.reshape(len(points), -1).min(axis=1), atol=1e-15
    )
    assert ((distance < 0) == (solid > 2 * np.pi)).all()
    assert sum(compared) < 0.02 * len(points) * len(corners)


def shift_faces(parts):
    """Return the triangles of the later parts of a mesh, behind the first's."""
    starts = np.cumsum([len(part.vertices) for part, _ in parts])
    return [part.faces + s for (part, _), s in zip(parts[1:], starts, strict=False)]


def test_distances_that_need_not_be_exact_are_little_too_long(monkeypatch):
    """Also near the middle of a ball, to which all triangles are nearly as near."""
    compared = []

    def count(corners, points):
        compared.append(len(points))
        return find_nearest_points(corners, points)

    monkeypatch.setattr("eskin.robot.triangles.find_nearest_points", count)
    mesh = build_shape_mesh(SPHERE, 200)
    link = build_link(mesh)
    points = np.concatenate([sample_around(link, 100), sample_mesh(mesh, 50) * 0.01])
    exact, _ = compute_surface_distance(link, points)
    compared.clear()
    found, _ = compute_surface_distance(link, points, exact_to=0.02)
    assert sum(compared) < 0.1 * len(points) * len(mesh.faces)
    near = np.abs(exact) <= 0.02
    assert near.any()
    np.testing.assert_allclose(found[near], exact[near], atol=1e-15)
    ratio = found / exact
    assert ratio.min() > 1 - 1e-12 and ratio.max() < 1.0501


def test_distances_do_not_depend_on_how_many_pairs_are_compared_at_once(monkeypatch):
    link = build_link(SPHERE_MESH)
    points = sample_around(link, 30)
    expected = compute_surface_distance(link, points)
    monkeypatch.setattr("eskin.robot.triangles.PAIRS_AT_ONCE", 10)
    found = compute_surface_distance(link, points)
    np.testing.assert_allclose(found[0], expected[0], atol=1e-15)
