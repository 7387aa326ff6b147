"""Graphs laid end to end: taken apart, put together, summed."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.graph import (
    compute_node_scalars,
    create_empty_batch,
    join_graphs,
)
from helpers.graphs import assert_same, pressure_summary, random_graph, shear_summary

SIZES = [(4, 1, 7), (0, 5, 0, 0, 3, 0), (0,), (0, 0, 0), (6,), (5, 0), (0, 5)]
of_any_sizes = pytest.mark.parametrize("sizes", SIZES)


def graphs_of(sizes):
    rng = np.random.default_rng(sum(sizes) + len(sizes))
    return [random_graph(rng, nodes) for nodes in sizes]


@of_any_sizes
def test_selecting_from_joined_graphs_gives_them_back(sizes):
    graphs = graphs_of(sizes)
    batch = join_graphs(graphs)
    for index, graph in enumerate(graphs):
        assert_same(batch.select(np.array([index])), graph)
    assert_same(batch.select(np.arange(len(sizes))), batch)


@of_any_sizes
def test_selecting_in_any_order_and_twice_is_joining_so(sizes):
    graphs = graphs_of(sizes)
    chosen = np.random.default_rng(0).integers(0, len(sizes), 9)
    want = join_graphs([graphs[n] for n in chosen])
    assert_same(join_graphs(graphs).select(chosen), want)


@of_any_sizes
def test_joining_joined_graphs_is_joining_them_all(sizes):
    graphs = graphs_of(sizes)
    halves = [graphs[: len(graphs) // 2 + 1], graphs[len(graphs) // 2 + 1 :]]
    assert_same(
        join_graphs([join_graphs(half) for half in halves if half]), join_graphs(graphs)
    )


def test_selecting_no_graph_is_a_batch_of_none():
    batch = join_graphs(graphs_of((3, 0, 2)))
    none = batch.select(np.array([], np.int64))
    assert_same(none, create_empty_batch(batch.neighbours.shape[1]))
    assert (none.count, len(none.taxels), none.offsets.tolist()) == (0, 0, [0])
    assert_same(join_graphs([none, batch, none]), batch)
    for features in (pressure_summary, shear_summary, compute_node_scalars):
        assert len(features(none)) == 0


def test_joining_nothing_is_refused():
    with pytest.raises(ValueError, match="no graphs to join; give at least one"):
        join_graphs([])


@of_any_sizes
def test_sources_are_the_neighbours_in_the_own_graph(sizes):
    batch = join_graphs(graphs_of(sizes))
    assert batch.count == len(sizes)
    assert batch.sizes.tolist() == list(sizes)
    assert len(batch.sources) == len(batch.targets)
    for node, heard in zip(batch.targets, batch.sources, strict=True):
        first = batch.offsets[batch.graph_index[node]]
        neighbours = batch.neighbours[node]
        assert sorted(heard[heard >= 0] - first) == sorted(neighbours[neighbours >= 0])


@of_any_sizes
def test_only_active_nodes_hear_and_no_column_is_empty(sizes):
    batch = join_graphs(graphs_of(sizes))
    assert np.array_equal(batch.targets, np.flatnonzero(batch.pressure > 0))
    assert (batch.sources >= 0).any(axis=0).all()
    unheard = replace(batch, neighbours=np.full_like(batch.neighbours, -1))
    assert unheard.sources.shape == (len(batch.targets), 0)


@of_any_sizes
@pytest.mark.parametrize("axes", [(), (3,), (2, 3)])
def test_sums_over_nodes_are_those_of_loops(sizes, axes):
    batch = join_graphs(graphs_of(sizes))
    values = np.random.default_rng(5).normal(size=(sum(sizes), *axes)) - 3.0
    offsets = batch.offsets
    parts = [values[a:b] for a, b in zip(offsets[:-1], offsets[1:], strict=True)]
    sums = np.array([part.sum(axis=0) for part in parts])
    np.testing.assert_allclose(batch.sum_nodes(values), sums, atol=1e-12)


@of_any_sizes
def test_features_of_graphs_laid_end_to_end_are_those_of_each_alone(sizes):
    graphs = graphs_of(sizes)
    for features in (pressure_summary, shear_summary, compute_node_scalars):
        alone = np.concatenate([features(graph) for graph in graphs])
        together = features(join_graphs(graphs))
        np.testing.assert_allclose(together, alone, rtol=1e-5, atol=1e-5)
        assert together.dtype == np.float32
        assert np.isfinite(together).all()


def test_a_graph_without_nodes_has_a_summary_of_zeros():
    empty = join_graphs(graphs_of((0, 0)))
    empty = replace(empty, history=np.zeros_like(empty.history))
    assert not pressure_summary(empty).any()
    assert not shear_summary(empty).any()
