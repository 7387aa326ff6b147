"""This module holds the checks of `lab.golden`: what eskin answers to fixed inputs.

Only names of `eskin.__all__` and the command line are used.
"""

import contextlib
import hashlib
import io
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open

import eskin
from eskin.cli.main import run

SEED = "7"
TIMES = re.compile(r"seconds|clips_per_minute|step_ms|age_ms")
"""Results of commands that are times of the computer."""

Answer = dict[str, Any]


class MissingDataError(Exception):
    """Raised by a check whose recordings are not there."""


def call(*words: object) -> Answer:
    """Run one command of eskin; return its result without times.

    Raises:
        RuntimeError: the command fails.
    """
    out = io.StringIO()
    err = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([*map(str, words), "--json"])
    if code:
        raise RuntimeError(f"eskin {' '.join(map(str, words))}: {err.getvalue()}")
    result = json.loads(out.getvalue().splitlines()[-1])
    return {key: value for key, value in result.items() if not TIMES.match(key)}


def digest(data: bytes | str | np.ndarray) -> str:
    """Return the beginning of the SHA-256 of bytes, a text, or an array."""
    if isinstance(data, np.ndarray):
        data = f"{data.dtype} {data.shape} ".encode() + data.tobytes()
    data = data.encode() if isinstance(data, str) else data
    return hashlib.sha256(data).hexdigest()[:16]


def summarise(array: np.ndarray) -> Answer:
    """Return shape, least, mean and greatest value, and Euclidean norm of an array."""
    x = np.asarray(array, np.float64)
    stats = [x.min(), x.mean(), x.max(), np.linalg.norm(x)] if x.size else []
    return {"shape": list(x.shape), "min mean max norm": [float(v) for v in stats]}


def describe_recording(path: Path) -> Answer:
    """Return what a recording holds; stamps are relative to the first scan [s]."""
    recording = eskin.read_recording(path)
    arrays = recording.arrays()

    def relate(record: object) -> Answer:
        row = asdict(record)  # type: ignore[call-overload]
        for key in {"stamp", "start", "end", "onset"} & set(row):
            row[key] = (row[key] - recording.start) * 1e-9
        return row

    truths = [relate(truth) for truth in recording.truths()]
    values = sorted(
        {v for truth in truths for v in truth.values() if isinstance(v, str)}
    )
    numbers = [[v for v in t.values() if isinstance(v, float)] for t in truths]
    calibration = json.loads(recording.calibration.to_bytes())
    return {
        "robot": [recording.robot_name, *recording.joint_names],
        "urdf": digest(recording.urdf),
        "skin": [recording.skin.name, *(p.id for p in recording.skin.patches)],
        "positions": summarise(recording.skin.positions),
        "normals": summarise(recording.skin.normals),
        "calibration": {
            key: summarise(np.array(value)) if isinstance(value, list) else value
            for key, value in calibration.items()
        },
        "metadata": asdict(replace(recording.metadata, session="")),
        "labels": [list(relate(label).values()) for label in recording.labels],
        "detections": [relate(found) for found in recording.detections],
        "events": [list(relate(event).values()) for event in recording.events],
        "truths": {"count": len(truths), "names": values}
        | {"numbers": summarise(np.array(numbers))},
        "stamps": digest(arrays.stamps - recording.start),
        "counts": digest(arrays.counts),
        "received": digest(arrays.received),
        "shear": None if arrays.shear is None else digest(arrays.shear),
        "q": summarise(arrays.q),
    }


def describe_topics(path: Path) -> Answer:
    """Return, of each topic of an MCAP file, its schema, messages and their content."""
    from mcap.reader import make_reader

    topics: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            shape = [schema.name, digest(schema.data), channel.message_encoding]
            row = topics.setdefault(channel.topic, [*shape, 0, hashlib.sha256()])
            row[3] += 1
            row[4].update(message.data)
    return {name: [*row[:4], row[4].hexdigest()[:16]] for name, row in topics.items()}


def find_recording(folder: Path) -> Path:
    """Return the one recording of a folder."""
    [path] = folder.glob("*.mcap")
    return path


def generate(folder: Path, *options: object) -> Answer:
    """Generate recordings; return what they hold, and what is recognised in them."""
    made = call("generate", folder, "--seed", SEED, "--workers", 1, *options)
    path = find_recording(folder)
    index = {f.name: digest(f.read_bytes()) for f in folder.glob("clips.jsonl")}
    found = {"result": made, "index": index, "recording": describe_recording(path)}
    return found | {"replay": call("replay", path)}


def check_interface(folder: Path, data: Path) -> Answer:
    """Public names, and the commands with their options."""
    os.environ["COLUMNS"] = "100"
    overview = print_help()
    names = re.findall(r"^  eskin ((?:[a-z]+ )+)\s", overview + "\n", re.MULTILINE)
    found: Answer = {"names": sorted(eskin.__all__), "overview": overview.splitlines()}
    for name in names:
        text = print_help(*name.split())
        options = sorted(set(re.findall(r"--[a-z][\w.-]*", text)))
        found[name.strip()] = [" ".join(options), digest(text)]
    return found


def print_help(*words: str) -> str:
    """Return what `--help` prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        run([*words, "--help"])
    return out.getvalue()


def check_clips(folder: Path, data: Path) -> Answer:
    """Clips on the skin ur5."""
    found = generate(folder / "clips", "--clips", 4)
    return found | {"topics": describe_topics(find_recording(folder / "clips"))}


def check_stream(folder: Path, data: Path) -> Answer:
    """A stream on the skin ur5, with accidents and several touches at once."""
    return generate(folder / "stream", "--set", "streams", "--clips", 1)


def check_families(folder: Path, data: Path) -> Answer:
    """Clips of other families of sensors."""
    return generate(folder / "families", "--set", "train-families", "--clips", 4)


def check_design(folder: Path, data: Path) -> Answer:
    """A skin that is designed for the forearm, and clips on it."""
    skin = folder / "designed"
    words = ("--links", "forearm_link", "--density", 0.3, "--poses", 32, "--name", "d")
    report = call("skin", "design", "ur5", "--out", skin, *words)
    files = sorted(path for path in skin.rglob("*") if path.is_file())
    found: Answer = {
        "report": report,
        "files": {str(f.relative_to(skin)): digest_drawing(f) for f in files},
        "check": call("skin", "check", skin),
        "show": call("skin", "show", skin, "--robot", "ur5"),
    }
    call("skin", "convert", skin, folder / "d.urdf", "--robot-urdf", "ur5")
    found["urdf"] = digest((folder / "d.urdf").read_bytes())
    clips = ("--skin", skin, "--robot-urdf", "ur5", "--clips", 2)
    return found | generate(folder / "designed_clips", *clips)


def digest_drawing(path: Path) -> str:
    """Return the digest of a file; of a DXF without the order of its lines.

    The order of some entries of a DXF differs from run to run.
    """
    data = path.read_bytes()
    lines = data.splitlines(keepends=True)
    return digest(b"".join(sorted(lines)) if path.suffix == ".dxf" else data)


def check_demo(folder: Path, data: Path) -> Answer:
    """The demonstration without a page."""
    words = ("demo", "--headless", "--seed", 3)
    return {
        build: call(*words, "--seconds", 30, "--build", build)
        for build in ("fresh", "shifted")
    }


def check_run(folder: Path, data: Path) -> Answer:
    """The clips as a live source, and the recording of it."""
    source = find_recording(folder / "clips")
    path = folder / "run.mcap"
    words = ("--source", f"replay:{source}", "--pace", "inf", "--record", path)
    result = call("run", *words)
    del result["queues"]
    copy = folder / "replayed.mcap"
    replayed = call("replay", source, "--record", copy, "--threshold", 0.9)
    found = {"result": result, "recording": describe_recording(path)}
    return found | {"replayed": replayed, "topics": describe_topics(copy)}


def check_labels(folder: Path, data: Path) -> Answer:
    """Automatic labels, the score of the weights, and a calibration at rest."""
    clips = folder / "clips"
    stream = folder / "stream"
    path = folder / "rest.json"
    rest = ("--presses", 0, "--seconds", 1, "--out", path)
    source = f"replay:{find_recording(stream)}"
    found = {
        "label": call("label", clips, "--out", folder / "labelled"),
        "labelled": describe_recording(find_recording(folder / "labelled"))["labels"],
        "evaluate": call("evaluate", "ur5", clips, stream, "--workers", 1),
        "calibrate": call("calibrate", source, *rest) | {"out": "", "patches": []},
        "calibration": digest(path.read_bytes()),
    }
    words = ("replay", find_recording(stream), "--calibration", path)
    return found | {"replay": call(*words)["detections"][:10]}


def check_onnx(folder: Path, data: Path) -> Answer:
    """The weights ur5 as ONNX: what the network answers on random input."""
    from onnxruntime import InferenceSession

    path = folder / "ur5.onnx"
    rng = np.random.default_rng(0)
    call("export", "ur5", "--onnx", path)
    session = InferenceSession(path)
    inputs = session.get_inputs()
    sizes: dict[Any, int] = {}
    feed: dict[str, np.ndarray] = {}
    for one in inputs:
        shape = [
            size if isinstance(size, int) else sizes.setdefault(size, 24 - len(sizes))
            for size in one.shape
        ]
        if one.type == "tensor(int64)":
            feed[one.name] = rng.integers(0, 20, shape)
        else:
            feed[one.name] = rng.random(shape, np.float32)
    answers = session.run(None, feed)
    outputs = [one.name for one in session.get_outputs()]
    notes = session.get_modelmeta().custom_metadata_map
    return {
        "inputs": {one.name: [one.type, *map(str, one.shape)] for one in inputs},
        "metadata": {key: digest(value) for key, value in sorted(notes.items())},
        "outputs": {
            name: np.asarray(answer).ravel().tolist()
            for name, answer in zip(outputs, answers, strict=True)
        },
    }


def check_tables(folder: Path, data: Path) -> Answer:
    """The clips as a bag of ROS 2 and as Parquet tables."""
    from pyarrow.parquet import read_table

    path = find_recording(folder / "clips")
    bag = folder / "bag"
    tables = folder / "t"
    found: Answer = {"bag": call("export", path, "--rosbag", bag)}
    found["files"] = sorted(f.name for f in bag.iterdir())
    found["topics"] = describe_topics(find_recording(bag))
    found["tables"] = call("export", path, "--parquet", tables)
    for file in sorted(tables.glob("*.parquet")):
        table = read_table(file)
        found[file.name] = {
            name: [
                str(column.type),
                digest(json.dumps(column.to_pylist(), default=str)),
            ]
            for name, column in zip(table.column_names, table.columns, strict=True)
        }
    return found


def check_training(folder: Path, data: Path) -> Answer:
    """Two steps of training from the start, and two from the weights ur5."""
    return {
        name: train(folder / f"{name}.safetensors", folder / "clips", *options)
        for name, options in {"new": (), "started": ("--start", "ur5")}.items()
    }


def train(path: Path, *words: object) -> Answer:
    """Train for two steps; return the card as written, and a summary of each weight."""
    steps = ("--train.epochs", 1, "--train.steps", 2, "--seed", SEED)
    result = call("train", *words, *steps, "--out", path)
    with safe_open(path, framework="numpy") as file:
        card = json.loads(file.metadata()["eskin"])
        weights = {name: summarise(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118
    return {"result": result, "card": card, "weights": weights}


def check_sleeve(folder: Path, data: Path) -> Answer:
    """A real recording of a sleeve."""
    name = "Stroke_20250603112611_annotated.json.gz"
    return convert(folder, "sleeve", data / "sleeve" / name)


def check_socialtouch(folder: Path, data: Path) -> Answer:
    """A real recording of SocialTouch, and its touches placed on the arm."""
    source = data / "socialtouch"
    found = convert(folder, "socialtouch", source / "GesturesRated.csv", "p0_g6-")
    words = ("--set", "recorded", "--recorded", source, "--people", 0, "--clips", 2)
    return found | {"placed": generate(folder / "placed", *words)}


def check_shearsense(folder: Path, data: Path) -> Answer:
    """Real recordings with shear, and two steps of training on them."""
    names = ("slide/slide", "karate/karate")
    source = data / "shearsense"
    files = [source / f"{name}P3_Mar15th2023_FLAT 19_16_11.npz" for name in names]
    found = convert(folder, "shearsense", *files)
    trained = train(folder / "shear.safetensors", folder / "shearsense")
    path = sorted((folder / "shearsense").glob("*.mcap"))[-1]
    replayed = call("replay", path, "--model", folder / "shear.safetensors")
    return found | {"trained": trained, "replayed": replayed}


def convert(folder: Path, name: str, *files: Path | str) -> Answer:
    """Convert some files of a public set; return what they hold and what is recognised.

    Args:
        folder: folder for the results.
        name: name of the set.
        files: its files; a text is a part of a name beside the first file.

    Raises:
        MissingDataError: a file is not there.
    """
    first = Path(files[0])
    found = [Path(f) for f in files if isinstance(f, Path)]
    for part in (f for f in files if isinstance(f, str)):
        found += sorted(first.parent.glob(f"*{part}*"))
    missing = [path for path in found if not path.is_file()]
    if missing:
        raise MissingDataError(f"no {missing[0]}; say where they are by --data")
    source = folder / f"{name}_source"
    out = folder / name
    for path in found:
        place = source / path.parent.name if name == "shearsense" else source
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
    answer: Answer = {"result": call("convert", name, source, out)}
    for path in sorted(out.glob("*.mcap")):
        row = describe_recording(path) | {"replay": call("replay", path)}
        answer[path.name] = row
    return answer


CHECKS: dict[str, Callable[[Path, Path], Answer]] = {
    "interface": check_interface,
    "clips": check_clips,
    "stream": check_stream,
    "families": check_families,
    "design": check_design,
    "demo": check_demo,
    "run": check_run,
    "labels": check_labels,
    "onnx": check_onnx,
    "tables": check_tables,
    "training": check_training,
    "sleeve": check_sleeve,
    "socialtouch": check_socialtouch,
    "shearsense": check_shearsense,
}
"""Checks in their order: some use the recordings of earlier ones."""
