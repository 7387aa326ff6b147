"""Tests of LeRobot data sets: what the format asks for, and what frames hold."""

import importlib.util
import json

import numpy as np
import pyarrow.parquet as parquet
import pytest

from eskin.recording import Label, read_recording
from helpers.cli import assert_refused, call_json
from helpers.live import SECOND, START, Press, mounted, record, scans

DEFAULTS = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
"""Features of every data set."""
DROPPED = range(60, 75)
"""Scans that are missing in the second recording."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two recordings of one skin, the first with a label, the second with a gap."""
    folder = tmp_path_factory.mktemp("lerobot")
    on = mounted()
    label = Label(START + 2 * SECOND, START + 3 * SECOND, "poke")
    press = [Press(2.3, 2.7, 65, 65)]
    record(folder / "a.mcap", on, scans(on, press, 50, 3.5), [label])
    record(folder / "b.mcap", on, scans(on, press, 50, 3.0, dropped=DROPPED), [])
    return [folder / "a.mcap", folder / "b.mcap"]


@pytest.fixture(scope="module")
def written(recordings, tmp_path_factory):
    from eskin.exports.lerobot import write_lerobot

    folder = tmp_path_factory.mktemp("out") / "set"
    counts = write_lerobot([read_recording(path) for path in recordings], folder)
    return folder, counts


def read_json(folder, name):
    return json.loads((folder / "meta" / name).read_text())


def read_frames(folder, episode):
    info = read_json(folder, "info.json")
    path = info["data_path"].format(chunk_index=0, file_index=episode)
    return parquet.read_table(folder / path)


def read_array(table, name):
    return np.array(table[name].to_pylist())


def test_info_describes_every_column_as_it_is(written):
    folder, counts = written
    info = read_json(folder, "info.json")
    assert info["codebase_version"] == "v3.0" and info["fps"] == 50
    assert info["total_episodes"] == counts["episodes"] == 2
    assert info["total_frames"] == counts["frames"]
    assert set(info["features"]) >= DEFAULTS
    table = read_frames(folder, 0)
    assert table.column_names == list(info["features"])
    for name, each in info["features"].items():
        [size] = each["shape"]
        kind = table.schema.field(name).type
        if size > 1:
            assert kind.list_size == size
            kind = kind.value_type
        assert {"float": "float32"}.get(str(kind), str(kind)) == each["dtype"]
        assert each["names"] is None or len(each["names"]) == size


def test_frames_count_on_over_episodes_at_the_rate_of_the_skin(written):
    folder, counts = written
    episodes = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet")
    begin = 0
    for number, row in enumerate(episodes.to_pylist()):
        table = read_frames(folder, number)
        times = read_array(table, "timestamp")
        np.testing.assert_allclose(times, np.arange(len(times)) / 50, atol=1e-5)
        assert read_array(table, "index").tolist() == list(
            range(row["dataset_from_index"], row["dataset_to_index"])
        )
        assert row["dataset_from_index"] == begin and row["length"] == len(times)
        begin = row["dataset_to_index"]
    assert begin == counts["frames"]


def test_gestures_are_numbers_that_the_skin_file_names(written):
    folder, _ = written
    skin = read_json(folder, "eskin.json")
    table = read_frames(folder, 0)
    times = read_array(table, "timestamp")
    numbers = table["annotation.gesture"]
    named = [skin["gestures"][n] for n in numbers.to_pylist()]
    assert set(named) == {"none", "poke"}
    poked = times[np.array(named) == "poke"]
    assert poked[0] == pytest.approx(2.0, abs=0.02)
    assert poked[-1] == pytest.approx(3.0, abs=0.04)
    assert len(skin["taxels"]["position_link"]) == mounted().skin.count
    tasks = parquet.read_table(folder / "meta" / "tasks.parquet").to_pylist()
    assert [row["task"] for row in tasks] == ["touch the skin: poke", "touch the skin"]


def test_no_reading_is_repeated_as_valid_over_a_gap(written):
    folder, _ = written
    table = read_frames(folder, 1)
    valid = read_array(table, "observation.tactile.valid").any(axis=1)
    times = read_array(table, "timestamp")
    in_gap = (times > DROPPED[0] / 50 + 0.05) & (times < DROPPED[-1] / 50)
    assert in_gap.any() and not valid[in_gap].any()
    assert valid[~in_gap].mean() > 0.9
    pressure = read_array(table, "observation.tactile.pressure")
    pressed = (times > 2.4) & (times < 2.65)
    assert pressure[pressed].max() > 10 and pressure[times < 1.0].max() < 2


def test_statistics_are_those_of_the_frames(written):
    folder, _ = written
    stats = read_json(folder, "stats.json")
    names = ("observation.tactile.pressure", "timestamp", "annotation.gesture")
    for name in names:
        both = [read_array(read_frames(folder, n), name) for n in (0, 1)]
        values = np.concatenate(both).reshape(sum(map(len, both)), -1)
        assert stats[name]["count"] == [len(values)]
        for key, expected in (
            ("min", values.min(0)),
            ("max", values.max(0)),
            ("mean", values.mean(0)),
            ("std", values.std(0)),
        ):
            np.testing.assert_allclose(stats[name][key], expected, atol=1e-4)


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is None, reason="no lerobot")
def test_lerobot_opens_the_data_set(written):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    folder, counts = written
    dataset = LeRobotDataset("eskin/test", root=folder)
    assert len(dataset) == counts["frames"] and dataset.num_episodes == 2
    item = dataset[counts["frames"] - 1]
    assert item["observation.tactile.pressure"].shape == (mounted().skin.count,)
    assert item["task"] == "touch the skin"


def test_command_writes_it_and_refuses_other_skins_whole(recordings, tmp_path, capsys):
    out = tmp_path / "set"
    result, _ = call_json(capsys, "export", *recordings, "--lerobot", out)
    assert result["recordings"] == result["episodes"] == 2
    other = tmp_path / "c.mcap"
    ur5 = mounted("ur5")
    record(other, ur5, scans(ur5, [], 50, 0.2))
    words = ("export", recordings[0], other, "--lerobot", tmp_path / "two")
    assert_refused(capsys, *words, part="allowed is one skin")
    assert not (tmp_path / "two").exists()
