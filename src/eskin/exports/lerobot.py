"""This module writes recordings as a LeRobot data set, version 3 (extra `parquet`).

One recording is one episode, or one between each two gaps. Its frames lie on a grid at
the rate of the skin: each holds the last reading before it, which is not valid where it
is older than two frames. `meta/eskin.json` tells where the taxels are and what the
numbers of the gestures mean.
"""

import json
import logging
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from eskin.errors import RecordingError
from eskin.files import write_folder
from eskin.progress import track_progress
from eskin.recording import NONE, Label, Recording, select_labels
from eskin.recording.records import describe_rate
from eskin.registry import Exporter, find_package
from eskin.skin import MountedSkin
from eskin.touch import Reading, Scan, TouchPipeline
from eskin.transforms import matrix_to_quaternion
from eskin.units import NS_PER_S

logger = logging.getLogger(__name__)

VERSION = "v3.0"
CHUNK = 1000
"""Number of files in a folder."""
ROWS = 500
"""Number of frames that are held in memory."""
MAX_GAP = 2.0
"""Age of a reading in frames up to which a frame holds it."""
STATE = "observation.state"
TACTILE = "observation.tactile"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
COUNTERS = ("frame_index", "episode_index", "index", "task_index")
"""Integers that each frame of any data set has, beside its timestamp."""


@dataclass
class Stats:
    """These statistics of a feature are over the frames that were added."""

    count: int = 0
    total: Any = 0.0
    squares: Any = 0.0
    low: Any = np.inf
    high: Any = -np.inf

    def add_frames(self, values: Float[np.ndarray, "frame value"]) -> None:
        """Add frames."""
        self.count += len(values)
        self.total = self.total + values.sum(axis=0)
        self.squares = self.squares + (values**2).sum(axis=0)
        self.low = np.minimum(self.low, values.min(axis=0))
        self.high = np.maximum(self.high, values.max(axis=0))

    def merge(self, other: "Stats") -> None:
        """Add the frames of other statistics."""
        self.count += other.count
        self.total = self.total + other.total
        self.squares = self.squares + other.squares
        self.low = np.minimum(self.low, other.low)
        self.high = np.maximum(self.high, other.high)

    def describe(self) -> dict[str, list[float]]:
        """Return least, greatest, mean, standard deviation and count."""
        mean = self.total / self.count
        variance = np.maximum(self.squares / self.count - mean**2, 0.0)
        return {
            "min": np.atleast_1d(self.low).tolist(),
            "max": np.atleast_1d(self.high).tolist(),
            "mean": np.atleast_1d(mean).tolist(),
            "std": np.sqrt(np.atleast_1d(variance)).tolist(),
            "count": [self.count],
        }


@dataclass
class DatasetPlan:
    """A plan holds what all episodes of a data set share."""

    mounted: MountedSkin
    fps: int
    gestures: tuple[str, ...]
    """Names of the gestures by their numbers; number 0 is none."""
    links: tuple[int, ...]
    """Links that wear a patch, as indices."""
    features: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Features as `meta/info.json` describes them."""

    def __post_init__(self) -> None:
        """Describe the features."""
        skin = self.mounted.skin
        robot = self.mounted.robot
        parts = ("x", "y", "z", "qw", "qx", "qy", "qz")
        names = [f"{robot.link_names[n]}.{p}" for n in self.links for p in parts]
        self.add_feature(f"{TACTILE}.pressure", "float32", skin.count, None)
        self.add_feature(f"{TACTILE}.valid", "bool", skin.count, None)
        if skin.has_shear:
            self.add_feature(f"{TACTILE}.shear", "float32", 2 * skin.count, None)
        self.add_feature(f"{TACTILE}.link_poses", "float32", len(names), names)
        if robot.joint_names:
            self.add_feature(
                STATE, "float32", len(robot.joint_names), list(robot.joint_names)
            )
        self.add_feature("annotation.gesture", "int64", 1, ["gesture"])
        self.add_feature("annotation.detected", "int64", 1, ["gesture"])
        self.add_feature("timestamp", "float32", 1, None)
        for name in COUNTERS:
            self.add_feature(name, "int64", 1, None)

    def add_feature(
        self, name: str, dtype: str, size: int, names: list[str] | None
    ) -> None:
        """Add a feature of one dimension."""
        self.features[name] = {"dtype": dtype, "shape": [size], "names": names}


def write_lerobot(
    recordings: Sequence[Recording], folder: Path | str
) -> dict[str, int]:
    """Write recordings of one skin as a data set that `LeRobotDataset` opens.

    An episode ends at a gap of its recording, which is told. Single readings between
    gaps are left out.

    Args:
        recordings: the recordings.
        folder: folder of the data set, which must not exist.

    Returns:
        Numbers of `episodes` and `frames`.

    Raises:
        ExtraError: pyarrow is not installed.
        RecordingError: the recordings are of different skins or rates, one is empty, or
            the folder cannot be written.
    """
    arrow = find_package("pyarrow", "pyarrow", "parquet", "a LeRobot data set")
    parquet = find_package(
        "pyarrow.parquet", "pyarrow", "parquet", "a LeRobot data set"
    )
    plan = plan_dataset(recordings)
    total = {name: Stats() for name in plan.features}
    tasks: dict[str, int] = {}
    rows = []
    begin = 0
    tracking = closing(track_progress(recordings, "recordings", len(recordings)))
    with write_folder(Path(folder), RecordingError) as work, tracking as tracked:
        episodes = (each for one in tracked for each in split_episodes(one, plan))
        for number, (task, batches) in enumerate(episodes):
            task_index = tasks.setdefault(task, len(tasks))
            chunk, file = divmod(number, CHUNK)
            path = work / DATA.format(chunk_index=chunk, file_index=file)
            path.parent.mkdir(parents=True, exist_ok=True)
            stats = {name: Stats() for name in plan.features}
            end = begin
            schema = build_schema(arrow, plan)
            with parquet.ParquetWriter(path, schema, compression="snappy") as writer:
                for frames in batches:
                    count = len(frames["timestamp"])
                    frames["episode_index"] = np.full((count, 1), number)
                    frames["index"] = end + np.arange(count)[:, None]
                    frames["task_index"] = np.full((count, 1), task_index)
                    end += count
                    for name, values in frames.items():
                        stats[name].add_frames(values.astype(np.float64))
                    columns = [build_column(arrow, frames[n], plan, n) for n in total]
                    writer.write_table(arrow.Table.from_arrays(columns, schema=schema))
            for name, each in stats.items():
                total[name].merge(each)
            rows.append(
                {
                    "episode_index": number,
                    "tasks": [task],
                    "length": end - begin,
                    "data/chunk_index": chunk,
                    "data/file_index": file,
                    "dataset_from_index": begin,
                    "dataset_to_index": end,
                    "meta/episodes/chunk_index": 0,
                    "meta/episodes/file_index": 0,
                    **{
                        f"stats/{name}/{key}": value
                        for name, each in stats.items()
                        for key, value in each.describe().items()
                    },
                }
            )
            begin = end
        (work / EPISODES).parent.mkdir(parents=True)
        parquet.write_table(arrow.Table.from_pylist(rows), work / EPISODES)
        parquet.write_table(build_tasks(arrow, tasks), work / "meta" / "tasks.parquet")
        described = {name: each.describe() for name, each in total.items()}
        write_json(work / "meta" / "stats.json", described)
        write_json(work / "meta" / "info.json", describe_dataset(plan, rows, tasks))
        write_json(work / "meta" / "eskin.json", describe_skin(plan, recordings[0]))
    return {"episodes": len(rows), "frames": begin}


def plan_dataset(recordings: Sequence[Recording]) -> DatasetPlan:
    """Return what all recordings share.

    Raises:
        RecordingError: they are of different skins or rates, or one is empty or has
            an impossible rate.
    """
    rates = []
    names = {NONE: None}
    for recording in recordings:
        if not any(start < end for start, end in recording.runs):
            raise RecordingError(
                f"{recording.path} has no two readings without a gap between them; "
                "allowed are 2 or more; leave it out"
            )
        wrong = describe_rate(recording.period)
        if wrong is not None:
            raise RecordingError(f"{recording.path}: {wrong}")
        rates.append(NS_PER_S / recording.period)
        names |= dict.fromkeys(label.gesture for label in recording.labels)
        names |= dict.fromkeys(each.gesture for each in recording.detections)
    first = recordings[0]
    rate = max(round(float(np.median(rates))), 1)
    for recording, own in zip(recordings, rates, strict=True):
        same = recording.skin.patches == first.skin.patches
        same = same and np.array_equal(recording.skin.positions, first.skin.positions)
        if not same or recording.joint_names != first.joint_names:
            raise RecordingError(
                f"{recording.path} is of skin '{recording.skin.name}' on "
                f"'{recording.robot_name}', {first.path} of '{first.skin.name}' on "
                f"'{first.robot_name}'; allowed is one skin on one robot; export each "
                "by itself"
            )
        if abs(own - rate) > 0.2 * rate:
            raise RecordingError(
                f"{recording.path} has {own:.3g} readings a second, others {rate}; "
                "allowed is one rate; export each by itself"
            )
    mounted = MountedSkin(first.skin, first.load_robot())
    worn = dict.fromkeys(patch.link for patch in first.skin.patches)
    links = tuple(map(mounted.robot.link_index, worn))
    return DatasetPlan(mounted, rate, tuple(names), links)


def name_task(labels: Sequence[Label]) -> str:
    """Return the task of an episode: which gestures are made."""
    made = sorted({label.gesture for label in labels})
    return "touch the skin" + (f": {', '.join(made)}" if made else "")


def split_episodes(
    recording: Recording, plan: DatasetPlan
) -> Iterator[tuple[str, Iterator[dict[str, np.ndarray]]]]:
    """Yield task and frames of each part of a recording between two gaps.

    The frames of one have to be taken before the next is.
    """
    if recording.gaps:
        gaps = recording.describe_gaps()
        logger.warning("%s: %s; an episode ends at each", recording.path, gaps)
    pipeline = TouchPipeline(plan.mounted, recording.calibration)
    labels = select_labels(recording.labels)
    ends = [gap.start for gap in recording.gaps]
    parts = groupby(recording.scans(), lambda scan: bisect_left(ends, scan.stamp))
    for number, scans in parts:
        start, end = recording.runs[number]
        if start < end:
            own = [label for label in labels if label.is_within(start, end)]
            states = ((scan, pipeline.push_scan(scan).reading) for scan in scans)
            yield name_task(own), list_frames(recording, states, own, plan)
        else:
            for scan in scans:
                pipeline.push_scan(scan)


def list_frames(
    recording: Recording,
    states: Iterable[tuple[Scan, Reading]],
    labels: Sequence[Label],
    plan: DatasetPlan,
) -> Iterator[dict[str, np.ndarray]]:
    """Yield frames of an episode, some at a time, each feature as (frame, size).

    Args:
        recording: recording of the episode.
        states: its scans with their readings.
        labels: its labels.
        plan: what all episodes share.
    """
    period = NS_PER_S / plan.fps
    number = 0
    rows: list[dict[str, Any]] = []
    start = 0
    latest = {}
    detected = sorted((each.stamp, each.gesture) for each in recording.detections)

    def hold(until: int) -> Iterator[dict[str, np.ndarray]]:
        """Fill the grid with the latest reading, up to a time."""
        nonlocal number
        while latest and (stamp := start + round(number * period)) < until:
            named = [one.gesture for one in labels if one.start <= stamp < one.end]
            made = [g for at, g in detected if stamp - period < at <= stamp]
            row = latest | {
                "annotation.gesture": find(named[-1] if named else NONE),
                "annotation.detected": find(made[-1] if made else NONE),
                "timestamp": number / plan.fps,
                "frame_index": number,
            }
            if stamp - latest_stamp > MAX_GAP * period:
                row[f"{TACTILE}.valid"] = np.zeros(plan.mounted.skin.count, bool)
            rows.append(row)
            number += 1
            if len(rows) == ROWS:
                yield stack(rows, plan)
                rows.clear()

    def find(gesture: str) -> int:
        return plan.gestures.index(gesture)

    latest_stamp = 0
    for scan, reading in states:
        start = start if latest else scan.stamp
        yield from hold(scan.stamp)
        poses = plan.mounted.kinematics.poses(scan.q)[list(plan.links)]
        turned = matrix_to_quaternion(poses[:, :3, :3])
        latest_stamp = scan.stamp
        latest = {
            f"{TACTILE}.pressure": np.where(reading.valid, reading.pressure, 0.0),
            f"{TACTILE}.valid": reading.valid.copy(),
            f"{TACTILE}.link_poses": np.hstack([poses[:, :3, 3], turned]).reshape(-1),
        }
        if len(scan.q):
            latest[STATE] = scan.q
        if plan.mounted.skin.has_shear:
            shear = np.zeros((plan.mounted.skin.count, 2))
            if reading.shear is not None:
                shear = np.where(reading.valid[:, None], reading.shear, 0.0)
            latest[f"{TACTILE}.shear"] = shear.reshape(-1)
    yield from hold(latest_stamp + 1)
    if rows:
        yield stack(rows, plan)


def stack(rows: list[dict[str, Any]], plan: DatasetPlan) -> dict[str, np.ndarray]:
    """Return frames as arrays of (frame, size), but for what counts over episodes."""
    names = [name for name in plan.features if name in rows[0]]
    count = len(rows)
    return {n: np.array([row[n] for row in rows]).reshape(count, -1) for n in names}


def build_schema(arrow: Any, plan: DatasetPlan) -> Any:  # noqa: ANN401
    """Build the columns of the frames."""
    kinds = {"float32": arrow.float32(), "bool": arrow.bool_(), "int64": arrow.int64()}
    columns = []
    for name, each in plan.features.items():
        kind = kinds[each["dtype"]]
        [size] = each["shape"]
        columns.append((name, kind if size == 1 else arrow.list_(kind, size)))
    return arrow.schema(columns)


def build_column(
    arrow: Any,  # noqa: ANN401
    values: np.ndarray,
    plan: DatasetPlan,
    name: str,
) -> Any:  # noqa: ANN401
    """Build a column of a feature, (frame, size)."""
    flat = values.reshape(-1).astype(plan.features[name]["dtype"])
    [size] = plan.features[name]["shape"]
    column = arrow.array(flat)
    return column if size == 1 else arrow.FixedSizeListArray.from_arrays(column, size)


def build_tasks(arrow: Any, tasks: dict[str, int]) -> Any:  # noqa: ANN401
    """Build the table of tasks, whose index in pandas is the text of the task."""
    table = arrow.table({"task_index": list(tasks.values()), "task": list(tasks)})
    text = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    whole = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **whole},
            {"name": "task", "field_name": "task", **text},
        ],
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def describe_dataset(
    plan: DatasetPlan, rows: list[dict[str, Any]], tasks: dict[str, int]
) -> dict[str, Any]:
    """Return the content of `meta/info.json`."""
    return {
        "codebase_version": VERSION,
        "robot_type": plan.mounted.robot.name,
        "total_episodes": len(rows),
        "total_frames": rows[-1]["dataset_to_index"],
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": plan.fps,
        "splits": {"train": f"0:{len(rows)}"},
        "data_path": DATA,
        "video_path": None,
        "features": plan.features,
    }


def describe_skin(plan: DatasetPlan, recording: Recording) -> dict[str, Any]:
    """Return the content of `meta/eskin.json`."""
    skin = plan.mounted.skin
    patches = [patch.id for patch in skin.patches]
    return {
        "skin": skin.name,
        "gestures": list(plan.gestures),
        "units": {"pressure": "kPa", "shear": "kPa", "link_poses": "m, wxyz, of root"},
        "calibration": recording.calibration.source,
        "taxels": {
            "patch": [patches[n] for n in skin.patch_index.tolist()],
            "link": [skin.link_names[n] for n in skin.patch_index.tolist()],
            "row": skin.rows.tolist(),
            "column": skin.columns.tolist(),
            "position_link": np.round(skin.positions, 6).tolist(),
            "normal_link": np.round(skin.normals, 6).tolist(),
            "area_m2": skin.areas.tolist(),
        },
    }


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a file of JSON."""
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False), "utf-8")


DATASET = Exporter(write_lerobot)
