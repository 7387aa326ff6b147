"""Tests of what a notebook calls: pressures, touches as rows, values on a skin.

Ten tasks of a notebook import nothing of eskin but what the reference documents.
"""

import ast
import inspect
import itertools
import math
import subprocess
import sys
import textwrap
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import eskin
from eskin import registry
from eskin.skin import (
    Patch,
    Plane,
    TaxelGrid,
    build_grid_skin,
    build_skin,
    load_skin,
)
from helpers.cli import call_json
from helpers.learning import FLAGS, TINY, record_people
from helpers.learning import record as record_scene
from helpers.live import Press, mounted, record, scans

pytestmark = pytest.mark.slow

API = Path(__file__).parents[1] / "docs" / "api"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("notebook") / "touched.mcap"
    presses = [Press(2.3, 2.7, 65, 65), Press(4.0, 4.6, 65, 65)]
    stream = scans(mounted(), presses, 50, 6.0)
    return eskin.read_recording(record(path, mounted(), stream))


def test_pressures_have_a_row_a_reading_and_a_column_a_taxel(recording):
    found = np.asarray(eskin.measure_pressures(recording))
    assert found.shape == (recording.count, recording.skin.count)
    assert found.max() > 1.0 and (found[:50] < 2.0).all()


def test_touches_have_gestures_and_embeddings_of_the_model(recording):
    rows = eskin.find_touches(recording, "ur5")
    assert len(rows) == 2
    sizes = {len(row["embedding"]) for row in rows}
    assert len(sizes) == 1 and sizes.pop() > 8
    for row in rows:
        assert sum(row["probabilities"].values()) == pytest.approx(1.0, abs=1e-4)
        assert np.ptp(row["embedding"]) > 0.0
        assert row["person"] == recording.metadata.subject


def test_values_are_drawn_one_a_taxel_only():
    skin = load_skin("bent")
    figure = eskin.plot_skin(np.arange(skin.count), skin)
    drawn = sum(len(one.get_paths()) for one in figure.axes[0].collections)
    assert drawn == skin.count
    with pytest.raises(ValueError, match="allowed is a value a taxel"):
        eskin.plot_skin(np.zeros(3), "bent")


@pytest.mark.parametrize("name", ["ur5", "bent", "sleeve", "small", "many", "tall"])
def test_picture_is_filled_and_no_captions_collide(name):
    built = {
        "small": lambda: build_grid_skin(2, 3),
        "many": lambda: build_pads(12, rows=3),
        "tall": lambda: build_grid_skin(40, 4),
    }
    skin = built[name]() if name in built else load_skin(name)
    figure = eskin.plot_skin(np.arange(skin.count), skin)
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    pairs = itertools.combinations(boxes, 2)
    assert not any(one.overlaps(other) for one, other in pairs)
    whole = figure.bbox
    for box in boxes:
        assert whole.x0 <= box.x0 and box.x1 <= whole.x1 and box.y1 <= whole.y1
    drawn = [each.get_tightbbox() for each in [*figure.axes]]
    assert max(box.x1 for box in drawn) > 0.9 * whole.x1
    assert max(box.y1 for box in drawn) > 0.9 * whole.y1
    panel = figure.axes[0].get_window_extent()
    assert panel.width * panel.height > 0.55 * whole.width * whole.height


def shift_along_x(distance):
    T = np.eye(4)
    T[0, 3] = distance
    return T


def build_pads(count, rows):
    """Build a skin of small pads whose names are wider than they are."""
    grid = TaxelGrid(rows=rows, columns=2, row_pitch=0.004, column_pitch=0.004)
    return build_skin(
        "pads",
        [
            (
                Patch(f"finger_{n}_distal", "table", n + 1, rows=rows, columns=2),
                grid,
                Plane(shift_along_x(0.05 * n)),
            )
            for n in range(count)
        ],
    )


def test_skin_is_shown_in_a_cell_without_a_server():
    count = load_skin("bent").count
    shown = eskin.show_skin(np.arange(count), "bent")._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    for values, q in ((np.zeros(3), None), (np.zeros(count), np.zeros(99))):
        with pytest.raises(ValueError, match="allowed are"):
            eskin.show_skin(values, "bent", q=q)


def test_skin_given_as_an_object_is_shown_on_the_robot_given(several):
    values = np.asarray(eskin.measure_pressures(several))[0]
    robot = several.load_robot()
    shown = eskin.show_skin(values, several.skin, robot)
    assert shown.height > 0
    with pytest.raises(eskin.EskinError, match="robot= in Python"):
        eskin.show_skin(values, several.skin)


def test_names_of_eskin_are_those_that_are_public():
    names = {*eskin.__all__, *eskin.LEARNING, "__version__"}
    assert set(dir(eskin)) == names
    assert all(getattr(eskin, name) is not None for name in dir(eskin))


def do_ten_tasks(folder):
    """Do what a notebook is used for, on a panel that is tapped six times."""
    from eskin.app import nominal_calibration
    from eskin.calibration import CalibrationGuide
    from eskin.exports.tables import write_tables
    from eskin.recording import Label, Metadata, write_calibration
    from eskin.skin import Patch, Plane, TaxelGrid, build_skin, check_skin, save_skin

    # 1. A skin of one's own, from a grid.
    grid = TaxelGrid(rows=12, columns=16, row_pitch=0.01, column_pitch=0.01)
    patch = Patch("top", link="table", address=1, rows=12, columns=16)
    skin = build_skin("panel", [(patch, grid, Plane(np.eye(4)))])
    table = eskin.load_robot("table")
    assert not check_skin(skin, table)
    save_skin(skin, folder / "panel")
    assert eskin.load_skin(folder / "panel").count == 192

    # 2. Where the taxels are at some positions of the joints.
    arm = eskin.MountedSkin(eskin.load_skin("ur5"), eskin.load_robot("ur5"))
    bent = arm.place_taxels(np.array([0.0, -1.2, 1.0, 0.0, 0.5, 0.0]))[0]
    assert np.ptp(bent - arm.place_taxels(np.zeros(6))[0]) > 0.1

    # 3. Touches of a simulated person.
    config = eskin.SourceConfig(robot="table", pace=math.inf)
    with eskin.open_source(f"sim:{folder / 'panel'}", config=config) as source:
        assert all(len(scan.counts) == 192 for scan in islice(source, 5))

    # 4. A recording of one's own touches.
    calibration = nominal_calibration(skin)
    rng = np.random.default_rng(0)
    away = np.linalg.norm(skin.positions - skin.positions[100], axis=1)
    taps = [(7.0 + 3 * n, 7.5 + 3 * n) for n in range(6)]
    path = folder / "taps.mcap"
    second = 10**9
    origin = Metadata("taps", "me", "today")
    with eskin.RecordingWriter(path, "table", skin, calibration, origin) as writer:
        for number in range(50 * 24):
            t = number / 50
            share = sum(math.sin(math.pi * (t - a) / 0.5) for a, b in taps if a < t < b)
            kpa = 80 * share * np.exp(-((away / 0.009) ** 2))
            counts = 200 + rng.normal(0, 1.5, 192) + calibration.compute_counts(kpa)
            stamp = round((t + 1) * second)
            writer.write(
                eskin.Scan(stamp, np.int32(counts), np.ones(192, bool), np.zeros(0))
            )
        for a, b in taps:
            label = Label(round((a + 1) * second), round((b + 1) * second), "poke")
            writer.write_label(label)

    # 5. What is recognised in it, and when.
    tapped = eskin.read_recording(path)
    model = eskin.load_model("ur5")
    on = {"skin": tapped.skin, "robot": table, "calibration": tapped.calibration}
    recognizer = eskin.Recognizer.load("ur5", **on)
    found = [one for scan in tapped.scans() for one in recognizer.push(scan)]
    times = [(one.onset - tapped.start) / second for one in found]
    assert np.allclose(times, [a for a, _ in taps], atol=0.1)

    # 6. Other thresholds.
    strict = eskin.DecisionConfig(threshold=1.0, least=1.0)
    recognizer = eskin.Recognizer.load("ur5", **on, decision=strict)
    shy = [one.gesture for scan in tapped.scans() for one in recognizer.push(scan)]
    assert shy == ["unknown"] * 6

    # 7. All touches of a set of recordings as a table, and how many are right.
    rows = eskin.find_touches(folder, model)
    right = [row["detected"] == row["gesture"] for row in rows]
    assert len(right) == 6 and np.mean(right) > 0.8

    # 8. A calibration from counts: rest, then presses.
    guide = CalibrationGuide(eskin.MountedSkin(skin, table), calibration)
    events = [guide.push(scan) for scan in tapped.scans()]
    assert [one.kind for one in events if one] == ["rested", *["pressed"] * 5]
    write_calibration(folder / "panel" / "calibration.json", guide.finish().calibration)

    # 9. A model as a file.
    model.save(folder / "mine.safetensors")
    assert eskin.load_model(folder / "mine.safetensors").digest == model.digest

    # 10. A recording for other programs.
    assert write_tables([tapped], folder / "tables")["touches"] == 6


def test_ten_tasks_are_done_with_documented_modules_alone(tmp_path):
    do_ten_tasks(tmp_path)
    source = ast.parse(textwrap.dedent(inspect.getsource(do_ten_tasks)))
    used = {n.module for n in ast.walk(source) if isinstance(n, ast.ImportFrom)}
    pages = "".join(page.read_text() for page in API.glob("*.md"))
    assert used <= {line.removeprefix("::: ") for line in pages.splitlines()}


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    """Return the folder of a recording of each of three people."""
    folder = tmp_path_factory.mktemp("people")
    record_people(folder, calibrated=True)
    return folder


def test_model_that_python_trains_is_that_of_the_command(
    people, tmp_path, capsys, monkeypatch
):
    """The command gives the same scores, too."""
    monkeypatch.setattr("eskin.progress.PERIOD", 3600.0)  # No line of progress.
    model = eskin.train(people, seed=3, config=TINY)
    model.save(tmp_path / "python.safetensors")
    path = tmp_path / "command.safetensors"
    options = ("--train.network.dropout", "0", "--seed", "3", "--out", path)
    call_json(capsys, "train", *FLAGS, *options, people)
    same = eskin.load_model(path)
    assert same.card == model.card and same.digest == model.digest
    assert eskin.load_model(tmp_path / "python.safetensors").card == model.card
    scores = eskin.evaluate(model, people / "ann.mcap")
    told, _ = call_json(capsys, "evaluate", path, people / "ann.mcap")
    assert round(scores.segments.accuracy, 4) == told["accuracy"]


def test_each_person_is_scored_by_a_model_of_all_others(people, capsys):
    found = eskin.cross_validate(people, config=TINY)
    told = capsys.readouterr().err
    for number, name in enumerate(("ann", "bob", "cleo"), 1):
        assert f"subject {number} of 3 is held out: {name}" in told
    low, high = found.interval
    assert low <= found.accuracy <= high and high - low > 0.2
    assert list(found.label_confusion()) == ["none", "hold", "tap"]
    assert sorted(found.evaluations) == ["ann", "bob", "cleo"]
    assert found.confusion.sum() == 6
    assert found.accuracy == pytest.approx(np.mean(list(found.per_subject.values())))
    others = eskin.train([people / "ann.mcap", people / "cleo.mcap"], config=TINY)
    alone = eskin.evaluate(others, eskin.read_recording(people / "bob.mcap"))
    assert alone.segments.accuracy == found.per_subject["bob"]
    with pytest.raises(eskin.EskinError, match="subject 'ann'; allowed are two"):
        eskin.cross_validate(people / "ann.mcap")


def test_one_person_is_validated_by_session(tmp_path):
    for day in ("one", "two"):
        record_scene(tmp_path / f"{day}.mcap", subject="ann", session=day)
    with pytest.raises(eskin.EskinError, match='by="session"'):
        eskin.cross_validate(tmp_path, config=TINY)
    found = eskin.cross_validate(tmp_path, by="session", config=TINY)
    assert sorted(found.per_subject) == ["one", "two"]


DOUBLE_PAT = Press(2.3, 2.6, 65, 65), Press(2.75, 3.05, 65, 65)
TWO_FINGERS = Press(4.5, 5.0, 65, 65), Press(4.6, 5.2, 69, 69, 60.0)


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """Return a recording of a double pat, then of two fingers of one hand."""
    path = tmp_path_factory.mktemp("several") / "several.mcap"
    stream = scans(mounted(), [*DOUBLE_PAT, *TWO_FINGERS], 50, 7.0)
    return eskin.read_recording(record(path, mounted(), stream))


def test_forces_of_a_touch_are_those_of_all_its_contacts_at_every_reading(several):
    """Their greatest is the peak force, and their integral the impulse."""
    pats, fingers = eskin.find_touches(several)
    period = several.period / 1e9
    for row in (pats, fingers):
        times = row["times"]
        forces = row["forces"]
        assert forces.shape == times.shape and (forces >= 0).all()
        assert np.diff(times) == pytest.approx(period)
        assert 0.0 <= times[0] <= period
        assert times[-1] == pytest.approx(row["duration"])
        assert forces.max() == pytest.approx(row["peak_force"])
        assert forces.sum() * period == pytest.approx(row["impulse"])
    assert pats["contacts"] == fingers["contacts"] == 2
    pause = (pats["times"] > 0.35) & (pats["times"] < 0.4)
    assert pause.any() and (pats["forces"][pause] == 0.0).all()
    assert (fingers["forces"] > 0.0).all()


def test_force_of_an_open_touch_is_that_of_its_contacts_now(several):
    recognizer = eskin.Recognizer.load("ur5", recording=several)
    most = 0
    for scan in several.scans():
        recognizer.push(scan)
        for touch in recognizer.state.touches:
            held = recognizer.state.contacts if touch.last == scan.stamp else ()
            assert touch.force == pytest.approx(sum(one.force for one in held))
            most = max(most, len(held))
    assert most == 2


def test_objects_are_described_in_a_line(several):
    model = eskin.load_model("ur5")
    described = (
        (several, (str(several.path), "350 readings", "0 labels", "'grid'")),
        (several.skin, ("'grid'", "240 taxels", "1 patch")),
        (several.calibration, ("240 taxels", "nominal", "4000")),
        (model, ("pressure", *model.card.vocabulary)),
    )
    for thing, parts in described:
        text = repr(thing)
        assert len(text.replace(str(several.path), "")) < 150 and "\n" not in text
        assert all(part in text for part in parts)


def test_picture_says_that_a_calibration_is_nominal():
    skin = load_skin("bent")
    values = Values(np.arange(skin.count))
    for source, told in (("nominal", True), ("presses", False)):
        values.attrs = {"units": "kPa", "calibration": source}
        label = eskin.plot_skin(values, skin).axes[1].get_ylabel()
        assert label.startswith("kPa") and ("nominal" in label) is told
    assert eskin.plot_skin(values, skin, "counts").axes[1].get_ylabel() == "counts"
    captions = [text.get_text() for text in eskin.plot_skin(values, skin).axes[0].texts]
    assert any("taxels" in caption for caption in captions)


class Values(np.ndarray):
    """An array with attributes, as xarray has them."""

    def __new__(cls, values):
        return np.asarray(values).view(cls)


WRONG_CALLS = {
    "eskin.train('recordings', config={'epochs': 2})": "config=eskin.TrainConfig(",
    "eskin.cross_validate('recordings', config={})": "config=eskin.TrainConfig(",
    "eskin.Recognizer(model, skin, None)": "eskin.MountedSkin(skin, robot)",
    "eskin.Recognizer.load(model)": "recording=RECORDING",
}


def test_objects_of_another_kind_are_refused_with_the_remedy():
    """The calls run where nothing checks types."""
    code = "import eskin; model = eskin.load_model('ur5')\n"
    code += "skin = eskin.load_skin('bent')\n"
    for call in WRONG_CALLS:
        code += f"try: {call}\nexcept ValueError as error: print(error)\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = done.stdout.splitlines()
    assert len(said) == len(WRONG_CALLS), done.stderr
    for line, remedy in zip(said, WRONG_CALLS.values(), strict=True):
        assert remedy in line and "allowed is" in line


def test_model_of_ones_own_recognises_a_recording_as_its_file_does(several, tmp_path):
    model = eskin.load_model("ur5")
    model.save(tmp_path / "mine.safetensors")
    path = str(tmp_path / "mine.safetensors")
    found = []
    for each in (model, path, "ur5"):
        recognizer = eskin.Recognizer.load(each, recording=several)
        assert recognizer.mounted.skin is several.skin
        detections = [d for scan in several.scans() for d in recognizer.push(scan)]
        found.append([(d.gesture, d.stamp, d.confidence) for d in detections])
    assert len(found[0]) == 2 and found[0] == found[1] == found[2]


def test_training_without_torch_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, registry.LEARNING, None)
    with pytest.raises(eskin.EskinError, match=r"eskin\.train needs torch.*\[train\]"):
        eskin.train("recordings")


def test_star_imports_what_needs_no_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, registry.LEARNING, None)
    found = {}
    exec("from eskin import *", found)
    assert {"Recognizer", "load_model"} <= set(found)
    assert not {"train", "evaluate", "cross_validate"} & set(found)


def test_importing_eskin_imports_nothing_of_training():
    code = "import eskin, sys; print({'torch', 'eskin.learn'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "set()"
