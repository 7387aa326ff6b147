"""Graphs on disk are those in memory, to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.mapped_graphs import map_graphs
from eskin.live import create_empty_batch, join_graphs
from helpers.graphs import assert_same, random_graph, random_graphs


def test_graphs_on_disk_are_those_in_memory(tmp_path):
    rng = np.random.default_rng(0)
    batches = [
        create_empty_batch(6),
        random_graphs(rng, (3, 0, 8)),
        create_empty_batch(6),
    ]
    batches.append(random_graphs(rng, (5, 1)))
    assert_same(map_graphs(batches, tmp_path), join_graphs(batches))


def test_what_is_zero_until_late_is_kept(tmp_path):
    rng = np.random.default_rng(0)
    touched = random_graph(rng, 7)
    nothing = np.zeros_like(touched.shear)
    still = replace(touched, shear=nothing, shear_before=nothing)
    for batches in ([still, still], [still, touched], [touched, still]):
        assert_same(map_graphs(batches, tmp_path), join_graphs(batches))


def test_graphs_on_disk_leave_no_file_and_cannot_be_changed(tmp_path):
    rng = np.random.default_rng(0)
    mapped = map_graphs([random_graph(rng, 4)], tmp_path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="read-only"):
        mapped.pressure[0] = 1.0


def test_no_batch_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="no graphs to join"):
        map_graphs([], tmp_path)
