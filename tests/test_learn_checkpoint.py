"""Checkpoints of a training: written whole, loaded only by the same training."""

import pickle
from dataclasses import replace

import pytest
import torch

from eskin.errors import ModelError
from eskin.learn.checkpoint import Checkpoint, load_checkpoint, save_checkpoint

CHECKPOINT = Checkpoint(
    facts="data and settings",
    step=7,
    best={"patience": 2, "loss": 0.5, "weights": {"a": torch.arange(4.0)}},
    state={"rngs": [{"state": {"state": 2**100 + 1, "inc": 3}}], "torch": None},
)


def test_a_checkpoint_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "below" / "m.training"
    for step in (7, 8):
        save_checkpoint(path, replace(CHECKPOINT, step=step))
        found = load_checkpoint(path, CHECKPOINT.facts)
        assert found is not None
        assert (found.facts, found.step, found.state) == (
            CHECKPOINT.facts,
            step,
            CHECKPOINT.state,
        )
        assert torch.equal(found.best["weights"]["a"], torch.arange(4.0))
        assert list(path.parent.iterdir()) == [path]


def test_without_a_file_there_is_no_checkpoint(tmp_path):
    assert load_checkpoint(tmp_path / "m.training", "any") is None


class Malicious:
    """Runs code if it is unpickled."""

    def __reduce__(self):
        return (print, ("executed",))


def test_damaged_and_foreign_files_are_refused_and_unchanged(tmp_path, capsys):
    path = tmp_path / "m.training"
    save_checkpoint(path, CHECKPOINT)
    whole = path.read_bytes()
    foreign = tmp_path / "foreign"
    torch.save([1, 2], foreign)
    lists = foreign.read_bytes()
    torch.save({"facts": CHECKPOINT.facts}, foreign)
    less = foreign.read_bytes()
    for data in (b"", b"text", whole[: len(whole) // 2], lists, less):
        path.write_bytes(data)
        with pytest.raises(ModelError, match="m.training cannot be read") as caught:
            load_checkpoint(path, CHECKPOINT.facts)
        assert "remove it to start anew" in str(caught.value)
        assert "\n" not in str(caught.value)
        assert path.read_bytes() == data
    path.write_bytes(pickle.dumps(Malicious()))
    with pytest.raises(ModelError, match="cannot be read"):
        load_checkpoint(path, CHECKPOINT.facts)
    assert capsys.readouterr().out == ""


def test_the_checkpoint_of_another_training_is_refused(tmp_path):
    path = tmp_path / "m.training"
    save_checkpoint(path, CHECKPOINT)
    with pytest.raises(ModelError, match="is of a training with other data") as caught:
        load_checkpoint(path, CHECKPOINT.facts + "!")
    assert "remove it to start anew, or give another --out" in str(caught.value)
    assert "\n" not in str(caught.value)
