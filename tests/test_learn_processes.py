"""Several processes train as one with as many threads does."""

import os
import subprocess
import sys

import numpy as np
import pytest

from eskin.live import load_model
from eskin.page.process import free_port
from helpers.cli import call
from helpers.learning import FLAGS, record_people

pytestmark = pytest.mark.slow

TRAIN = ("train", *FLAGS, "--train.network.dropout", "0", "--train.epochs", "2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with recordings of two people in `data`."""
    path = tmp_path_factory.mktemp("processes")
    record_people(path / "data", ("ann", "bob"))
    return path


def train_in_two(patch, capsys, *words):
    """Train in this process and one more, in the environment that torchrun gives each.

    Returns the exit code, text and error of each.
    """
    joined = {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(free_port(0)),
        "WORLD_SIZE": "2",
    }
    command = [sys.executable, "-m", "eskin.cli.main", *map(str, words)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = os.environ | joined | {"RANK": "1"}
    with subprocess.Popen(command, env=environment, **pipes) as second:
        for name, value in (*joined.items(), ("RANK", "0")):
            patch.setenv(name, value)
        first = call(capsys, *words)
        said, error = second.communicate(timeout=300)
    return first, (second.returncode, said, error)


def test_two_processes_give_the_weights_of_two_threads(folder, capsys, monkeypatch):
    data = folder / "data"
    one = folder / "one.st"
    two = folder / "two.st"
    words = (*TRAIN, data, "--out", two, "--pack", folder / "pack")
    with monkeypatch.context() as patch:
        (code, out, _), (other, said, error) = train_in_two(patch, capsys, *words)
    assert code == other == 0, error
    assert f"{two}: epochs 2" in out and not said
    assert call(capsys, *TRAIN, data, "--out", one, "--train.workers", "2")[0] == 0
    ours, theirs = (load_model(path).weights for path in (one, two))
    for name, weight in ours.items():
        assert np.allclose(weight, theirs[name], atol=1e-4), name
    assert sorted(path.name for path in folder.glob("*.st*")) == ["one.st", "two.st"]


def test_error_of_the_first_process_ends_both(folder, capsys, monkeypatch):
    words = (*TRAIN, folder / "nothing", "--out", folder / "three.st")
    (code, _, error), (other, *_) = train_in_two(monkeypatch, capsys, *words)
    assert code == 2 and other != 0
    assert "no recording" in error
    assert not (folder / "three.st").exists()
