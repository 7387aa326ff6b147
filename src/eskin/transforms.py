"""This module computes rotations and rigid transforms, batched over leading axes.

`T_a_b` is a 4 x 4 matrix that takes coordinates in frame b to coordinates in frame a,
so that subscripts cancel: `T_a_c = compose(T_a_b, T_b_c)`. Quaternions are `wxyz`.
"""

import numpy as np
from jaxtyping import Float


def quaternion_to_matrix(
    wxyz: Float[np.ndarray, "*batch 4"],
) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation matrix of a quaternion, which need not be normalised.

    Raises:
        ValueError: A quaternion is zero or not finite.
    """
    square = np.sum(wxyz**2, axis=-1)
    if not np.all(np.isfinite(square) & (square > 0)):
        raise ValueError("quaternion is zero or not finite; allowed: any other wxyz")
    w, x, y, z = np.moveaxis(wxyz / np.sqrt(square)[..., None], -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrix_to_quaternion(
    rotation: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 4"]:
    """Return the unit quaternion `wxyz` of a rotation matrix, with w >= 0.

    The longest of the four columns of 4 q q^T is normalised, so that half turns do not
    lose precision (Shepperd 1978).
    """
    m = np.moveaxis(rotation, (-2, -1), (0, 1))
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    wx = m[2, 1] - m[1, 2]
    wy = m[0, 2] - m[2, 0]
    wz = m[1, 0] - m[0, 1]
    xy = m[0, 1] + m[1, 0]
    xz = m[0, 2] + m[2, 0]
    yz = m[1, 2] + m[2, 1]
    xx, yy, zz = (1 + 2 * m[i, i] - trace for i in range(3))
    outer = np.array(
        [[1 + trace, wx, wy, wz], [wx, xx, xy, xz], [wy, xy, yy, yz], [wz, xz, yz, zz]]
    )
    diagonal = np.stack([1 + trace, xx, yy, zz])
    best = np.argmax(diagonal, axis=0)
    q = np.take_along_axis(
        np.moveaxis(outer, (0, 1), (-2, -1)), best[..., None, None], -2
    )
    q = q[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def rpy_to_matrix(
    rpy: Float[np.ndarray, "*batch 3"],
) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation by roll, pitch, yaw [rad] about fixed axes, as in URDF."""
    roll, pitch, yaw = (exp_so3(rpy[..., i, None] * np.eye(3)[i]) for i in range(3))
    return yaw @ pitch @ roll


def exp_so3(
    rotation_vector: Float[np.ndarray, "*batch 3"],
) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation about a vector by its length [rad] (Rodrigues' formula)."""
    angle = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    half = np.sinc(angle / (2 * np.pi))
    k = skew(rotation_vector)
    return np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * half**2 * (k @ k)


def log_so3(
    rotation: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 3"]:
    """Return the rotation vector [rad], of length at most pi; invert `exp_so3`."""
    q = matrix_to_quaternion(rotation)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    tiny = sine < 1e-150
    return q[..., 1:] * np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine))


def skew(v: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the matrix whose product with a vector w is the cross product v x w."""
    matrix = np.zeros((*v.shape, 3), dtype=v.dtype)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., i, j] = -v[..., k]
        matrix[..., j, i] = v[..., k]
    return matrix


def make_transform(
    R_a_b: Float[np.ndarray, "*#batch 3 3"],
    p_a_b: Float[np.ndarray, "*#batch 3"],
) -> Float[np.ndarray, "*out 4 4"]:
    """Return T_a_b, given the rotation and the origin of b in a [m]."""
    batch = np.broadcast_shapes(R_a_b.shape[:-2], p_a_b.shape[:-1])
    T_a_b = np.zeros((*batch, 4, 4), dtype=np.result_type(R_a_b, p_a_b))
    T_a_b[..., :3, :3] = R_a_b
    T_a_b[..., :3, 3] = p_a_b
    T_a_b[..., 3, 3] = 1.0
    return T_a_b


def compose(
    T_a_b: Float[np.ndarray, "*#batch 4 4"], T_b_c: Float[np.ndarray, "*#batch 4 4"]
) -> Float[np.ndarray, "*out 4 4"]:
    """Return T_a_c, which applies T_b_c first, then T_a_b."""
    return T_a_b @ T_b_c


def invert(T_a_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """Return T_b_a, the inverse of T_a_b."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return make_transform(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def apply(
    T_a_b: Float[np.ndarray, "*#batch 4 4"], p_b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*out 3"]:
    """Return points of frame b in frame a, for one transform or one a point."""
    return rotate(T_a_b, p_b) + T_a_b[..., :3, 3]


def rotate(
    T_a_b: Float[np.ndarray, "*#batch 4 4"], v_b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*out 3"]:
    """Return directions of frame b in frame a: rotated, not translated."""
    return np.einsum("...ij,...j->...i", T_a_b[..., :3, :3], v_b)


def random_rotation(
    rng: np.random.Generator, shape: tuple[int, ...] = ()
) -> Float[np.ndarray, "*batch 3 3"]:
    """Draw rotations uniformly from SO(3)."""
    return quaternion_to_matrix(rng.standard_normal((*shape, 4)))
