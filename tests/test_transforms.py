"""Rotations and rigid motions obey the laws of their groups."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from eskin.transforms import (
    apply,
    compose,
    exp_so3,
    invert,
    log_so3,
    make_transform,
    matrix_to_quaternion,
    quaternion_to_matrix,
    random_rotation,
    rotate,
    rpy_to_matrix,
)

numbers = st.floats(-10, 10)
vectors = arrays(np.float64, 3, elements=numbers)
rotation_vectors = arrays(np.float64, 3, elements=st.floats(-6, 6))
relaxed = settings(deadline=None, max_examples=60)


def transforms():
    return st.builds(
        lambda v, p: make_transform(exp_so3(v), p), rotation_vectors, vectors
    )


def close(a, b, tolerance=1e-12):
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


@relaxed
@given(rotation_vectors)
def test_an_exponential_is_a_rotation(v):
    R = exp_so3(v)
    close(R @ R.T, np.eye(3))
    close(np.linalg.det(R), 1)


@relaxed
@given(transforms(), transforms(), transforms())
def test_composition_is_associative(T_a_b, T_b_c, T_c_d):
    left = compose(compose(T_a_b, T_b_c), T_c_d)
    close(left, compose(T_a_b, compose(T_b_c, T_c_d)), 1e-11)


@relaxed
@given(transforms())
def test_the_inverse_undoes_on_both_sides(T):
    close(compose(T, invert(T)), np.eye(4), 1e-11)
    close(compose(invert(T), T), np.eye(4), 1e-11)


@relaxed
@given(transforms(), transforms(), vectors)
def test_applying_a_product_applies_one_after_the_other(T_a_b, T_b_c, p):
    close(apply(compose(T_a_b, T_b_c), p), apply(T_a_b, apply(T_b_c, p)), 1e-11)


@relaxed
@given(transforms(), vectors, vectors)
def test_rigid_motions_keep_distances_and_rotate_differences(T, p, r):
    moved = apply(T, p) - apply(T, r)
    close(np.linalg.norm(moved), np.linalg.norm(p - r), 1e-11)
    close(moved, rotate(T, p - r), 1e-11)


@relaxed
@given(rotation_vectors)
def test_a_quaternion_and_its_negative_are_the_rotation_they_came_from(v):
    R = exp_so3(v)
    q = matrix_to_quaternion(R)
    close(quaternion_to_matrix(q), R)
    close(quaternion_to_matrix(-3.0 * q), R)
    close(np.linalg.norm(q), 1)
    assert q[0] >= 0


@relaxed
@given(rotation_vectors)
def test_the_logarithm_is_the_shortest_vector_with_that_exponential(v):
    R = exp_so3(v)
    back = log_so3(R)
    close(exp_so3(back), R)
    assert np.linalg.norm(back) <= np.pi + 1e-12


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-160, 1e-12, 1e-7, 1.0, 3.14159265])
def test_the_logarithm_gives_back_vectors_shorter_than_pi(size):
    v = size * np.array([2.0, -3.0, 6.0]) / 7
    np.testing.assert_allclose(log_so3(exp_so3(v)), v, rtol=1e-7, atol=0)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_turns_have_exact_quaternions(axis):
    R = 2 * np.outer(axis, axis) - np.eye(3)
    close(np.abs(matrix_to_quaternion(R)), [0, *axis], 0)


def test_a_quarter_turn_about_z_takes_x_to_y():
    half = np.sqrt(0.5)
    quarter = np.pi / 2
    for R in (
        quaternion_to_matrix(np.array([half, 0, 0, half])),
        exp_so3(np.array([0, 0, quarter])),
        rpy_to_matrix(np.array([0, 0, quarter])),
    ):
        close(R @ [1.0, 0, 0], [0, 1, 0])


@relaxed
@given(vectors)
def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order(rpy):
    roll, pitch, yaw = exp_so3(np.diag(rpy))
    close(rpy_to_matrix(rpy), yaw @ pitch @ roll)


@relaxed
@given(st.data())
def test_batches_equal_their_parts(data):
    shape = data.draw(array_shapes(max_dims=2, max_side=3))
    elements = st.floats(-3, 3)
    v = data.draw(arrays(np.float64, (*shape, 3), elements=elements))
    R = exp_so3(v)
    T = make_transform(R, v)
    for i in np.ndindex(shape):
        close(R[i], exp_so3(v[i]))
        close(rpy_to_matrix(v)[i], rpy_to_matrix(v[i]))
        close(quaternion_to_matrix(matrix_to_quaternion(R))[i], R[i])
        close(invert(T)[i], invert(T[i]))
        close(apply(T, v)[i], apply(T[i], v[i]))


def test_one_transform_moves_many_points():
    rng = np.random.default_rng(3)
    T = make_transform(random_rotation(rng), rng.standard_normal(3))
    points = rng.standard_normal((5, 3))
    close(apply(T, points), [apply(T, point) for point in points])


def test_random_rotations_favour_no_direction():
    R = random_rotation(np.random.default_rng(0), (20_000,))
    close(R.mean(axis=0), np.zeros((3, 3)), 0.02)
    close(np.einsum("bij,bkj->ik", R, R) / len(R), np.eye(3))
    # The trace of an even rotation has mean 0 and mean square 1.
    close(np.mean(np.einsum("bii->b", R) ** 2), 1, 0.05)


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_a_quaternion_without_direction_is_refused(bad):
    with pytest.raises(ValueError, match="quaternion is zero or not finite"):
        quaternion_to_matrix(np.full(4, bad))
