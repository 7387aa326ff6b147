"""Tests of transforms: rotations and rigid motions obey the laws of their groups."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from jaxtyping import TypeCheckError

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
from helpers.checking import begin_test

VECTORS = arrays(np.float64, 3, elements=st.floats(-10, 10))
ROTATION_VECTORS = arrays(np.float64, 3, elements=st.floats(-6, 6))
TRANSFORMS = st.builds(
    lambda v, p: make_transform(exp_so3(v), p), ROTATION_VECTORS, VECTORS
)
few_examples = settings(deadline=None, max_examples=25)


def test_wrong_shape_is_found_at_first_in_every_test():
    for _ in range(2):
        begin_test()
        with pytest.raises(TypeCheckError):
            apply(np.eye(3), np.zeros((1, 3)))
        for _ in range(20):
            apply(np.eye(4), np.zeros((1, 3)))


def assert_close(a, b, tolerance=1e-11):
    """Assert that all entries differ by a tolerance at most."""
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


@few_examples
@given(TRANSFORMS, TRANSFORMS, TRANSFORMS, VECTORS, VECTORS)
def test_transforms_are_a_group_of_rigid_motions(T_a_b, T_b_c, T_c_d, p, r):
    left = compose(compose(T_a_b, T_b_c), T_c_d)
    assert_close(left, compose(T_a_b, compose(T_b_c, T_c_d)))
    assert_close(compose(T_a_b, invert(T_a_b)), np.eye(4))
    assert_close(compose(invert(T_a_b), T_a_b), np.eye(4))
    assert_close(apply(compose(T_a_b, T_b_c), p), apply(T_a_b, apply(T_b_c, p)))
    moved = apply(T_a_b, p) - apply(T_a_b, r)
    assert_close(np.linalg.norm(moved), np.linalg.norm(p - r))
    assert_close(moved, rotate(T_a_b, p - r))


@few_examples
@given(ROTATION_VECTORS)
def test_vector_matrix_and_quaternion_describe_the_same_rotation(v):
    R = exp_so3(v)
    assert_close(R @ R.T, np.eye(3), 1e-12)
    assert_close(np.linalg.det(R), 1, 1e-12)
    shortest = log_so3(R)
    assert_close(exp_so3(shortest), R, 1e-12)
    assert np.linalg.norm(shortest) <= np.pi + 1e-12
    q = matrix_to_quaternion(R)
    assert_close(np.linalg.norm(q), 1, 1e-12)
    assert q[0] >= 0
    assert_close(quaternion_to_matrix(q), R, 1e-12)
    assert_close(quaternion_to_matrix(-3.0 * q), R, 1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-160, 1e-12, 1e-7, 1.0, 3.14159265])
def test_logarithm_undoes_the_exponential_up_to_a_half_turn(size):
    v = size * np.array([2.0, -3.0, 6.0]) / 7
    np.testing.assert_allclose(log_so3(exp_so3(v)), v, rtol=1e-7, atol=0)


@pytest.mark.parametrize("axis", np.eye(3))
def test_quaternion_of_a_half_turn_is_exact(axis):
    R = 2 * np.outer(axis, axis) - np.eye(3)
    assert_close(np.abs(matrix_to_quaternion(R)), [0, *axis], 0)


def test_quarter_turn_about_z_takes_x_to_y():
    half = np.sqrt(0.5)
    turn = np.array([0, 0, np.pi / 2])
    quaternion = quaternion_to_matrix(np.array([half, 0, 0, half]))
    for R in (quaternion, exp_so3(turn), rpy_to_matrix(turn)):
        assert_close(R @ [1.0, 0, 0], [0, 1, 0])


@few_examples
@given(VECTORS)
def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order(rpy):
    roll, pitch, yaw = exp_so3(np.diag(rpy))
    assert_close(rpy_to_matrix(rpy), yaw @ pitch @ roll)


@few_examples
@given(st.data())
def test_batches_equal_their_parts(data):
    shape = data.draw(array_shapes(max_dims=2, max_side=3))
    v = data.draw(arrays(np.float64, (*shape, 3), elements=st.floats(-3, 3)))
    R = exp_so3(v)
    T = make_transform(R, v)
    for i in np.ndindex(shape):
        assert_close(R[i], exp_so3(v[i]))
        assert_close(rpy_to_matrix(v)[i], rpy_to_matrix(v[i]))
        assert_close(quaternion_to_matrix(matrix_to_quaternion(R))[i], R[i])
        assert_close(invert(T)[i], invert(T[i]))
        assert_close(apply(T, v)[i], apply(T[i], v[i]))
    points = v.reshape(-1, 3)
    one = T.reshape(-1, 4, 4)[0]
    assert_close(apply(one, points), [apply(one, point) for point in points])


def test_random_rotations_are_uniform():
    R = random_rotation(np.random.default_rng(0), (20_000,))
    assert_close(R.mean(axis=0), np.zeros((3, 3)), 0.02)
    assert_close(np.einsum("bij,bkj->ik", R, R) / len(R), np.eye(3))
    # The trace of a uniform rotation has mean 0 and mean square 1.
    assert_close(np.mean(np.einsum("bii->b", R) ** 2), 1, 0.05)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_quaternion_without_direction_is_refused(value):
    with pytest.raises(ValueError, match="quaternion"):
        quaternion_to_matrix(np.full(4, value))
