"""Tests of drivers, arms and exporters of other packages, and of the drivers' kit."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eskin.app import SourceConfig, find_driver, open_arm, open_source
from eskin.cli import doctor
from eskin.cli.run import RunCommand, check_options
from eskin.drivers import ManualClock, Source, SourceInfo, check_source
from eskin.errors import ArmError, DeviceError, EskinError, ModelError
from eskin.live import Model, Recognizer, load_model
from eskin.live.classifier import GraphClassifier
from eskin.registry import (
    ARMS,
    DRIVERS,
    EXPORTERS,
    RECOGNISERS,
    advise_install,
    find_plugins,
)
from eskin.touch import Scan
from helpers.cli import assert_refused, call_json
from helpers.devices import PERIOD, calibration_of, mounted_small, small_skin
from helpers.live import (
    label,
    model_of,
    mounted,
    network,
    record,
    scans,
    two_hands,
)

TEMPLATE = Path(__file__).parents[1] / "plugins" / "template"
CONFIG = SourceConfig(small_skin(), "table", rate=50.0)


def install(folder, monkeypatch, name, entries, code=""):
    """Install a package of one module with entry points, as pip would."""
    (folder / f"{name}-1.0.dist-info").mkdir(parents=True)
    (folder / f"{name}.py").write_text(code)
    info = folder / f"{name}-1.0.dist-info"
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0")
    (info / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(folder)


@pytest.fixture
def glove(tmp_path, monkeypatch):
    """The template, installed."""
    code = (TEMPLATE / "eskin_glove.py").read_text()
    entries = f"[{DRIVERS}]\nglove = eskin_glove:GLOVE\n"
    install(tmp_path / "glove", monkeypatch, "eskin_glove", entries, code)


def test_every_shipped_name_is_an_entry_point_that_loads():
    groups = DRIVERS, ARMS, EXPORTERS, RECOGNISERS
    found = {group: find_plugins(group) for group in groups}
    assert {"serial", "udp", "csv", "xela", "replay", "sim"} <= set(found[DRIVERS])
    assert {"sim", "ur"} <= set(found[ARMS])
    assert {"onnx", "rosbag", "parquet"} <= set(found[EXPORTERS])
    for group in found.values():
        for entry in group.values():
            assert entry.load() is not None
    assert found[RECOGNISERS]["eskin"].load() is GraphClassifier


def test_template_keeps_the_rules_of_sources(glove):
    assert check_source(lambda: open_source("glove:a", config=CONFIG), 0.5) == []


def test_doctor_lists_a_plugin_with_its_package(glove):
    check = doctor.check_plugins(DRIVERS)
    assert check.ok and "glove (eskin_glove 1.0)" in check.found
    assert "serial" in check.found


def test_unknown_source_names_those_of_plugins(glove):
    with pytest.raises(DeviceError, match="glove:NAME"):
        open_source("nose:a", config=CONFIG)


def test_driver_whose_form_has_no_address_needs_none(glove, monkeypatch):
    with pytest.raises(DeviceError, match="source is 'glove:'"):
        find_driver(["glove:"])
    driver = replace(find_driver(["glove:a"]), form="glove:")
    monkeypatch.setattr("eskin.app.load_plugin", lambda *_: driver)
    assert find_driver(["glove:"]) is driver


def test_plugin_that_cannot_be_imported_is_refused_in_one_line(tmp_path, monkeypatch):
    entries = f"[{DRIVERS}]\nbroken = broken:DRIVER\n"
    install(tmp_path, monkeypatch, "broken", entries, "raise RuntimeError('torn')\n")
    with pytest.raises(EskinError, match=r"broken 1\.0 \(RuntimeError: torn\)") as told:
        open_source("broken:a", config=CONFIG)
    assert "\n" not in str(told.value)
    assert not doctor.check_plugins(DRIVERS).ok
    with pytest.raises(DeviceError, match="broken:"):
        open_source("nose:a", config=CONFIG)


def test_name_of_two_packages_is_refused(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, "thief", f"[{DRIVERS}]\nserial = thief:DRIVER\n")
    with pytest.raises(EskinError, match=r"thief 1\.0.*uninstall"):
        open_source("serial:/dev/x", config=CONFIG)


def test_eskin_that_is_not_installed_says_so():
    with pytest.raises(EskinError, match="install it again"):
        find_plugins("eskin.nothing")


def test_arm_of_a_plugin_is_real_and_opened_by_its_kind(tmp_path, monkeypatch):
    code = (
        "from eskin.registry import ArmDriver\n"
        "from eskin.arms import SimulatedArm\n"
        "def open_arm(uri, clock, gripper_output):\n"
        "    arm = SimulatedArm(clock=clock)\n    arm.name = uri\n    return arm\n"
        "ARM = ArmDriver(open_arm, 'panda://HOST')\n"
    )
    entries = f"[{ARMS}]\npanda = own_arm:ARM\n"
    install(tmp_path, monkeypatch, "own_arm", entries, code)
    assert open_arm("panda://h").name == "panda://h"
    with pytest.raises(DeviceError, match="--allow-simulated-touch"):
        check_options(RunCommand(source=("sim:ur5",), robot="panda://h"))
    with pytest.raises(ArmError, match="panda://HOST, sim:ROBOT or ur://HOST"):
        open_arm("nose:a")


def test_touches_of_a_plugin_that_says_nothing_are_those_of_a_network(
    tmp_path, monkeypatch
):
    code = (
        "from eskin.registry import Driver\nDRIVER = Driver(lambda *_: None, 'pad:N')\n"
    )
    install(tmp_path, monkeypatch, "pad", f"[{DRIVERS}]\npad = pad:DRIVER\n", code)
    with pytest.raises(DeviceError, match="--allow-unauthenticated"):
        check_options(RunCommand(source=("pad:a",), skin="ur5", robot="ur://h"))


def test_exporter_of_a_plugin_writes_by_its_name(tmp_path, monkeypatch, capsys):
    code = (
        "from eskin.registry import Exporter\n"
        "def write(recordings, path):\n"
        "    path.write_text(str(len(recordings)))\n"
        "    return {'lines': 1}\n"
        "COUNT = Exporter(write)\n"
    )
    entries = f"[{EXPORTERS}]\ncount = counting:COUNT\n"
    install(tmp_path, monkeypatch, "counting", entries, code)
    path = record(tmp_path / "a.mcap", mounted(), scans(mounted(), [], 50, 0.1))
    result, _ = call_json(capsys, "export", path, "--to", "count", tmp_path / "n.txt")
    assert result == {"recordings": 1, "lines": 1}
    assert (tmp_path / "n.txt").read_text() == "1"
    assert_refused(capsys, "export", path, "--to", "nose", tmp_path / "x", part="count")


POKED = """
import numpy as np
from eskin.live import TouchClassifier


class Poked(TouchClassifier):
    def __init__(self, model, pipeline):
        super().__init__(model, pipeline)
        self.answer = 9.0 * (np.array(model.card.vocabulary) == "poke")

    def classify_touches(self, state, floor):
        keys = self.list_keys(state)
        self.logits = dict.fromkeys(keys, self.answer)
        self.probabilities = dict.fromkeys(keys, self.answer / 9.0)
"""


@pytest.fixture
def poked(tmp_path):
    """The path of a model of a recogniser that takes every touch for a poke."""
    path = tmp_path / "poked.safetensors"
    card = replace(model_of(network()).card, recogniser="poked")
    Model({"weight": np.zeros(1, np.float32)}, card).save(path)
    return path


def test_model_of_a_plugin_is_used_and_scored_like_any_other(
    poked, tmp_path, monkeypatch, capsys
):
    entries = f"[{RECOGNISERS}]\npoked = poked:Poked\n"
    install(tmp_path, monkeypatch, "poked", entries, POKED)
    on = mounted()
    labels = [label(2.3, 3.2, "stroke"), label(4.2, 4.5, "poke")]
    stream = scans(on, two_hands(on), 50, 6.0)
    path = record(tmp_path / "a.mcap", on, stream, labels)
    found, _ = call_json(capsys, "replay", path, "--model", poked)
    gestures = [each["gesture"] for each in found["detections"]]
    assert len(gestures) >= 3 and set(gestures) == {"poke"}
    scored, _ = call_json(capsys, "evaluate", poked, path, "--workers", "1")
    assert scored["per_class"]["poke"]["recall"] == 1.0
    assert scored["per_class"]["stroke"]["recall"] == 0.0
    assert scored["events"]["per_gesture"]["poke"]["recall"] == 1.0
    words = "export", poked, "--onnx", tmp_path / "a.onnx"
    assert_refused(capsys, *words, part="models of eskin's own")


def test_model_of_a_package_that_is_not_installed_names_it(poked, tmp_path, capsys):
    remedy = "'poked', which is not installed; allowed are eskin"
    with pytest.raises(ModelError, match=remedy):
        load_model(poked)
    model = Model({}, replace(model_of(network()).card, recogniser="poked"))
    with pytest.raises(ModelError, match=remedy):
        Recognizer(model, mounted(), None)
    path = record(tmp_path / "a.mcap", mounted(), scans(mounted(), [], 50, 0.1))
    assert_refused(capsys, "replay", path, "--model", poked, part=remedy)
    assert_refused(capsys, "evaluate", poked, path, part=remedy)


class Played(Source):
    """A source of still scans, which one change makes break a rule."""

    def __init__(self, change=None):
        self.clock = ManualClock(1_000_000_000)
        self.change = change
        self.number = 0
        self.closed = False
        mounted = mounted_small()
        calibration = calibration_of(mounted.skin)
        self.info = SourceInfo("played:", mounted, calibration, 50.0)
        self.counts = np.full(mounted.skin.count, 7, np.int32)

    def read(self, timeout=None):
        if self.closed:
            return None
        self.clock.sleep(PERIOD / 1e9)
        self.number += 1
        received = np.ones(len(self.counts), bool)
        scan = Scan(self.clock.now(), self.counts.copy(), received, np.zeros(0))
        return scan if self.change is None else self.change(self, scan)

    @property
    def ended(self):
        return self.closed

    def take_events(self):
        return []

    def counters(self):
        return {"readings": self.number}

    def close(self):
        self.closed = True


def reuse(source, scan):
    """Return the one array of counts that every scan overwrites."""
    source.counts += 1
    return replace(scan, counts=source.counts)


def shorten(scan):
    return replace(scan, counts=scan.counts[1:], received=scan.received[1:])


def lose(source, scan):
    source.number += 1
    return scan


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda _, scan: replace(scan, stamp=5), "stamps"),
        (lambda _, scan: replace(scan, stamp=scan.stamp + 10**9), "future"),
        (lambda _, scan: shorten(scan), "one a taxel"),
        (lambda _, scan: replace(scan, counts=scan.counts - 8), "65,535"),
        (lambda _, scan: replace(scan, received=scan.counts > 0), ""),
        (lambda _, scan: replace(scan, q=np.ones(1)), "joint"),
        (lambda _, scan: replace(scan, shear=np.zeros((34, 2), int)), "shear"),
        (reuse, "written again"),
        (lose, "counters"),
    ],
)
def test_kit_finds_the_rule_that_a_source_breaks(change, part):
    found = check_source(lambda: Played(change), 0.5)
    assert any(part in each for each in found) if part else found == []


def test_kit_accepts_a_source_that_keeps_all_rules():
    assert check_source(Played, 0.5) == []


@pytest.mark.parametrize(
    ("origin", "what"),
    [
        ({"url": "file:///a/clone", "dir_info": {}}, "."),
        ({"url": "file:///a/clone", "dir_info": {"editable": True}}, "."),
        ({"url": "file:///a/eskin-1.whl", "archive_info": {}}, "eskin"),
        (None, "eskin"),
    ],
)
def test_extra_is_advised_as_eskin_was_installed(origin, what, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, "eskin", "")
    if origin is not None:
        info = tmp_path / "eskin-1.0.dist-info" / "direct_url.json"
        info.write_text(json.dumps(origin))
    assert advise_install("train") == f"pip install '{what}[train]'"
    assert advise_install() == f"pip install {what}"
