"""Small skins and scans for the tests of eskin.touch."""

import numpy as np

from eskin.robot.robot import Joint, Link, Robot
from eskin.skin.mount import MountedSkin
from eskin.skin.skin import Patch, Skin
from eskin.touch import Calibration, Reading, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
REST = 200


def one_link_robot() -> Robot:
    return Robot("bench", (Link("table", ()),), ())


def grid_skin(
    rows=6, columns=6, patches=1, pitch=0.01, gap=0.015, calibrated=True
) -> Skin:
    """Flat patches side by side along x on the link `table`."""
    r, c = np.divmod(np.arange(rows * columns), columns)
    cells = len(r)
    width = (columns - 1) * pitch + gap
    x = np.concatenate([c * pitch + n * width for n in range(patches)])
    y = np.tile(r * pitch, patches)
    count = len(x)
    return Skin(
        name="grid",
        patches=tuple(
            Patch(f"p{n}", "table", n, rows, columns) for n in range(patches)
        ),
        patch_index=np.repeat(np.arange(patches), cells),
        rows=np.tile(r, patches),
        columns=np.tile(c, patches),
        positions=np.stack([x, y, np.zeros(count)], axis=1),
        normals=np.tile([0.0, 0.0, 1.0], (count, 1)),
        areas=np.full(count, pitch**2),
        tangents=np.tile([1.0, 0.0, 0.0], (count, 1)),
        calibrated=calibrated,
    )


def mounted_grid(**arguments) -> MountedSkin:
    return MountedSkin(grid_skin(**arguments), one_link_robot())


def calibration_of(skin: Skin) -> Calibration:
    """One count is 0.1 kPa."""
    return Calibration.uniform(skin.count, 1000, 100.0)


def scan_at(seconds, counts, received=None, shear=None) -> Scan:
    counts = np.asarray(counts, np.int32)
    if received is None:
        received = np.ones(len(counts), bool)
    stamp = START + round(seconds * SECOND)
    return Scan(stamp, counts, received, np.zeros(0), shear)


def reading_at(seconds, pressure, valid=None, q=None) -> Reading:
    pressure = np.asarray(pressure, np.float32)
    if valid is None:
        valid = np.ones(len(pressure), bool)
    stamp = START + round(seconds * SECOND)
    return Reading(stamp, pressure, valid, np.zeros(0) if q is None else q)


def pressed(skin: Skin, centre, kpa=20.0, radius=0.012) -> np.ndarray:
    """Pressures [kPa] of a round pad pressed at `centre`, in the link's frame [m]."""
    distance = np.linalg.norm(skin.positions[:, :2] - np.asarray(centre), axis=1)
    return np.where(distance <= radius, kpa, 0.0).astype(np.float32)


def hinge() -> Joint:
    """A hinge about y that turns link `upper` on link `table`, 1 cm over it."""
    T = np.eye(4)
    T[2, 3] = 0.01
    return Joint("hinge", "revolute", "table", "upper", T, np.array([0.0, 1.0, 0.0]))
