"""Small skins, scans and readings for the tests of eskin.touch."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from eskin.robot import Joint, Link, Robot
from eskin.skin import MountedSkin, Patch, Skin
from eskin.touch import (
    Calibration,
    PipelineConfig,
    Reading,
    Scan,
    TouchPipeline,
    TouchState,
)

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
REST = 200
RIGID_MOTION = np.eye(4)
RIGID_MOTION[:3, :3] = Rotation.from_rotvec([0.3, -0.7, 0.9]).as_matrix()
RIGID_MOTION[:3, 3] = 1.0, 2.0, -3.0


def one_link_robot() -> Robot:
    """Build a robot that consists of the link `table`."""
    return Robot("bench", (Link("table", ()),), ())


def build_grid_skin(
    rows=6, columns=6, patches=1, pitch=0.01, gap=0.015, calibrated=True
) -> Skin:
    """Build flat patches side by side along x on the link `table`."""
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


def build_mounted_grid(**arguments) -> MountedSkin:
    """Build the skin of `build_grid_skin` on its robot."""
    return MountedSkin(build_grid_skin(**arguments), one_link_robot())


def build_hinged_skin(T_world_base: np.ndarray | None = None) -> MountedSkin:
    """Build two patches that meet at a hinge: `p0` on the base, `p1` on the flap.

    Columns 5 lie side by side, 1 cm apart, 3 cm over the hinge, which turns about y:
    turning by q opens a gap between them.
    """
    base = build_grid_skin(patches=2)
    flap = base.patch_index == 1
    positions = base.positions.copy()
    positions[:, 0] = np.where(flap, 1, -1) * (0.055 - 0.01 * base.columns)
    positions[flap, 2] = 0.03
    patches = base.patches[0], replace(base.patches[1], link="flap")
    skin = replace(base, patches=patches, positions=positions)
    T = np.eye(4) if T_world_base is None else T_world_base
    y = np.array([0.0, 1.0, 0.0])
    stand = Joint("stand", "fixed", "world", "table", T, y)
    below = np.eye(4)
    below[2, 3] = -0.03
    hinge = Joint("hinge", "revolute", "table", "flap", below, y)
    links = (Link("world", ()), Link("table", ()), Link("flap", ()))
    return MountedSkin(skin, Robot("hinged", links, (stand, hinge)))


def reorder_taxels(skin: Skin, order: np.ndarray) -> Skin:
    """Return the same skin with its taxels in another order."""
    names = ("patch_index", "rows", "columns", "positions", "normals", "areas")
    return replace(
        skin, **{name: getattr(skin, name)[order] for name in (*names, "tangents")}
    )


def calibration_of(skin: Skin) -> Calibration:
    """Return a calibration in which one count is 0.1 kPa."""
    return Calibration.uniform(skin.count, 1000, 100.0)


def build_pipeline(mounted: MountedSkin, **stages) -> TouchPipeline:
    """Build a pipeline; keywords are the configurations of its stages."""
    config = PipelineConfig(**stages)
    return TouchPipeline(mounted, calibration_of(mounted.skin), config)


def scan_at(seconds, counts, received=None, shear=None) -> Scan:
    """Build a scan at a time since the start [s]."""
    counts = np.asarray(counts, np.int32)
    if received is None:
        received = np.ones(len(counts), bool)
    stamp = START + round(seconds * SECOND)
    return Scan(stamp, counts, received, np.zeros(0), shear)


def reading_at(seconds, pressure, valid=None, q=None) -> Reading:
    """Build a reading at a time since the start [s]."""
    pressure = np.asarray(pressure, np.float32)
    if valid is None:
        valid = np.ones(len(pressure), bool)
    stamp = START + round(seconds * SECOND)
    return Reading(stamp, pressure, valid, np.zeros(0) if q is None else q)


def press_pad(skin: Skin, centre, kpa=20.0, radius=0.012) -> np.ndarray:
    """Return the pressures [kPa] of a round pad at `centre`, in the link's frame."""
    distance = np.linalg.norm(skin.positions[:, :2] - np.asarray(centre), axis=1)
    return np.where(distance <= radius, kpa, 0.0).astype(np.float32)


def push_pressures(
    pipeline: TouchPipeline, pressures, rate=50, q=None, valid=None
) -> list[TouchState]:
    """Push one reading per row of pressures, and return the states.

    Args:
        pipeline: the pipeline.
        pressures: pressures of each reading [kPa].
        rate: readings per second.
        q: joint positions of each reading, or None where the robot has no joints.
        valid: mask of each reading, or None where all taxels are valid.
    """
    return [
        pipeline.push_reading(
            reading_at(
                n / rate,
                pressure,
                None if valid is None else valid[n],
                None if q is None else q[n],
            )
        )
        for n, pressure in enumerate(pressures)
    ]
