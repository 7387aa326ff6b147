"""These helpers write recordings that hold everything that one can."""

import numpy as np

from eskin.recording import (
    DetectionRecord,
    EventRecord,
    Label,
    Metadata,
    RecordingWriter,
    TruthRecord,
    write_all,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 123_456_789
JOINTS = ("shoulder", "elbow")
SKIN = build_grid_skin(3, 4, kind="shear", name="square")
CALIBRATION = Calibration(np.linspace(0.1, 0.2, SKIN.count), 4095, 0.5, 128)
METADATA = Metadata("set", "P1", "morning", "paper", {"rate": "50 Hz", "b": "ü"})
DETECTION = DetectionRecord(
    stamp=START + SECOND,
    gesture="poke",
    confidence=0.875,
    onset=START,
    end=START + SECOND // 2,
    link="forearm",
    patch="a",
    p_world=(0.1, 0.2, 0.3),
    n_world=(0.0, 0.6, 0.8),
    direction_world=(0.0, 0.0, 0.0),
    peak_force=12.5,
)
EVENT = EventRecord(START + SECOND, "lost", "patch a is lost", patch="a", row=2)
TRUTHS = tuple(
    TruthRecord(
        stamp=START + i * SECOND // 20,
        touch=i // 9,
        gesture="poke",
        kind="tip",
        link="arm",
        force=4.0 + i,
        area=1e-4,
        p_world=(0.1, -0.2, float(i)),
    )
    for i in range(12)
)


def make_scans(count, period=SECOND // 20, shear=True, joints=2):
    """Return scans of random values, the first at START."""
    rng = np.random.default_rng(7)
    scans = []
    for index in range(count):
        counts = rng.integers(0, 4096, SKIN.count).astype(np.int32)
        received = rng.random(SKIN.count) < 0.9
        q = rng.normal(size=joints)
        drag = rng.integers(-300, 300, (SKIN.count, 2)).astype(np.int32)
        stamp = START + index * period
        scans.append(Scan(stamp, counts, received, q, drag if shear else None))
    return scans


def make_labels(scans):
    """Return three labels of different sources, sorted, within some scans."""
    stamps = [scan.stamp for scan in scans]
    return (
        Label(stamps[3], stamps[10], "poke"),
        Label(stamps[5], stamps[12], "poke", "auto"),
        Label(stamps[20], stamps[-1] + 1, "stroke", "range"),
    )


def open_writer(path, joints=JOINTS, skin=SKIN):
    return RecordingWriter(path, "ur5", skin, CALIBRATION, METADATA, joints)


def write_recording(path, scans, labels=(), joints=JOINTS, truths=()):
    """Write scans and labels, a detection and an event."""
    with open_writer(path, joints) as writer:
        write_all(writer, scans, labels, [DETECTION], truths, [EVENT])
    return path


def assert_same_scans(found, expected):
    """Check that scans are equal in every field."""
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert one.stamp == other.stamp
        for name in ("counts", "received", "q"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert (one.shear is None) == (other.shear is None)
        if one.shear is not None:
            np.testing.assert_array_equal(one.shear, other.shear)
