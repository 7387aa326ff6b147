"""Several processes train as one with as many threads does."""

import subprocess
import sys

import numpy as np
import pytest

from eskin.model import load_model
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


def run_two_processes(folder, *words):
    launcher = (sys.executable, "-m", "torch.distributed.run", "--standalone")
    command = (*launcher, "--nproc-per-node", "2", "-m", "eskin.cli.main")
    return subprocess.run(
        [*command, *map(str, (*TRAIN, *words, "--pack", folder / "pack"))],
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_two_processes_give_the_weights_of_two_threads(folder, capsys):
    data, one, two = folder / "data", folder / "one.st", folder / "two.st"
    done = run_two_processes(folder, data, "--out", two)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(f"{two}: epochs 2") == 1
    assert call(capsys, *TRAIN, data, "--out", one, "--train.workers", "2")[0] == 0
    ours, theirs = (load_model(path).weights for path in (one, two))
    for name, weight in ours.items():
        assert np.allclose(weight, theirs[name], atol=1e-4), name
    assert sorted(path.name for path in folder.glob("*.st*")) == ["one.st", "two.st"]


def test_error_of_the_first_process_ends_both(folder):
    done = run_two_processes(folder, folder / "nothing", "--out", folder / "three.st")
    assert done.returncode != 0
    assert "no recording" in done.stderr
    assert not (folder / "three.st").exists()
