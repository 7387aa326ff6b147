"""Labelled segments of recordings as examples: windows, touches, shear, names."""

import numpy as np
import pytest

from eskin.errors import RecordingError, SkinMismatchError
from eskin.live import GraphConfig
from eskin.recording import Metadata, RecordingWriter, read_recording, write_all
from eskin.touch import Scan
from helpers.baselines import UR5
from helpers.learning import LASTS, RATE, START, record, record_people
from helpers.live import calibration_of
from lab.baselines import READINGS
from lab.comparison.segments import find_segments, read_joint_positions

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    """Three people, two gestures each."""
    folder = tmp_path_factory.mktemp("people")
    record_people(folder)
    return folder


@pytest.fixture
def segments(people, tmp_path):
    return find_segments([people], tmp_path)


def test_every_label_is_an_example_of_its_person(segments):
    assert segments.labels == ("hold", "tap") * 3
    assert segments.groups == ("ann", "ann", "bob", "bob", "cleo", "cleo")
    assert segments.truth(("tap", "hold")).tolist() == [1, 0] * 3


def test_every_group_is_held_out_once_and_never_trained_on(people, tmp_path):
    for hold_out in ("subject", "session"):
        segments = find_segments([people], tmp_path, hold_out)
        folds = segments.split_folds()
        assert list(folds) == sorted(set(segments.groups))
        for held, (train, test) in folds.items():
            assert set(test.groups) == {held}
            assert set(train.groups) == set(segments.groups) - {held}
            assert set(train.paths) | set(test.paths) == set(segments.paths)


def test_windows_end_in_the_segment_and_are_zero_before_it(segments):
    windows = segments.windows
    assert windows.pressure.shape[1:] == (READINGS, segments.mounted.skin.count)
    dataset = segments.dataset(GraphConfig())
    for n, segment in enumerate(dataset.labelled):
        found = windows.pressure[segments.window_example == n]
        last = dataset.graphs.select(np.array([segment.end - 1]))
        image = np.zeros(windows.pressure.shape[2], np.float16)
        image[last.taxels] = last.pressure
        np.testing.assert_array_equal(found[-1, -1], image)
        lasts = round(LASTS * 50)
        assert not found[-1, : READINGS - lasts - 50 // RATE].any()
        assert found[-1].any()


def test_readings_between_two_are_interpolated(segments):
    dataset = segments.dataset(GraphConfig())
    segment = dataset.labelled[0]
    rows = np.array([segment.end - 2, segment.end - 1])
    pressure = np.zeros((2, segments.mounted.skin.count))
    for image, row in zip(pressure, rows, strict=True):
        graph = dataset.graphs.select(np.array([row]))
        image[graph.taxels] = graph.pressure
    window = segments.windows.pressure[segments.window_example == 0][-1]
    # Readings are 50 ms apart and those of windows 20 ms.
    expected = 0.4 * pressure[0] + 0.6 * pressure[1]
    np.testing.assert_allclose(window[-2], expected, atol=0.02)


def test_windows_hold_the_joint_positions_of_their_time(tmp_path):
    skin = UR5.skin
    path = tmp_path / "a.mcap"
    scans = [
        Scan(START + 50_000_000 * n, *idle(skin.count), np.arange(6) + 0.1 * n)
        for n in range(20)
    ]
    with RecordingWriter(path, "ur5", skin, calibration_of(skin), Metadata()) as writer:
        write_all(writer, scans, [])
    stamps = START + np.array([[-100, 0, 25, 60]]) * 1_000_000
    found = read_joint_positions(read_recording(path), stamps)
    wanted = np.arange(6) + np.array([0.0, 0.0, 0.05, 0.12])[:, None]
    np.testing.assert_allclose(found[0], wanted, atol=1e-6)


def idle(taxels):
    """Return counts without a touch, all received."""
    return np.full(taxels, 20, np.int32), np.ones(taxels, bool)


@pytest.mark.parametrize("form", ["features", "series"])
def test_shear_is_described_only_where_it_is_measured_and_wanted(form, tmp_path):
    sizes = {}
    for kind in ("pressure", "shear"):
        folder = tmp_path / kind
        record_people(folder, ("ann", "bob"), kind=kind)
        for shear in (False, True):
            segments = find_segments([folder], tmp_path / "pack", shear=shear)
            sizes[kind, shear] = segments.touch_rows(form).rows.shape[1]
    assert sizes["pressure", True] == sizes["pressure", False] == sizes["shear", False]
    assert sizes["shear", True] > sizes["shear", False]


def test_renamed_gestures_are_classes(people, tmp_path, segments):
    record_people(tmp_path / "more", gestures=("hold", "tap", "pat"))
    names = {"tap": "short", "pat": "short"}
    renamed = find_segments([tmp_path / "more"], tmp_path / "pack", names=names)
    assert renamed.labels == ("hold", "short", "short") * 3
    dataset = renamed.dataset(GraphConfig())
    assert [each.gesture for each in dataset.labelled] == list(renamed.labels)
    assert set(dataset.gestures) == {"none", "hold", "short"}


def test_other_shear_or_names_or_groups_change_the_digest_and_the_place(tmp_path):
    record_people(tmp_path / "a", kind="shear")
    options = ({}, {"shear": False}, {"names": {"tap": "pat"}}, {"hold_out": "session"})
    found = [find_segments([tmp_path / "a"], tmp_path, **each) for each in options]
    assert len({each.digest for each in found}) == len(options)
    assert len({each.place for each in found}) == len(options)


def test_recordings_that_cannot_be_compared_are_refused(people, tmp_path):
    pack = tmp_path / "pack"
    with pytest.raises(RecordingError, match="all recordings have subject 'ann'; leav"):
        find_segments([people / "ann.mcap"], pack)
    with pytest.raises(
        RecordingError, match="no gesture kick to rename; allowed are h"
    ):
        find_segments([people], pack, names={"kick": "tap"})
    with pytest.raises(
        RecordingError, match="3 recordings with labels of gestures hol"
    ):
        find_segments([people], pack, names={"tap": "hold"})
    record(tmp_path / "b.mcap", subject="dan", size=(4, 4))
    with pytest.raises(
        SkinMismatchError, match="b.mcap is of skin .* allowed is one s"
    ):
        find_segments([people, tmp_path / "b.mcap"], pack)
    record_people(tmp_path / "u", labels=[])
    with pytest.raises(RecordingError, match="3 recordings with labels of gestures no"):
        find_segments([tmp_path / "u"], pack)
