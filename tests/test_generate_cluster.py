"""Tests of generation on a Ray cluster: the same bytes, though a machine is lost."""

import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from eskin.errors import GenerationError
from eskin.registry import advise_install
from eskin.sim.dataset import GenerationSettings, generate
from eskin.sim.dataset.cluster import make_file, open_cluster
from helpers.cli import assert_refused
from helpers.simulation import Slow, StandIn, read_files

pytestmark = pytest.mark.slow

SETTINGS = GenerationSettings("train", "ur5", seed=3, clips=240, subjects=12)
MEMORY = 100_000_000


@pytest.fixture
def cluster(monkeypatch):
    """Start a head without cores and two nodes of one core each; return all three."""
    from ray.cluster_utils import Cluster

    root = Path(__file__).parents[1]
    places = (root / "src", root, root / "tests")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, places)))
    monkeypatch.setenv("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
    monkeypatch.setenv("RAY_health_check_period_ms", "500")
    whole = Cluster()
    whole.add_node(num_cpus=0, object_store_memory=MEMORY, include_dashboard=False)
    nodes = [whole.add_node(num_cpus=1, object_store_memory=MEMORY) for _ in range(2)]
    try:
        yield whole, nodes
    finally:
        with suppress(Exception):
            whole.shutdown()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_set_of_a_cluster_that_loses_a_machine_has_the_same_bytes(cluster, tmp_path):
    whole, nodes = cluster
    generate(tmp_path / "alone", SETTINGS, factory=StandIn)
    done = []
    lost = []

    def lose_one(count):
        done.append(count)
        if 0 < count < SETTINGS.clip_set.clips and not lost:
            lost.append(count)
            threading.Thread(target=whole.remove_node, args=(nodes[0], False)).start()

    target = tmp_path / "cluster"
    with open_cluster(whole.address) as write:
        result = generate(
            target, SETTINGS, factory=Slow, on_progress=lose_one, write=write
        )
    assert result.made == 240 and lost and lost[0] < 240
    assert done == sorted(done) and done[-1] == 240
    assert read_files(tmp_path / "cluster") == read_files(tmp_path / "alone")


def test_share_is_refused_where_the_code_is_another():
    with pytest.raises(GenerationError, match="another version of eskin"):
        make_file(SETTINGS, SETTINGS.sessions[0], StandIn, "another")


def test_share_has_the_bytes_of_a_file_that_is_made_alone(tmp_path):
    from eskin.compiled import digest_code

    generate(tmp_path, SETTINGS, factory=StandIn)
    version = digest_code("eskin.sim.dataset.cluster")
    data, rows = make_file(SETTINGS, SETTINGS.sessions[1], StandIn, version)
    assert data == (tmp_path / SETTINGS.sessions[1].file).read_bytes()
    assert len(rows) == SETTINGS.sessions[1].clips


def test_options_of_a_cluster_are_checked(tmp_path, capsys, monkeypatch):
    words = ("generate", tmp_path / "out", "--ray", "127.0.0.1:1", "--clips", 1)
    assert_refused(capsys, *words, "--workers", 2, part="one of them")
    assert_refused(capsys, *words, part="no Ray cluster at '127.0.0.1:1'")
    other = ("generate", tmp_path / "out", "--ray", "head", "--clips", 1)
    assert_refused(capsys, *other, part="no HOST:PORT")
    monkeypatch.setitem(sys.modules, "ray", None)
    assert_refused(capsys, *words, part=advise_install("scale"))
    assert not (tmp_path / "out").exists()
