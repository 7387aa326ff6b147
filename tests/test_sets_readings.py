"""Tests of tables of a whole skin: joint positions from poses, archives, chunks."""

import json
import tracemalloc

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from eskin.notebook import measure_pressures
from eskin.recording import read_recording
from eskin.robot import load_urdf
from eskin.sets import reading_files, skin_table
from eskin.sets.joint_solver import JointSolver
from eskin.sim.dataset import GenerationSettings, generate
from eskin.skin import MountedSkin, load_robot_for_skin, load_skin
from helpers.archives import (
    build_poses,
    build_toy_skin,
    save_toy,
    write_archive,
)
from helpers.cli import assert_refused, call_json
from lab.compare import run_compare
from lab.program import run_program

pytestmark = pytest.mark.slow

COUNT = 60
"""Number of readings of the toy."""


@pytest.fixture
def toy(tmp_path):
    """Return the toy's skin on its robot, and the options that name them."""
    options = save_toy(tmp_path)
    return MountedSkin(build_toy_skin(), load_urdf(tmp_path / "toy.urdf")), options


def mount(name):
    return MountedSkin(load_skin(name), load_robot_for_skin(name))


def walk(mounted, count=COUNT, seed=0):
    """Return joint positions of a robot that moves a little at each reading."""
    rng = np.random.default_rng(seed)
    joints = len(mounted.robot.joint_names)
    steps = 0.02 * rng.normal(size=(count, joints))
    return rng.uniform(-1, 1, joints) * [1, 1, 0.05, 0][:joints] + (
        np.cumsum(steps, axis=0) * [1, 1, 0.1, 0][:joints]
    )


def make_content(mounted, numbers=7):
    """Return the arrays of an archive of the toy: two touches while it moves."""
    rng = np.random.default_rng(1)
    pressure = rng.uniform(-0.5, 0.5, (COUNT, mounted.skin.count))
    pressure[10:20, 2] = 30.0
    pressure[35:50, 5] = 180.0
    return {
        "pressure": pressure,
        "poses": build_poses(mounted, walk(mounted), numbers),
        "stamp": 1_700_000_000_000_000_000 + 20_000_000 * np.arange(COUNT),
        "gesture": np.repeat(
            ["none", "poke", "", "grab", "none"], [10, 10, 15, 15, 10]
        ),
        "person": np.array("Ann-1"),
        "session": np.array("monday"),
    }


def write_parquet(path, content):
    """Write columns of arrays as lists, and one value a file for each row."""
    columns = {}
    for name, values in content.items():
        rows = np.broadcast_to(values, (COUNT,)) if not values.ndim else values
        columns[name] = rows.reshape(len(rows), -1).tolist() if rows.ndim > 1 else rows
    parquet.write_table(pa.table(columns), path, row_group_size=25)


def convert(capsys, tmp_path, options):
    """Convert the archives of a folder; return the result and the recordings."""
    out = tmp_path / "out"
    result, text = call_json(capsys, "convert", "table", tmp_path / "in", out, *options)
    return result, [read_recording(path) for path in sorted(out.iterdir())], text


@pytest.mark.parametrize("name", ["ur5", "ur10"])
def test_solved_joint_positions_put_the_taxels_of_an_arm_where_they_were(name):
    mounted = mount(name)
    low = np.maximum(mounted.robot.lower, -3)
    q = np.random.default_rng(2).uniform(low, -low, (20, len(low)))
    positions, _ = mounted.place_taxels(q)
    solved, _ = mounted.place_taxels(JointSolver(mounted).solve(positions))
    np.testing.assert_allclose(solved, positions, atol=1e-4)


def test_solved_joint_positions_of_few_taxels_are_the_true_ones(toy):
    mounted, _ = toy
    q = walk(mounted)
    positions, _ = mounted.place_taxels(q)
    solver = JointSolver(mounted)
    assert solver.moving.tolist() == [True, True, True, False]
    np.testing.assert_allclose(solver.solve(positions), q, atol=1e-6)


def test_solved_joint_positions_make_no_full_turns_and_stay_within_limits():
    mounted = mount("ur5")
    q = np.linspace([-3, -2, -1, 0, 1, 2], [9, -2, -1, 0, 1, -8], 300)
    positions, _ = mounted.place_taxels(q)
    solved = JointSolver(mounted).solve(positions)
    lower, upper = mounted.robot.lower, mounted.robot.upper
    assert (solved >= lower).all() and (solved <= upper).all()
    turns = np.abs(np.diff(solved, axis=0)).max(axis=1)
    assert (turns > 1).sum() == 2  # where two joints pass a limit


@pytest.mark.parametrize("numbers", [7, 12])
@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_archive_with_poses_keeps_pressures_labels_and_places(
    kind, numbers, toy, tmp_path, capsys
):
    mounted, options = toy
    content = make_content(mounted, numbers)
    (tmp_path / "in").mkdir()
    if kind == "npz":
        np.savez_compressed(tmp_path / "in" / "a.npz", **content)
    else:
        write_parquet(tmp_path / "in" / "a.parquet", content)
    result, [recording], text = convert(capsys, tmp_path, options)
    poses = result.pop("poses")
    assert result == {"recordings": 1, "taxels": 8, "readings": COUNT, "labels": 2}
    assert poses["worst_mm"] < 1e-3 and poses["unsolved"] == ["spin"]
    assert "move no taxel are zero: spin" in text and "taxel" in poses["where"]
    arrays = recording.arrays()
    np.testing.assert_array_equal(arrays.stamps, content["stamp"])
    calibration = recording.calibration
    pressure = calibration.gain * (arrays.counts - calibration.rest)
    np.testing.assert_allclose(pressure, content["pressure"], atol=0.002)
    np.testing.assert_allclose(
        build_poses(mounted, arrays.q), build_poses(mounted, walk(mounted)), atol=1e-4
    )
    stamps = content["stamp"]
    assert [(each.start, each.end, each.gesture) for each in recording.labels] == [
        (stamps[10], stamps[20], "poke"),
        (stamps[35], stamps[50], "grab"),
    ]
    metadata = recording.metadata
    assert (metadata.subject, metadata.session) == ("Ann-1", "monday")
    assert recording.load_robot().joint_names == mounted.robot.joint_names


def test_labels_by_repetition_and_counts_with_joint_positions_are_kept(
    toy, tmp_path, capsys
):
    mounted, options = toy
    counts = np.random.default_rng(3).integers(0, 4096, (COUNT, 8))
    received = np.random.default_rng(4).random((COUNT, 8)) < 0.9
    content = {"counts": counts, "received": received, "q": walk(mounted)}
    labels = {"what": ["Wave twice", "none"], "start": [0.2, 0.5], "end": [0.4, 0.9]}
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / "a.npz", rate=50.0, **content, **labels)
    write_parquet(tmp_path / "in" / "b.parquet", content)
    parquet.write_table(pa.table(labels), tmp_path / "in" / "b.labels.parquet")
    options = (*options, "--label", "what")
    (tmp_path / "npz").mkdir()
    (tmp_path / "in" / "a.npz").rename(tmp_path / "npz" / "a.npz")
    words = ("convert", "table", tmp_path / "npz", tmp_path / "out", *options)
    call_json(capsys, *words)
    _, recordings, _ = convert(capsys, tmp_path, (*options, "--rate", 50))
    for recording in recordings:
        arrays = recording.arrays()
        np.testing.assert_array_equal(arrays.counts[received], counts[received])
        np.testing.assert_array_equal(arrays.received, received)
        np.testing.assert_allclose(arrays.q, content["q"])
        starts = [(each.start - recording.start) / 1e9 for each in recording.labels]
        assert starts == pytest.approx(labels["start"])
        assert [each.gesture for each in recording.labels] == ["Wave twice", "none"]
        assert recording.metadata.subject == recording.path.stem
    assert len(recordings) == 2


@pytest.mark.parametrize(
    ("last", "part"),
    [
        ((9, 10), "1 of 3 labels lie outside of the recording, 7.82 s from it"),
        ((0.9, 0.8), "label 'wave' ends at"),
        ((0.3, 0.6), "labels 'wave' from 0.00 to 0.40 s and 'wave' from 0.30"),
    ],
)
def test_wrong_labels_beside_a_file_are_refused_by_the_name_of_theirs(
    last, part, toy, tmp_path, capsys
):
    mounted, options = toy
    content = make_content(mounted)
    content["stamp"] = 0.02 * np.arange(COUNT)
    start, end = last
    labels = {"gesture": ["wave"] * 3, "start": [0, 0.5, start], "end": [0.4, 0.9, end]}
    (tmp_path / "in").mkdir()
    write_parquet(tmp_path / "in" / "b.parquet", content)
    parquet.write_table(pa.table(labels), tmp_path / "in" / "b.labels.parquet")
    words = ("convert", "table", tmp_path / "in", tmp_path / "out", *options)
    assert_refused(capsys, *words, part=f"b.labels.parquet: {part}")
    assert not (tmp_path / "out").exists()


def test_each_person_and_session_of_a_file_is_a_recording(toy, tmp_path, capsys):
    mounted, options = toy
    content = make_content(mounted)
    content["person"] = np.repeat(["Ann", "Bob"], [30, 30])
    content["session"] = np.repeat(["1", "2", "1"], [15, 15, 30])
    content["stamp"] = np.tile(0.02 * np.arange(15), 4) + np.repeat([0, 1], 30) / 3
    content["stamp"][45:] += 1.0
    (tmp_path / "in").mkdir()
    write_parquet(tmp_path / "in" / "set.parquet", content)
    _, recordings, _ = convert(capsys, tmp_path, options)
    assert [each.path.stem for each in recordings] == [
        "set-Ann-1",
        "set-Ann-2",
        "set-Bob-1",
    ]
    assert [each.count for each in recordings] == [15, 15, 30]
    labels = [[each.gesture for each in one.labels] for one in recordings]
    assert labels == [["poke"], ["poke"], ["grab"]]


def test_distances_of_measured_poses_are_told(toy, tmp_path, capsys):
    mounted, options = toy
    content = make_content(mounted)
    content["poses"][:, :, :3] += np.random.default_rng(0).normal(
        0.0, 2e-4, (COUNT, 8, 3)
    )
    content["poses"][40, 7, 0] += 0.001
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / "a.npz", **content)
    result, [recording], _ = convert(capsys, tmp_path, options)
    placed = build_poses(mounted, recording.arrays().q)[:, :, :3]
    distances = np.linalg.norm(placed - content["poses"][:, :, :3], axis=2)
    poses = result["poses"]
    assert poses["rms_mm"] == pytest.approx(1e3 * np.sqrt((distances**2).mean()))
    assert poses["worst_mm"] == pytest.approx(1e3 * distances.max())
    row, taxel = np.unravel_index(distances.argmax(), distances.shape)
    assert (
        f"reading {row}, taxel {taxel} ({TOY.describe_taxel(int(taxel))})"
        in poses["where"]
    )


def test_poses_that_do_not_change_are_solved_once(toy, tmp_path, capsys, monkeypatch):
    mounted, options = toy
    content = make_content(mounted)
    content["poses"][1:] = content["poses"][0]
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / "a.npz", **content)
    solved = []
    solve = JointSolver.solve

    def count(self, positions):
        solved.append(len(positions))
        return solve(self, positions)

    monkeypatch.setattr(JointSolver, "solve", count)
    monkeypatch.setattr(skin_table, "CHUNK_BYTES", 8 * 8 * 8 * 7)
    _, [recording], _ = convert(capsys, tmp_path, options)
    assert sum(solved) == 1 and len(solved) > 1
    np.testing.assert_allclose(
        build_poses(mounted, recording.arrays().q), content["poses"], atol=1e-6
    )


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_memory_of_reading_is_that_of_chunks(kind, tmp_path):
    path = tmp_path / f"a.{kind}"
    values = np.random.default_rng(0).random((20_000, 100))
    if kind == "npz":
        np.savez_compressed(path, poses=values)
    else:
        column = pa.FixedSizeListArray.from_arrays(values.ravel(), 100)
        table = pa.table({"poses": column})
        parquet.write_table(table, path, row_group_size=1000)
    rows = 0
    tracemalloc.start()
    before = pa.total_allocated_bytes()
    most = 0
    with reading_files.open_readings(path) as file:
        for chunk in file.iterate({"poses": (100,)}, 500):
            most = max(most, pa.total_allocated_bytes() - before)
            np.testing.assert_array_equal(chunk["poses"], values[rows : rows + 500])
            rows += len(chunk["poses"])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert rows == len(values)
    assert peak + most < values.nbytes / 3


def turn_quaternions(poses):
    """Return poses with quaternions in the order xyzw."""
    return np.concatenate([poses[..., :3], np.roll(poses[..., 3:], -1, -1)], axis=-1)


def change(content, name, index, value):
    """Return a content in which one entry of an array has another value."""
    values = content[name].copy()
    values[index] = value
    return content | {name: values}


def leave_out(content, *names):
    return {name: content[name] for name in content if name not in names}


TOY = build_toy_skin()
BAD = {
    "one taxel too few": (
        lambda c: c | {"pressure": c["pressure"][:, 1:]},
        "'pressure' has 7 numbers a reading; allowed are 8",
    ),
    "one pose too few": (
        lambda c: c | {"poses": c["poses"][:, 1:]},
        "'poses' has 49 numbers a reading; allowed are 56 or 96",
    ),
    "one reading too few": (
        lambda c: c | {"poses": c["poses"][1:]},
        "'pressure' 60, 'poses' 59",
    ),
    "NaN of a pressure": (
        lambda c: change(c, "pressure", (7, 3), np.nan),
        "reading 7: 'pressure' 3 is nan",
    ),
    "NaN of a pose": (
        lambda c: change(c, "poses", (7, 3, 1), np.nan),
        f"reading 7: taxel 3 ({TOY.describe_taxel(3)}) has a pose that is not",
    ),
    "millimetres": (
        lambda c: c | {"poses": c["poses"] * [1e3, 1e3, 1e3, 1, 1, 1, 1]},
        "1e+03 times as far apart as on skin 'toy'; allowed are positions in metres",
    ),
    "quaternions xyzw": (
        lambda c: c | {"poses": turn_quaternions(c["poses"])},
        "write quaternions as wxyz",
    ),
    "no quaternions": (
        lambda c: c | {"poses": c["poses"] * [1, 1, 1, 2, 2, 2, 2]},
        "z axis of length 4; allowed is 1",
    ),
    "a taxel 5 mm away": (
        lambda c: change(c, "poses", (9, 4, 2), c["poses"][9, 4, 2] + 0.005),
        f"reading 9: taxel 4 ({TOY.describe_taxel(4)}) lies 5.0 mm",
    ),
    "another base": (
        lambda c: change(
            c, "poses", (..., slice(3)), c["poses"][..., :3] + [0, 0, 0.5]
        ),
        "in the frame of 'base'",
    ),
    "joint positions of other poses": (
        lambda c: c | {"q": np.zeros((COUNT, 4))},
        "mm from where the joint positions put it",
    ),
    "no joint positions": (lambda c: leave_out(c, "poses"), "no poses or q in"),
    "no pressure": (lambda c: leave_out(c, "pressure"), "no counts or pressure in"),
    "no labels": (
        lambda c: leave_out(c, "gesture") | {"labels": c["gesture"]},
        "no column 'gesture' in pressure, poses, stamp, person, session, labels",
    ),
    "too few labels": (
        lambda c: c | {"gesture": c["gesture"][1:]},
        "'gesture' has shape (59,); allowed is (60,)",
    ),
    "label outside": (
        lambda c: c | {"gesture": ["a"], "start": [1], "end": [2]},
        "1 of 1 labels lie outside of the recording, 54 years from it",
    ),
    "one label outside": (
        lambda c: (
            c
            | {"gesture": ["a", "b", "a"]}
            | {"start": [*c["stamp"][[3, 20]], 1], "end": [*c["stamp"][[7, 40]], 2]}
        ),
        "1 of 3 labels lie outside of the recording, 54 years from it; the first is "
        "'a' from -1700000000.00 to -1700000000.00 s (stamp 1 ns), before its start",
    ),
    "labels that overlap": (
        lambda c: (
            c
            | {"gesture": ["a", "b"]}
            | {"start": c["stamp"][[3, 5]], "end": c["stamp"][[7, 9]]}
        ),
        "overlap",
    ),
    "readings out of order": (
        lambda c: change(c, "stamp", 8, c["stamp"][6]),
        "reading 8 is of 1700000000120000000 ns, the one before it of 17000000001400",
    ),
    "milliseconds": (
        lambda c: c | {"stamp": 20 * np.arange(COUNT)},
        "readings are 2e-08 s apart; allowed are 0.0001 to 1 s",
    ),
    "no time": (lambda c: leave_out(c, "stamp"), "add a column stamp, or give --rate"),
    "time is NaN": (
        lambda c: c | {"stamp": np.where(np.arange(COUNT) == 4, np.nan, 1.0)},
        "'stamp' 4 is nan",
    ),
    "fractions of counts": (
        lambda c: leave_out(c, "pressure") | {"counts": c["pressure"]},
        "allowed are whole numbers from 0 to 4095",
    ),
    "texts": (
        lambda c: c | {"pressure": c["pressure"].astype(str)},
        "'pressure' is of type <U32; allowed are numbers",
    ),
    "columns in turn": (
        lambda c: c | {"pressure": np.asfortranarray(c["pressure"])},
        "save np.ascontiguousarray of it",
    ),
    "no readings": (
        lambda c: {name: values[:0] for name, values in c.items() if values.ndim},
        "0 readings; allowed are 1 to 10,000,000",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_archive_that_cannot_be_used_is_refused_and_nothing_is_written(
    kind, toy, tmp_path, capsys
):
    mounted, options = toy
    (tmp_path / "in").mkdir()
    content = make_content(mounted)
    np.savez(tmp_path / "in" / "a.npz", **content)
    spoil, part = BAD[kind]
    np.savez(tmp_path / "in" / "b.npz", **spoil(content))
    words = ("convert", "table", tmp_path / "in", tmp_path / "out", *options)
    assert_refused(capsys, *words, part=part)
    assert not (tmp_path / "out").exists()


def test_damaged_archives_and_wrong_options_are_refused(toy, tmp_path, capsys):
    mounted, options = toy
    np.savez(tmp_path / "a.npz", **make_content(mounted))
    data = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(data[:-100])
    (tmp_path / "cut.parquet").write_bytes(data)
    (tmp_path / "b.csv").write_text("gesture,a\npoke,1\n")
    out = tmp_path / "out"
    skin = options[:2]
    for file, given, part in (
        ("cut.npz", options, "not a whole file of readings"),
        ("cut.parquet", options, "not a whole file of readings"),
        ("b.csv", options, "ends with .npz, .parquet"),
        ("a.npz", skin, "give the robot that wears the skin"),
        ("a.npz", ("--skin", "ur5"), "allowed are 2,112"),
        (
            "a.npz",
            (),
            "or the readings of a whole skin, with poses or not, with --skin",
        ),
        ("a.npz", (*options, "--rows", 2), "--rows is given for table with --skin"),
        ("a.npz", (*options, "--rate", 50), "leave --rate out"),
        ("a.npz", (*options, "--label", "what"), "name it with --label"),
        ("a.npz", (*options, "--person", "who"), "name it with --person"),
        ("a.npz", options[2:], "--robot-urdf is given without --skin"),
    ):
        words = ("convert", "table", tmp_path / file, out, *given)
        assert_refused(capsys, *words, part=part)
        assert not out.exists()
    words = ("convert", "cost", tmp_path, out, "--skin", "ur5")
    assert_refused(capsys, *words, part="--skin is given for cost")


@pytest.mark.parametrize("source", ["in", "in/readings.parquet", "."])
def test_recordings_that_are_exported_as_parquet_come_back(source, tmp_path, capsys):
    generate(tmp_path / "set", GenerationSettings("paper", clips=2, subjects=1), 1)
    [path] = sorted((tmp_path / "set").rglob("*.mcap"))[:1]
    call_json(capsys, "export", path, "--parquet", tmp_path / "in")
    words = ("convert", "table", tmp_path / source, tmp_path / "out", "--skin", "ur5")
    call_json(capsys, *words)
    before = read_recording(path)
    after = read_recording(tmp_path / "out" / "readings.mcap")
    old = before.arrays()
    new = after.arrays()
    for name in ("stamps", "counts", "received", "q"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name))
    true = [label for label in before.labels if label.source == "true"]
    assert [each.gesture for each in after.labels] == [each.gesture for each in true]


def test_poses_and_pressures_of_the_paper_become_its_table_in_two_commands(
    tmp_path, capsys
):
    generate(tmp_path / "set", GenerationSettings("paper", clips=12, subjects=2), 1)
    (tmp_path / "in").mkdir()
    recordings = {}
    for path in sorted((tmp_path / "set").rglob("*.mcap")):
        recordings[path.name] = read_recording(path)
        write_archive(recordings[path.name], tmp_path / "in" / f"{path.stem}.npz")
    result, converted, _ = convert(capsys, tmp_path, ("--skin", "ur5"))
    assert result["poses"]["worst_mm"] < 0.1
    for after in converted:
        before = recordings[after.path.name]
        pressure = np.asarray(measure_pressures(before))
        counts = after.arrays().counts - after.calibration.rest
        np.testing.assert_allclose(
            after.calibration.gain * counts, pressure, atol=pressure.max() / 65_535
        )
        mounted = MountedSkin(before.skin, before.load_robot())
        places = [mounted.place_taxels(each.arrays().q)[0] for each in (before, after)]
        np.testing.assert_allclose(*places, atol=1e-4)
        true = [each for each in before.labels if each.source == "true"]
        assert list(after.labels) == true
    words = ["--recordings", tmp_path / "out", "--hold-out", "subject", "--json"]
    words += [
        "--methods",
        "svm-max",
        "knn-max",
        "--results",
        tmp_path / "results.jsonl",
    ]
    words += ["--pack", tmp_path / "pack"]
    assert run_program(run_compare, list(map(str, words))) == 0
    table = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [row["name"] for row in table["rows"]] == ["svm-max", "knn-max"]
