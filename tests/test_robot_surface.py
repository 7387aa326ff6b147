"""Distances to surfaces are true distances, and meshes of shapes are closed."""

from collections import Counter

import numpy as np
import pytest

from eskin.errors import RobotError
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
    load_robot,
)
from eskin.robot.surface import compute_winding_number
from eskin.transforms import apply, make_transform, random_rotation, rotate

SHAPES = [Cylinder(0.05, 0.25), Sphere(0.1), Box((0.1, 0.2, 0.3))]
ROUND_MESH = build_shape_mesh(Sphere(0.1), 24)


def name(shape):
    return type(shape).__name__


def placed(shape, seed=0):
    """A link with one body in a random pose."""
    rng = np.random.default_rng(seed)
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    return Link("link", (Geom(shape, T),))


def points_around(link, count, seed=1):
    """Points in the box about a link's first body, twice its size."""
    body = link.geoms[0]
    corners = build_shape_mesh(body.shape).vertices
    span = 2 * np.abs(corners).max(axis=0)
    points = np.random.default_rng(seed).uniform(-span, span, (count, 3))
    return apply(body.T_link_shape, points)


def points_on(mesh, count, seed=2):
    """Points spread evenly over a mesh."""
    rng = np.random.default_rng(seed)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.uniform(size=(2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return (1 - u - v) * a[face] + u * b[face] + v * c[face]


@pytest.mark.parametrize("shape", [*SHAPES, ROUND_MESH], ids=name)
def test_going_the_distance_against_the_normal_ends_on_the_surface(shape):
    link = placed(shape)
    points = points_around(link, 300)
    distance, normal = compute_surface_distance(link, points)
    assert (distance > 0).any() and (distance < 0).any()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
    landed, _ = compute_surface_distance(link, points - distance[:, None] * normal)
    np.testing.assert_allclose(landed, 0, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_no_point_of_the_surface_is_nearer_than_the_distance(shape):
    link = placed(shape)
    points = points_around(link, 100)
    distance, _ = compute_surface_distance(link, points)
    surface = points_on(build_geom_mesh(link.geoms[0], 200), 20_000)
    nearest = np.linalg.norm(points[:, None] - surface, axis=-1).min(axis=1)
    # The points sought lie a few millimetres apart, and a little below round sides.
    np.testing.assert_allclose(np.abs(distance), nearest, atol=0.003)


@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_the_normal_is_the_slope_of_the_distance(shape):
    link = placed(shape)
    points = points_around(link, 300)
    _, normal = compute_surface_distance(link, points)
    step = 1e-6
    ahead, behind = (
        np.stack(
            [compute_surface_distance(link, points + s * e)[0] for e in np.eye(3)], -1
        )
        for s in (step, -step)
    )
    np.testing.assert_allclose((ahead - behind) / (2 * step), normal, atol=1e-4)


@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_a_mesh_of_a_shape_has_nearly_the_shapes_distance(shape):
    exact = placed(shape)
    points = points_around(exact, 200)
    body = exact.geoms[0]
    meshed = Link("mesh", (Geom(build_shape_mesh(shape, 96), body.T_link_shape),))
    (near, outward), (truth, _) = (
        compute_surface_distance(link, points) for link in (meshed, exact)
    )
    np.testing.assert_allclose(
        near, truth, atol=1e-12 if name(shape) == "Box" else 3e-4
    )
    np.testing.assert_allclose(np.linalg.norm(outward, axis=1), 1)


@pytest.mark.parametrize("shape", [*SHAPES, build_shape_mesh(SHAPES[2])], ids=name)
def test_on_the_surface_the_distance_is_zero_and_the_normal_is_the_sides(shape):
    link = placed(shape)
    mesh = build_geom_mesh(link.geoms[0], 400)
    corners = mesh.vertices[mesh.faces]
    # Centres of long thin triangles of a round side lie on it to within a micrometre.
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    distance, normal = compute_surface_distance(link, corners.mean(axis=1))
    np.testing.assert_allclose(distance, 0, atol=1e-5)
    np.testing.assert_allclose(np.sum(normal * sides, axis=1), 1, atol=1e-3)


def test_special_points_have_known_distances():
    still = np.eye(4)
    cylinder = Link("c", (Geom(Cylinder(1.0, 4.0), still),))
    points = np.array([[0, 0, 0], [0, 0, 3], [4, 0, 5], [0.5, 0, 1.9], [0, -2, 0]])
    distance, normal = compute_surface_distance(cylinder, points.astype(float))
    np.testing.assert_allclose(distance, [-1, 1, np.sqrt(18), -0.1, 1])
    half = np.sqrt(0.5)
    expected = [[1, 0, 0], [0, 0, 1], [half, 0, half], [0, 0, 1], [0, -1, 0]]
    np.testing.assert_allclose(normal, expected)
    ball = Link("s", (Geom(Sphere(2.0), still),))
    distance, normal = compute_surface_distance(ball, np.zeros((1, 3)))
    assert distance[0] == -2
    np.testing.assert_allclose(np.linalg.norm(normal), 1)


def test_a_link_is_the_union_of_its_bodies():
    left, right = np.eye(4), np.eye(4)
    left[0, 3], right[0, 3] = -1, 1
    link = Link("dumbbell", (Geom(Sphere(0.5), left), Geom(Sphere(0.7), right)))
    points = np.array([[-3.0, 0, 0], [3.0, 0, 0], [-1.0, 0, 0.1], [0.0, 0, 0]])
    distance, normal = compute_surface_distance(link, points)
    np.testing.assert_allclose(distance, [1.5, 1.3, -0.4, 0.3])
    np.testing.assert_allclose(normal, [[-1, 0, 0], [1, 0, 0], [0, 0, 1], [-1, 0, 0]])


def test_moving_link_and_points_together_changes_no_distance():
    rng = np.random.default_rng(8)
    arm = load_robot("ur5").links[2]
    points = rng.uniform(-0.3, 0.6, (200, 3))
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    moved = Link("arm", tuple(Geom(b.shape, T @ b.T_link_shape) for b in arm.geoms))
    distance, normal = compute_surface_distance(arm, points)
    moved_distance, moved_normal = compute_surface_distance(moved, apply(T, points))
    np.testing.assert_allclose(moved_distance, distance, atol=1e-12)
    np.testing.assert_allclose(moved_normal, rotate(T, normal), atol=1e-9)


@pytest.mark.parametrize(
    "link, radius, low, high",
    [
        ("upper_arm_link", 0.0505, 0.09, 0.335),
        ("forearm_link", 0.0375, 0.075, 0.355),
    ],
)
def test_skin_can_lie_all_around_the_straight_tubes(link, radius, low, high):
    ur5 = load_robot("ur5")
    angle = np.linspace(0, 2 * np.pi, 50)
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(50)], axis=-1)
    for z in np.linspace(low + 1e-3, high - 1e-3, 20):
        points = radius * outward + [0, 0, z]
        distance, normal = compute_surface_distance(
            ur5.links[ur5.link_index(link)], points
        )
        np.testing.assert_allclose(distance, 0, atol=1e-12)
        np.testing.assert_allclose(normal, outward, atol=1e-12)


def test_a_link_without_bodies_has_no_surface():
    ur5 = load_robot("ur5")
    with pytest.raises(RobotError) as caught:
        compute_surface_distance(ur5.links[ur5.link_index("tool0")], np.zeros((1, 3)))
    assert str(caught.value) == (
        "link 'tool0' has no surface: its URDF gives it no <collision>; "
        "add one, or choose another link"
    )


def mesh_volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.sum(a * np.cross(b, c)) / 6


def true_volume(shape):
    match shape:
        case Cylinder():
            return np.pi * shape.radius**2 * shape.length
        case Sphere():
            return 4 / 3 * np.pi * shape.radius**3
    return np.prod(shape.size)


@pytest.mark.parametrize("segments", [3, 4, 48])
@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_meshes_of_shapes_are_closed_and_face_outward(shape, segments):
    mesh = build_shape_mesh(shape, segments)
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = Counter(map(tuple, edges.tolist()))
    assert set(count.values()) == {1}
    assert all((b, a) in count for a, b in count)
    assert len(mesh.vertices) - len(count) // 2 + len(mesh.faces) == 2
    assert set(mesh.faces.ravel()) == set(range(len(mesh.vertices)))
    assert mesh_volume(mesh) > 0


@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_meshes_of_shapes_tend_to_the_shapes_volume_with_more_segments(shape):
    lost = [
        1 - mesh_volume(build_shape_mesh(shape, segments)) / true_volume(shape)
        for segments in (24, 48, 96)
    ]
    if isinstance(shape, Box):
        np.testing.assert_allclose(lost, 0, atol=1e-12)
    else:
        # A polygon misses its circle by the square of its side.
        np.testing.assert_allclose([lost[0] / lost[1], lost[1] / lost[2]], 4, rtol=0.02)
        assert 0 < lost[2] < 0.002


@pytest.mark.parametrize("shape", SHAPES, ids=name)
def test_vertices_of_a_mesh_lie_on_its_shape(shape):
    link = placed(shape)
    distance, _ = compute_surface_distance(
        link, build_geom_mesh(link.geoms[0]).vertices
    )
    # All but the middle of a cylinder's lids, which lie on it too.
    np.testing.assert_allclose(distance, 0, atol=1e-12)


def test_a_mesh_meshes_to_itself():
    assert build_shape_mesh(ROUND_MESH) is ROUND_MESH


def test_too_few_segments_are_refused():
    with pytest.raises(ValueError, match="a circle of 2 segments; wanted: 3 or more"):
        build_shape_mesh(Sphere(1.0), 2)


def test_overlapping_bodies_in_one_mesh_count_as_inside_in_both():
    one, other = (build_shape_mesh(Box((2.0, 2.0, 2.0))) for _ in range(2))
    corners = np.concatenate(
        [one.vertices[one.faces], other.vertices[other.faces] + [1.0, 0, 0]]
    )
    points = np.array([[-0.5, 0, 0], [0.5, 0.2, 0], [1.5, 0, 0], [3, 0, 0]])
    winding = compute_winding_number(corners, points)
    np.testing.assert_allclose(winding, [1, 2, 1, 0], atol=1e-12)


def test_triangles_without_area_change_nothing():
    box = build_shape_mesh(Box((2.0, 2.0, 2.0)))
    flat = np.array([[0, 0, 0], [0, 1, 1], [2, 3, 2]])
    padded = TriangleMesh(box.vertices, np.concatenate([flat, box.faces]))
    points = np.random.default_rng(0).uniform(-2, 2, (100, 3))
    plain, more = (
        compute_surface_distance(Link("box", (Geom(mesh, np.eye(4)),)), points)
        for mesh in (box, padded)
    )
    np.testing.assert_allclose(more[0], plain[0], atol=1e-12)
    np.testing.assert_allclose(more[1], plain[1], atol=1e-9)
