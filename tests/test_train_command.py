"""`eskin train`, then `evaluate` and `replay`, as they are called."""

import json
import re
from contextlib import suppress

import numpy as np
import pytest
import torch

from eskin.cli.main import run
from eskin.learn import training
from eskin.learn.dataset import hash_recordings
from eskin.learn.recording_transforms import AgingConfig
from eskin.learn.training import Trainer
from eskin.model import load_model
from helpers.learning import FLAGS, label, record, record_people

KEYS = ["val_accuracy", "test_accuracy", "epochs", "seconds"]


def call(capsys, *argv):
    code = run([str(word) for word in argv])
    out, err = capsys.readouterr()
    return code, out, err


def last_json(out):
    return json.loads(out.strip().splitlines()[-1])


def train(capsys, *argv):
    return call(capsys, "train", *argv, *FLAGS)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Four people for training; a fifth for testing, in `test`."""
    folder = tmp_path_factory.mktemp("data")
    record_people(folder / "train", ("ann", "bob", "cleo", "dan"))
    record_people(folder / "test", ("eve",))
    return folder


@pytest.fixture
def no_training(monkeypatch):
    """What is refused must be refused before the long work."""

    def never(*args, **kwargs) -> None:
        raise AssertionError("trained in vain")

    monkeypatch.setattr(Trainer, "run", never)


def test_train_evaluate_replay_are_one_way(data, tmp_path, capsys):
    model = tmp_path / "models" / "m.safetensors"
    code, out, err = train(
        capsys, data / "train", "--out", model, "--test", data / "test", "--json"
    )
    assert (code, err) == (0, "")
    trained = last_json(out)
    assert list(trained) == KEYS
    assert trained["epochs"] == 1
    assert "1 of 4 recordings held out for validation\n" in out
    assert 0 <= trained["val_accuracy"] <= 1 and 0 <= trained["test_accuracy"] <= 1
    assert list(model.parent.iterdir()) == [model]

    code, out, err = call(capsys, "evaluate", model, data / "test", "--json")
    assert (code, err) == (0, "")
    assert last_json(out)["accuracy"] == trained["test_accuracy"]

    [recording] = (data / "test").iterdir()
    code, out, err = call(capsys, "replay", recording, "--model", model, "--json")
    assert (code, err) == (0, "")
    for row in last_json(out)["detections"]:
        assert row["gesture"] in ("none", "hold", "tap")


def test_recordings_given_to_validate_on_leave_all_others_to_train_on(
    data, tmp_path, capsys
):
    flags = ("--val", data / "test", "--json")
    code, out, err = train(capsys, data / "train", "--out", tmp_path / "m", *flags)
    assert (code, err) == (0, "")
    assert "held out" not in out
    assert 0 <= last_json(out)["val_accuracy"] <= 1
    card = load_model(tmp_path / "m").card
    assert card.data_digest == hash_recordings(sorted((data / "train").iterdir()))
    all_of_them = ("--train.validation", "0")
    train(capsys, data / "train", "--out", tmp_path / "every", *all_of_them)
    one, other = (load_model(tmp_path / name).weights for name in ("m", "every"))
    assert all(np.array_equal(one[name], other[name]) for name in other)


def test_packed_recordings_make_the_same_model_and_are_kept(data, tmp_path, capsys):
    pack = tmp_path / "pack"
    argv = (data / "train", "--val", data / "test")
    train(capsys, *argv, "--out", tmp_path / "plain")
    for name in ("first", "again"):
        train(capsys, *argv, "--out", tmp_path / name, "--pack", pack)
        assert len(list(pack.iterdir())) == 5
    plain, first, again = (
        (tmp_path / name).read_bytes() for name in ("plain", "first", "again")
    )
    assert plain == first == again


def test_a_training_that_was_cut_goes_on_with_the_same_command(
    data, tmp_path, capsys, monkeypatch
):
    argv, step, left = (data / "test",), Trainer.step, iter(range(1))

    def once(*args) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        step(*args)

    train(capsys, *argv, "--out", tmp_path / "whole")
    with monkeypatch.context() as patch:
        patch.setattr(training, "SAVE_PERIOD", -1.0)
        patch.setattr(Trainer, "step", once)
        with suppress(KeyboardInterrupt):
            train(capsys, *argv, "--out", tmp_path / "cut")
    kept = tmp_path / "cut.training"
    assert kept.is_file() and not (tmp_path / "cut").exists()
    begun = kept.read_bytes()
    # Other settings or data are another training.
    for other in (("--seed", "5"), ("--classes", "tap"), ("--train.rate", "0.001")):
        code, _, err = train(capsys, *argv, "--out", tmp_path / "cut", *other)
        assert code == 2, other
        assert "cut.training is of a training with other data or settings" in err
        assert len(err.splitlines()) == 1
        assert kept.read_bytes() == begun
    code, _, err = train(capsys, *argv, "--out", tmp_path / "cut")
    assert (code, err) == (0, "")
    assert not kept.exists()
    assert (tmp_path / "cut").read_bytes() == (tmp_path / "whole").read_bytes()


def test_a_file_where_training_should_stand_that_is_none_is_one_line(
    data, tmp_path, capsys
):
    kept = tmp_path / "m.training"
    kept.write_text("mine")
    code, _, err = train(capsys, data / "test", "--out", tmp_path / "m")
    assert code == 2
    assert "m.training cannot be read" in err
    assert len(err.splitlines()) == 1
    assert kept.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [kept]


def test_training_starts_from_a_model_by_its_name_and_the_card_tells(
    data, tmp_path, capsys
):
    model = tmp_path / "m.safetensors"
    sizes = ("--train.network.width", "32", "--train.network.layers", "3")
    sizes += ("--train.network.channels", "48", "--train.rate", "1e-9")
    words = ("train", data / "train", "--out", model, *FLAGS, *sizes, "--start")
    assert call(capsys, *words, "ur5")[0] == 0
    assert load_model(model).card.training["start"] == "ur5"
    trained, start = load_model(model).weights, load_model("ur5").weights
    name = "encoder.embed.weight"
    np.testing.assert_allclose(trained[name], start[name], atol=1e-6)
    nowhere = tmp_path / "no.safetensors"
    code, _, err = call(capsys, *words, nowhere)
    assert code == 2 and f"{nowhere}: no such model" in err


def test_a_start_of_other_sizes_is_refused_in_a_line(data, tmp_path, capsys):
    model = tmp_path / "m.safetensors"
    code, _, err = train(capsys, data / "train", "--out", model, "--start", "ur5")
    assert code == 2 and len(err.splitlines()) == 1
    assert "width 32" in err and "--train.network.channels 48" in err
    assert not model.exists()


def test_the_card_tells_how_the_model_was_made(data, tmp_path, capsys):
    out = tmp_path / "m.safetensors"
    flags = ("--seed", "7", "--train.rate", "0.002")
    train(capsys, data / "train", "--out", out, *flags)
    card = load_model(out).card
    assert card.vocabulary == ("none", "hold", "tap")
    assert (card.kind, card.network.width) == ("pressure", 4)
    assert card.training["seed"] == "7"
    assert card.training["rate"] == "0.002"
    assert card.training["network.channels"] == "8"
    assert card.data_digest == hash_recordings(sorted((data / "train").iterdir()))
    assert set(card.metrics) == {"val_accuracy"}
    assert card.temperature > 0


def test_a_seed_makes_the_same_file_again_and_another_seed_another(
    data, tmp_path, capsys
):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        train(capsys, data / "test", "--out", tmp_path / name, "--seed", seed)
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_other_skins_are_learned_of_too_and_told_in_the_card(data, tmp_path, capsys):
    cards, weights = [], []
    for skins in (0, 1):
        model = tmp_path / f"{skins}.safetensors"
        code, out, _ = train(
            capsys, data / "train", "--out", model, "--skins", str(skins)
        )
        assert code == 0
        assert "1 of 4 recordings held out for validation\n" in out
        loaded = load_model(model)
        cards.append(loaded.card.training)
        weights.append(loaded.weights)
    assert [card["skins"] for card in cards] == ["0", "1"]
    assert "wear.unfelt" not in cards[0]
    assert cards[1]["wear.unfelt"] == str(AgingConfig().unfelt)
    assert any((weights[0][name] != weights[1][name]).any() for name in weights[0])


def test_without_validation_and_test_there_is_no_accuracy(data, tmp_path, capsys):
    model = tmp_path / "m"
    _, out, _ = train(
        capsys, data / "train", "--out", model, "--train.validation", "0", "--json"
    )
    result = last_json(out)
    assert (result["val_accuracy"], result["test_accuracy"]) == (None, None)
    assert load_model(model).card.temperature == 1.0


def test_only_the_classes_asked_for_are_learned(data, tmp_path, capsys):
    train(capsys, data / "test", "--out", tmp_path / "m", "--classes", "tap")
    assert load_model(tmp_path / "m").card.vocabulary == ("none", "tap")


def test_shear_is_learned_where_it_is_measured_unless_told_not_to(tmp_path, capsys):
    path = record(tmp_path / "a.mcap", kind="shear")
    train(capsys, path, "--out", tmp_path / "s")
    train(capsys, path, "--out", tmp_path / "p", "--train.no-shear")
    flat = record(tmp_path / "flat.mcap")
    train(capsys, path, flat, "--out", tmp_path / "m")
    cards = [load_model(tmp_path / name).card for name in "spm"]
    assert [card.kind for card in cards] == ["shear", "pressure", "pressure"]
    assert [np.isinf(card.graph.shear_on) for card in cards] == [False, True, True]


def test_a_model_learned_without_poses_keeps_to_that(data, tmp_path, capsys):
    blind = "--train.graph.no-posed"
    code, out, err = train(
        *(capsys, data / "train", "--out", tmp_path / "m", blind),
        *("--test", data / "test", "--json"),
    )
    assert (code, err) == (0, "")
    assert not load_model(tmp_path / "m").card.graph.posed
    said = last_json(out)["test_accuracy"]
    _, out, _ = call(capsys, "evaluate", tmp_path / "m", data / "test", "--json")
    assert last_json(out)["accuracy"] == said


def test_a_recording_cut_in_half_is_used_up_to_the_cut_and_named(
    data, tmp_path, capsys
):
    half = tmp_path / "half.mcap"
    whole = (data / "train/ann.mcap").read_bytes()
    half.write_bytes(whole[: len(whole) * 3 // 4])
    code, out, err = train(capsys, half, "--out", tmp_path / "m")
    assert (code, err) == (0, "")
    assert "half.mcap is cut or damaged: used up to there" in re.sub(r"\s+", " ", out)
    assert (tmp_path / "m").is_file()


def test_bad_input_is_one_line_and_leaves_nothing(data, tmp_path, capsys, no_training):
    source = data / "train/ann.mcap"
    start = tmp_path / "start.mcap"
    start.write_bytes(source.read_bytes()[:200])
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    (tmp_path / "empty").mkdir()
    quiet = record(tmp_path / "quiet.mcap", (), calibrated=True)
    one = record(tmp_path / "one.mcap", ["hold"], calibrated=True)
    wave = record(tmp_path / "wave.mcap", labels=[label(2.4, 3.6, "wave")])
    silent = record(tmp_path / "silent.mcap", labels=[])
    out = tmp_path / "m.safetensors"
    into = ("--out", out)
    files = set(tmp_path.rglob("*"))
    for argv, message in (
        ((tmp_path / "gone", *into), "no recording at"),
        ((tmp_path / "empty", *into), "no .mcap file below"),
        ((start, *into), "is cut before its"),
        ((text, *into), "text.mcap"),
        ((source,), "--out"),
        (into, "no recording given"),
        ((source, "--out", tmp_path), "is a folder"),
        ((source, "--out", start / "m"), "is no folder that can be written to"),
        ((quiet, *into), "no touch in 1 recordings"),
        ((one, *into), "hold only hold; at least two classes"),
        ((silent, *into), "hold only none; at least two classes"),
        ((source, *into, "--classes", "grab"), "no recording is labelled grab; labell"),
        ((source, *into, "--test", tmp_path / "gone"), "no recording at"),
        ((source, *into, "--val", tmp_path / "gone"), "no recording at"),
        ((source, *into, "--train.workers", "0"), "workers is 0; allowed is from 1"),
        ((source, *into, "--test", wave), "hold wave, which the model does not know"),
        ((source, *into, "--test", silent), "no labels; scoring needs them"),
        ((source, *into, "--seed", "x"), "--seed"),
        ((source, *into, "--epochs", "3"), "--epochs"),
        ((source, *into, "--train.rate", "fast"), "--train.rate"),
        ((source, *into, "--train.validation", "1.5"), "validation is 1.5; allowed is"),
        ((source, *into, "--train.batch", "0"), "batch is 0; allowed is from 1"),
    ):
        # The tiny settings come first, so that what is tested has the last word.
        code = run(["train", *FLAGS, *(str(word) for word in argv)])
        err = capsys.readouterr().err
        assert code == 2, (argv, err)
        assert message in err
        assert len(err.splitlines()) == 1
        assert set(tmp_path.rglob("*")) == files


def test_training_that_diverged_is_one_line_and_writes_nothing(
    data, tmp_path, capsys, monkeypatch
):
    def diverge(trainer, **kwargs):
        with torch.no_grad():
            trainer.network.graph_head.long.bias[0] = float("nan")
        return trainer.network

    monkeypatch.setattr(Trainer, "run", diverge)
    argv = (data / "train", "--out", tmp_path / "m", "--test", data / "test")
    code, _, err = train(capsys, *argv)
    assert code == 2
    assert "'graph_head.long.bias' holds NaN or infinity" in err
    assert "train it again, with a lower rate" in err
    assert len(err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_to_is_refused(
    data, tmp_path, capsys, no_training, monkeypatch
):
    monkeypatch.setattr("os.access", lambda *_: False)
    code, _, err = train(capsys, data / "train", "--out", tmp_path / "m")
    assert code == 2
    assert f"cannot write to {tmp_path}: " in err
    assert len(err.splitlines()) == 1
