"""Store and read the worlds that are played: counts of a skin, with the truth.

`fresh` and the families are the arm under a person's touches on a fresh build and on
builds as drawn, `flaws` on a build with all flaws typical, as of `lab.front_ends`.
`faults` is an intact build on which taxels and rows fail meanwhile. The matrices are of
`lab.vary.matrix`. The real ones are untouched recordings of public sets.
"""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.recording import find_recordings, read_recording
from eskin.sim.sensor import FAMILIES
from eskin.skin import MountedSkin, mount_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.attacks import skin_faults
from lab.flaws.real import SETS, keep_apart
from lab.flaws.scoring import TrueContact
from lab.flaws.stream import ALL, INTACT
from lab.front_ends import FAULTS, SETTLING, find_skin, make_world
from lab.vary.matrix import (
    FULL_SCALE,
    MatrixPlan,
    build_calibration,
    build_matrix_skin,
    simulate,
)

MATRICES = {
    "matrix": MatrixPlan(),
    "dead column": MatrixPlan(dead=True),
    "slow release": MatrixPlan(crosstalk=0.02, release=0.5, creep=0.1),
    "events": MatrixPlan(crosstalk=0.0, events=True),
    "rests": MatrixPlan(crosstalk=0.01, drift=25.0, rests=65.0),
    "loose": MatrixPlan(crosstalk=0.0, loose=True),
    "falling": MatrixPlan(crosstalk=0.02, release=0.3, creep=0.1, falling=True),
}
"""Matrices by the names of their worlds."""
FAULT_STARTS = {
    "floating row, slow": 0.0,
    "telegraph, 0.2 %": 10.0,
    "1 % noisy, sigma 9": 20.0,
    "floating column": 30.0,
    "offset jumps": 40.0,
    "hum of a patch": 60.0,
}
"""Faults that are put on the arm in the world `faults`, and when they begin [s]."""
SECONDS_PER_TOUCH = 4.5
"""Mean time of a touch on the arm with the pause after it [s]."""
HALF = (*FAMILIES, "falling", "loose")
"""Worlds that are half as long as the others."""
REAL = {
    "shearsense": ("no_*.mcap", 6),
    "sleeve": ("*Unknown_20250603112719*.mcap", 1),
}
"""Recordings of each public set that are played, and at most how many."""


@final
@dataclass(frozen=True, eq=False)
class World:
    """Holds the scans of one skin, with the truth."""

    name: str
    mounted: MountedSkin
    calibration: Calibration
    stamps: Int[np.ndarray, "scan"]
    counts: Int[np.ndarray, "scan taxel"]
    received: Bool[np.ndarray, "scan taxel"]
    q: Float[np.ndarray, "joint"]
    truths: tuple[TrueContact, ...]
    sound: Bool[np.ndarray, "taxel"]
    """Taxels that are not faulty at any time."""
    untouched: Bool[np.ndarray, "scan"]
    """Scans at which a touch that begins is false, unless a true one explains it."""

    def scans(self) -> Iterator[Scan]:
        """Yield its scans."""
        for n, stamp in enumerate(self.stamps.tolist()):
            counts = self.counts[n].astype(np.int32)
            yield Scan(stamp, counts, self.received[n], self.q)


def make_arm(folder: Path, kind: str, number: int, seconds: float) -> None:
    """Simulate the arm under touches, unless it is there."""
    if not (folder / name_arm(kind, number)).is_file():
        count = round((seconds - SETTLING) / SECONDS_PER_TOUCH)
        make_world(folder, "touch", kind, number, SETTLING, count)


def name_arm(kind: str, number: int) -> str:
    """Return the name of the file of an arm."""
    return f"touch-{kind.replace(' ', '_')}-{number}.npz"


def list_arms(seed: int) -> dict[str, tuple[str, int]]:
    """Return the row and the number of the build of each world of the arm."""
    first = 4 * (seed + 1)
    arms = {name: (name, first + n) for n, name in enumerate(FAMILIES)}
    arms |= {"fresh": ("fresh", first), "flaws": (ALL, first)}
    return arms | {"faults": (INTACT, first)}


def read_arm(folder: Path, name: str, seed: int) -> World:
    """Read a world of the arm."""
    row, number = list_arms(seed)[name]
    with np.load(folder / name_arm(row, number)) as file:
        data = dict(file)
    mounted, calibration = find_skin(row, number)
    count = mounted.skin.count
    stamps = data["stamps"]
    counts = data["counts"].astype(np.int32)
    received = np.unpackbits(data["received"], axis=1, count=count).astype(bool)
    truths = []
    for n, (start, size) in enumerate(data["spans"].tolist()):
        span = slice(start, start + size)
        truths.append(
            TrueContact(
                str(data["gestures"][n]),
                stamps[span],
                data[f"force{n}"],
                data[f"centre{n}"],
            )
        )
    sound = np.ones(count, bool)
    if name == "faults":
        sound = add_faults(counts, stamps, mounted, calibration, seed)
    everywhere = np.ones(len(stamps), bool)
    return World(
        name,
        mounted,
        calibration,
        stamps,
        counts,
        received,
        data["q"],
        tuple(truths),
        sound,
        everywhere,
    )


def add_faults(
    counts: Int[np.ndarray, "scan taxel"],
    stamps: Int[np.ndarray, "scan"],
    mounted: MountedSkin,
    calibration: Calibration,
    seed: int,
) -> Bool[np.ndarray, "taxel"]:
    """Add faults to counts; return the taxels that stay sound."""
    sound = np.ones(counts.shape[1], bool)
    seconds = (stamps - stamps[0]) / NS_PER_S
    for n, (fault, start) in enumerate(FAULT_STARTS.items()):
        target = skin_faults.build_target(mounted.skin, calibration, 100 * seed + n)
        disturb = FAULTS[fault](target)
        for place in np.flatnonzero(seconds >= start):
            added = np.round(disturb(seconds[place] - start) * target.unit)
            counts[place] += added.astype(counts.dtype)
            sound &= added == 0.0
    np.clip(counts, 0, calibration.full_scale, out=counts)
    return sound


def make_matrix(folder: Path, name: str, seconds: float, seed: int) -> None:
    """Simulate a matrix under touches, unless it is there."""
    path = folder / f"{name}.npz"
    if path.is_file():
        return
    found = simulate(MATRICES[name], seconds, seed)
    arrays: dict[str, Any] = {
        "stamps": found.stamps,
        "counts": found.counts,
        "received": found.received,
        "sound": found.sound,
        "rest": found.rest,
        "starts": np.array([one.stamps[0] for one in found.truths]),
        "gestures": np.array([one.gesture for one in found.truths]),
        "force": np.concatenate([one.force for one in found.truths]),
        "centre": np.concatenate([one.centre for one in found.truths]),
        "ends": np.cumsum([len(one.stamps) for one in found.truths]),
    }
    np.savez_compressed(path, **arrays)


def read_matrix(folder: Path, name: str) -> World:
    """Read the world of a matrix."""
    with np.load(folder / f"{name}.npz") as file:
        data = dict(file)
    plan = MATRICES[name]
    mounted = build_matrix_skin()
    stamps = data["stamps"]
    first = np.searchsorted(stamps, data["starts"])
    truths = []
    begin = 0
    for n, end in enumerate(data["ends"].tolist()):
        span = slice(first[n], first[n] + end - begin)
        force = data["force"][begin:end]
        centre = data["centre"][begin:end]
        gesture = str(data["gestures"][n])
        truths.append(TrueContact(gesture, stamps[span], force, centre))
        begin = end
    # With a hand on it at the start, or counts that fall, rest is not known before.
    known = not (plan.events or plan.falling)
    rest = np.where(data["sound"], data["rest"] - plan.drift, 0.0)
    untouched = np.ones(len(stamps), bool)
    untouched[stamps < data["starts"][0]] = not plan.events
    if plan.falling:
        # Touches mean nothing until somebody corrects the calibration.
        truths = []
        untouched[:] = False
    return World(
        name,
        mounted,
        build_calibration(plan, mounted, rest if known else None),
        stamps,
        np.clip(data["counts"].astype(np.int32), -1, FULL_SCALE),
        data["received"],
        np.zeros(len(mounted.robot.joint_names)),
        tuple(truths),
        data["sound"],
        untouched,
    )


def make_real(folder: Path, data: Path, kind: str) -> str:
    """Convert the recordings of a public set; return why there are none."""
    target = folder / kind
    if target.is_dir():
        return ""
    if not (data / kind).is_dir():
        return f"no folder {data / kind}"
    pattern, most = REAL[kind]
    with tempfile.TemporaryDirectory() as work:
        SETS[kind].convert(data / kind, Path(work))
        target.mkdir(parents=True)
        for path in sorted(Path(work).glob(pattern))[:most]:
            shutil.copy(path, target / path.name)
    return ""


def read_real(path: Path, kind: str) -> World:
    """Read an untouched recording, or one with untouched stretches."""
    recording = read_recording(path)
    scans = list(recording.scans())
    stamps = np.array([scan.stamp for scan in scans])
    mounted = mount_skin(recording.skin, recording.robot_name)
    return World(
        f"{kind} {path.stem}",
        mounted,
        recording.calibration,
        stamps,
        np.array([scan.counts for scan in scans]),
        np.array([scan.received for scan in scans]),
        scans[0].q,
        (),
        np.ones(mounted.skin.count, bool),
        keep_apart(stamps, SETS[kind].untouched(recording, scans)),
    )


def read_worlds(folder: Path, seed: int) -> Iterator[World]:
    """Yield all worlds of a folder."""
    for name in list_arms(seed):
        yield read_arm(folder, name, seed)
    for name in MATRICES:
        yield read_matrix(folder, name)
    for kind in REAL:
        if (folder / kind).is_dir():
            for path in find_recordings((folder / kind,)):
                yield read_real(path, kind)
