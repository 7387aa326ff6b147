"""Tests of `eskin train`: models and their cards, interrupted training, refusals."""

import errno
import os
import re
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
import torch

from eskin.learn import training
from eskin.learn.checkpoint import Checkpoint, save_checkpoint
from eskin.learn.plan import hash_recordings
from eskin.learn.recording_transforms import AgingConfig
from eskin.learn.training import Trainer
from eskin.live import Model, load_model
from helpers.cli import assert_refused, call, call_json, fail_to_write
from helpers.learning import FLAGS, label, record, record_people

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_windows")]


@pytest.fixture(autouse=True)
def no_progress(monkeypatch):
    """Print no line of progress, which a busy computer would get."""
    monkeypatch.setattr("eskin.progress.PERIOD", 3600.0)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Return a folder with recordings of four people in `train`, of one in `test`."""
    folder = tmp_path_factory.mktemp("data")
    record_people(folder / "train", ("ann", "bob", "cleo", "dan"))
    record_people(folder / "test", ("eve",))
    return folder


@pytest.fixture(scope="module")
def ann(data):
    return data / "train" / "ann.mcap"


@pytest.fixture(scope="module")
def eve(data):
    return data / "test" / "eve.mcap"


@pytest.fixture
def train(data, capsys):
    """Return a function that trains a tiny network; return its result and output.

    Recordings are kept prepared.
    """

    def run(*words, pack=data / "pack"):
        packed = ("--pack", pack) if pack else ()
        return call_json(capsys, "train", *FLAGS, *words, *packed)

    return run


@pytest.fixture
def refuse(capsys):
    """Return a function that checks that training is refused."""
    # The tiny settings come first, so that those of the test override them.
    return partial(assert_refused, capsys, "train", *FLAGS)


@pytest.fixture
def no_training(monkeypatch):
    """Fail if training starts."""
    monkeypatch.setattr(Trainer, "run", pytest.fail)


def test_model_is_trained_evaluated_and_replayed(data, eve, tmp_path, train, capsys):
    model = tmp_path / "models" / "m.safetensors"
    options = ("--seed", "7", "--train.rate", "0.002")
    trained, out = train(data / "train", "--out", model, "--test", eve, *options)
    assert list(trained) == ["val_accuracy", "test_accuracy", "epochs", "seconds"]
    assert trained["epochs"] == 1
    assert "1 of 4 recordings held out for validation\n" in out
    assert 0 <= trained["val_accuracy"] <= 1 and 0 <= trained["test_accuracy"] <= 1
    assert list(model.parent.iterdir()) == [model]
    card = load_model(model).card
    assert card.vocabulary == ("none", "hold", "tap")
    assert (card.kind, card.network.width) == ("pressure", 4)
    settings = {"seed": "7", "rate": "0.002", "network.channels": "8", "skins": "0"}
    assert settings.items() <= card.training.items()
    assert card.data_digest == hash_recordings(sorted((data / "train").iterdir()))
    assert set(card.metrics) == {"val_accuracy"}
    assert card.temperature > 0
    scored, _ = call_json(capsys, "evaluate", model, eve)
    assert scored["accuracy"] == trained["test_accuracy"]
    replayed, _ = call_json(capsys, "replay", eve, "--model", model)
    assert {row["gesture"] for row in replayed["detections"]} <= set(card.vocabulary)


def test_all_recordings_are_trained_on_if_others_are_given_to_validate_on(
    ann, eve, tmp_path, train
):
    result, out = train(eve, "--val", ann, "--out", tmp_path / "given")
    assert "held out" not in out
    assert 0 <= result["val_accuracy"] <= 1
    result, _ = train(eve, "--train.validation", "0", "--out", tmp_path / "without")
    assert (result["val_accuracy"], result["test_accuracy"]) == (None, None)
    given, without = (load_model(tmp_path / name) for name in ("given", "without"))
    assert given.card.data_digest == hash_recordings([eve])
    assert without.card.temperature == 1.0
    for name, weight in without.weights.items():
        assert np.array_equal(given.weights[name], weight)


def test_prepared_recordings_are_kept_and_make_the_same_model(
    ann, eve, tmp_path, train
):
    pack = tmp_path / "pack"
    words = (eve, "--val", ann, "--out")
    train(*words, tmp_path / "plain", pack=None)
    for name in ("first", "again"):
        train(*words, tmp_path / name, pack=pack)
        assert len(list(pack.iterdir())) == 2
        assert (tmp_path / name).read_bytes() == (tmp_path / "plain").read_bytes()


def test_interrupted_training_continues_with_the_same_command_only(
    eve, tmp_path, train, refuse, monkeypatch, capsys
):
    step = Trainer.step
    left = iter(range(1))

    def step_once(*args) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        step(*args)

    train(eve, "--out", tmp_path / "whole")
    with monkeypatch.context() as patch:
        patch.setattr(training, "SAVE_PERIOD", -1.0)
        patch.setattr(Trainer, "step", step_once)
        assert call(capsys, "train", *FLAGS, eve, "--out", tmp_path / "cut")[0] == 130
    kept = tmp_path / "cut.training"
    assert kept.is_file() and not (tmp_path / "cut").exists()
    begun = kept.read_bytes()
    for other in (("--seed", "5"), ("--classes", "tap"), ("--train.rate", "0.001")):
        part = "cut.training is of a training with other data or settings"
        refuse(eve, "--out", tmp_path / "cut", *other, part=part)
        assert kept.read_bytes() == begun
    train(eve, "--out", tmp_path / "cut")
    assert not kept.exists()
    assert (tmp_path / "cut").read_bytes() == (tmp_path / "whole").read_bytes()


def test_state_of_another_training_is_refused_before_anything_is_prepared(
    eve, tmp_path, refuse, monkeypatch
):
    kept = tmp_path / "m.training"
    save_checkpoint(kept, Checkpoint("another training", 1, {}, {}))
    monkeypatch.setattr("eskin.learn.training_data.prepare", pytest.fail)
    refuse(eve, "--out", tmp_path / "m", part=f"{kept} is of a training with other")
    assert kept.is_file()


def test_stages_after_the_last_step_show_how_far_they_are(
    data, tmp_path, monkeypatch, capsys
):
    stages = []
    totals = {}

    @contextmanager
    def note(what, total, *_):
        stages.append(what)
        totals[what] = total
        yield lambda number: None

    monkeypatch.setattr("eskin.progress.show_progress", note)
    words = (*FLAGS, "--train.ridge", "0.1", data / "train", "--out", tmp_path / "m")
    assert call(capsys, "train", *words)[0] == 0
    after = stages[stages.index("Reading") + 1 :]
    assert after[0] == "fitting the last layer, part"
    assert totals[after[0]] == 1, "no more windows than training drew"
    # Those that are held out are embedded again to count whole gestures.
    assert after.count("batches of readings embedded") == 3


def test_stopped_training_keeps_the_best_weights_and_can_be_continued(
    eve, tmp_path, monkeypatch, capsys
):
    step = Trainer.step
    left = iter(range(3))

    def step_thrice(*args) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        step(*args)

    monkeypatch.setattr(training, "SAVE_PERIOD", -1.0)
    monkeypatch.setattr(Trainer, "step", step_thrice)
    words = ("train", *FLAGS, "--train.epochs", 3, eve, "--out", tmp_path / "m")
    code, out, _ = call(capsys, *words)
    assert code == 130 and "stopped after 1 epoch" in out
    assert load_model(tmp_path / "m").weights and (tmp_path / "m.training").is_file()


def test_one_recording_holds_out_some_of_its_takes(tmp_path, train):
    path = record(tmp_path / "takes.mcap", ("hold", "tap") * 4)
    result, out = train(path, "--out", tmp_path / "m")
    assert result["val_accuracy"] is not None
    assert "2 takes held out for validation" in out
    # Each gesture that is held out is counted once, under its name.
    found = re.search(r"validation: hold (\d) of 1, tap (\d) of 1 recognised; ", out)
    assert found and set(found.groups()) <= {"0", "1"}
    assert re.search(f"then: eskin run .* --model {tmp_path / 'm'}\n", out)


def test_training_starts_from_the_weights_of_a_model(eve, tmp_path, train):
    words = ("--out", tmp_path / "m", "--train.validation", "0", "--start", "ur5")
    # The sizes of `FLAGS` are those of no model, so the default ones take their place.
    words += ("--train.network.width", 8, "--train.network.layers", 2)
    words += ("--train.network.channels", 32, "--train.rate", "1e-9")
    train(eve, *words)
    trained = load_model(tmp_path / "m")
    start = load_model("ur5")
    assert trained.card.training["start"] == "ur5"
    assert trained.card.network.width == start.card.network.width
    name = "encoder.embed.weight"
    np.testing.assert_allclose(trained.weights[name], start.weights[name], atol=1e-6)


def test_model_is_kept_elsewhere_and_readable_if_its_disk_is_full(
    eve, tmp_path, train, monkeypatch
):
    written = []

    save_whole = Model.save

    def save(model, path):
        written.append(path)
        if len(written) == 1:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        save_whole(model, path)

    monkeypatch.setattr(Model, "save", save)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    _, out = train(eve, "--out", tmp_path / "full" / "m", "--train.validation", "0")
    text = " ".join(out.split())
    for part in (
        f"{tmp_path / 'full' / 'm'} cannot be written",
        "No space",
        "model is",
    ):
        assert part in text
    assert f"the model is {written[1]}" in text and load_model(written[1])
    mask = os.umask(0)
    os.umask(mask)
    assert written[1].stat().st_mode & 0o777 == 0o666 & ~mask
    assert "None" not in text and "give --val or --test" in text


def test_options_change_the_model_and_are_in_its_card(
    data, eve, tmp_path, train, capsys
):
    cards = {}
    weights = {}
    for name, options in {
        "plain": (),
        "seed": ("--seed", "2"),
        "skins": ("--skins", "1"),
        "classes": ("--classes", "tap"),
        "blind": ("--train.graph.no-posed", "--test", eve),
    }.items():
        result, _ = train(eve, "--out", tmp_path / name, *options)
        model = load_model(tmp_path / name)
        cards[name] = model.card
        weights[name] = model.weights
    plain = weights["plain"]
    for name in ("seed", "skins"):
        assert any((weights[name][key] != plain[key]).any() for key in plain)
    assert "wear.unfelt" not in cards["plain"].training
    assert cards["skins"].training["skins"] == "1"
    assert cards["skins"].training["wear.unfelt"] == str(AgingConfig().unfelt)
    assert cards["classes"].vocabulary == ("none", "tap")
    assert (cards["plain"].graph.posed, cards["blind"].graph.posed) == (True, False)
    scored, _ = call_json(capsys, "evaluate", tmp_path / "blind", eve)
    assert scored["accuracy"] == result["test_accuracy"]


def test_shear_is_used_if_all_skins_have_it_unless_it_is_turned_off(tmp_path, train):
    sheared = record(tmp_path / "a.mcap", kind="shear")
    flat = record(tmp_path / "flat.mcap")
    cards = []
    for words in ((sheared,), (sheared, "--train.no-shear"), (sheared, flat)):
        train(*words, "--out", tmp_path / "m")
        cards.append(load_model(tmp_path / "m").card)
    assert [card.kind for card in cards] == ["shear", "pressure", "pressure"]
    assert [np.isinf(card.graph.shear_on) for card in cards] == [False, True, True]


def test_truncated_recording_is_used_up_to_the_cut_and_named(ann, tmp_path, train):
    half = tmp_path / "half.mcap"
    data = ann.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    _, out = train(half, "--out", tmp_path / "m")
    assert "half.mcap is cut or damaged" in " ".join(out.split())
    assert (tmp_path / "m").is_file()


@pytest.mark.usefixtures("no_training")
def test_invalid_input_is_refused_and_nothing_is_written(ann, tmp_path, refuse):
    start = tmp_path / "start.mcap"
    start.write_bytes(ann.read_bytes()[:200])
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    gone = tmp_path / "gone"
    empty = tmp_path / "empty"
    empty.mkdir()
    soft = [label(0.5, 1.5, "soft")]
    quiet = record(tmp_path / "quiet.mcap", (), labels=soft, calibrated=True)
    one = record(tmp_path / "one.mcap", ["hold"], calibrated=True)
    wave = record(tmp_path / "wave.mcap", labels=[label(2.4, 3.6, "wave")])
    silent = record(tmp_path / "silent.mcap", labels=[])
    named = record(tmp_path / "named.mcap", labels=[label(2.4, 3.6, "tap ")])
    out = ("--out", tmp_path / "m.safetensors")
    files = set(tmp_path.rglob("*"))
    for words, part in (
        ((gone, *out), "no recording at"),
        ((empty, *out), "no .mcap file below"),
        ((start, *out), "is cut before its"),
        ((text, *out), "text.mcap"),
        ((ann,), "--out"),
        (out, "no recording given"),
        ((ann, "--out", tmp_path), "is a folder"),
        ((ann, "--out", start / "m"), "no folder"),
        ((quiet, *out), "no touch in 1 recording;"),
        ((one, *out), "hold only hold"),
        ((silent, *out), "silent.mcap has no labels"),
        ((named, *out), "named.mcap, label at 2.40 s: gesture 'tap ' begins or ends"),
        ((ann, *out, "--classes", "grab"), "no recording is labelled grab"),
        ((ann, *out, "--test", gone), "no recording at"),
        ((ann, *out, "--val", gone), "no recording at"),
        ((ann, *out, "--test", wave), "hold wave"),
        ((ann, *out, "--test", silent), "no labels"),
        ((ann, *out, "--start", gone), f"{gone}: no such model"),
        ((ann, *out, "--start", "ur5"), "leave out --train.network.width"),
        ((ann, *out, "--train.workers", "0"), "workers is 0"),
        ((ann, *out, "--train.rate", "fast"), "--train.rate"),
        ((ann, *out, "--train.validation", "1.5"), "validation is 1.5"),
        ((ann, *out, "--train.batch", "0"), "batch is 0"),
        ((ann, *out, "--seed", "x"), "--seed"),
        ((ann, *out, "--epochs", "3"), "--epochs"),
    ):
        refuse(*words, part=part)
        assert set(tmp_path.rglob("*")) == files


def test_training_that_diverges_writes_nothing(eve, tmp_path, refuse, monkeypatch):
    def diverge(trainer, **kwargs):
        with torch.no_grad():
            trainer.network.graph_head.long.bias[0] = float("nan")
        return trainer.network

    monkeypatch.setattr(Trainer, "run", diverge)
    words = (eve, "--val", eve, "--test", eve, "--out", tmp_path / "m")
    refuse(*words, part="'graph_head.long.bias'")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_training")
def test_folder_that_cannot_be_written_to_is_refused(
    eve, tmp_path, refuse, monkeypatch
):
    monkeypatch.setattr("tempfile.TemporaryFile", fail_to_write)
    refuse(eve, "--out", tmp_path / "m", part=f"cannot write to {tmp_path}: ")
