"""These helpers write readings of a skin as archives, as others would record them."""

import numpy as np

from eskin.notebook import measure_pressures
from eskin.recording import select_labels
from eskin.skin import MountedSkin, Patch, Skin, save_skin
from eskin.transforms import matrix_to_quaternion, random_rotation

TOY_URDF = """<robot name="toy">
<link name="base"/><link name="upper"/><link name="fore"/><link name="hand"/>
<link name="tool"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
  <limit lower="-3.2" upper="3.2" effort="1" velocity="1"/></joint>
<joint name="bend" type="continuous"><parent link="upper"/><child link="fore"/>
  <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint>
<joint name="reach" type="prismatic"><parent link="fore"/><child link="hand"/>
  <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="0.2" effort="1" velocity="1"/></joint>
<joint name="spin" type="continuous"><parent link="hand"/><child link="tool"/>
  <origin xyz="0.1 0 0"/><axis xyz="1 0 0"/></joint>
</robot>"""
"""Arm of four joints, of which the last moves no taxel of `build_toy_skin`."""


def build_toy_skin():
    """Return a skin of one patch on each of three links, of five, two and one taxel."""
    rng = np.random.default_rng(4)
    links = {"upper": 5, "fore": 2, "hand": 1}
    index = np.repeat(np.arange(3), list(links.values()))
    columns = np.concatenate([np.arange(count) for count in links.values()])
    frames = random_rotation(rng, (len(index),))
    return Skin(
        "toy",
        tuple(
            Patch(link, link, number, 1, count)
            for number, (link, count) in enumerate(links.items())
        ),
        index,
        np.zeros(len(index), np.int64),
        columns,
        rng.uniform(-0.1, 0.1, (len(index), 3)),
        frames[:, :, 2],
        np.full(len(index), 1e-4),
        frames[:, :, 0],
    )


def save_toy(folder):
    """Save the toy skin and its robot; return the options that name them."""
    save_skin(build_toy_skin(), folder / "skin")
    (folder / "toy.urdf").write_text(TOY_URDF)
    return ("--skin", folder / "skin", "--robot-urdf", folder / "toy.urdf")


def build_poses(mounted, q, numbers=7):
    """Return the pose of each taxel at joint positions: wxyz or rows of a matrix."""
    positions, _ = mounted.place_taxels(q)
    frames = mounted.compute_frames(q)
    if numbers == 7:
        quaternions = matrix_to_quaternion(frames)
        return np.concatenate([positions, quaternions], axis=-1)
    return np.concatenate([frames, positions[..., None]], axis=-1)


def write_archive(recording, path, numbers=7):
    """Write a recording as the paper describes its own: poses, pressures, gestures."""
    mounted = MountedSkin(recording.skin, recording.load_robot())
    arrays = recording.arrays()
    labels = select_labels(recording.labels)
    np.savez(
        path,
        pressure=np.asarray(measure_pressures(recording), np.float32),
        poses=build_poses(mounted, arrays.q, numbers).astype(np.float32),
        stamp=arrays.stamps,
        gesture=[label.gesture for label in labels],
        start=[label.start for label in labels],
        end=[label.end for label in labels],
        person=recording.metadata.subject,
        session=recording.metadata.session,
    )
