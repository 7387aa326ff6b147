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


def start(words, **options):
    """Start a program whose output is kept."""
    return subprocess.Popen(
        list(map(str, words)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def test_two_processes_give_the_weights_of_two_threads(folder, capsys, monkeypatch):
    """This process is the first of two, in the environment that torchrun gives each."""
    data, one, two = folder / "data", folder / "one.st", folder / "two.st"
    words = (*TRAIN, data, "--out", two, "--pack", folder / "pack")
    joined = {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(free_port(0)),
        "WORLD_SIZE": "2",
    }
    environment = os.environ | joined | {"RANK": "1"}
    command = (sys.executable, "-m", "eskin.cli.main", *words)
    with monkeypatch.context() as patch, start(command, env=environment) as second:
        for name, value in (*joined.items(), ("RANK", "0")):
            patch.setenv(name, value)
        code, out, _ = call(capsys, *words)
        said, error = second.communicate(timeout=300)
    assert code == second.returncode == 0, error
    assert f"{two}: epochs 2" in out and not said
    assert call(capsys, *TRAIN, data, "--out", one, "--train.workers", "2")[0] == 0
    ours, theirs = (load_model(path).weights for path in (one, two))
    for name, weight in ours.items():
        assert np.allclose(weight, theirs[name], atol=1e-4), name
    assert sorted(path.name for path in folder.glob("*.st*")) == ["one.st", "two.st"]


def test_error_of_the_first_process_ends_both(folder):
    launcher = ("torch.distributed.run", "--standalone", "--nproc-per-node", "2")
    words = (*TRAIN, folder / "nothing", "--out", folder / "three.st")
    command = (sys.executable, "-m", *launcher, "-m", "eskin.cli.main", *words)
    with start(command) as both:
        _, error = both.communicate(timeout=300)
    assert both.returncode != 0
    assert "no recording" in error
    assert not (folder / "three.st").exists()
