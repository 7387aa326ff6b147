"""This module exports the network as ONNX (extra `export`): one step of one touch."""

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from eskin.errors import ModelError
from eskin.files import atomic_path
from eskin.learn.checkpoint import to_network
from eskin.learn.nn import GraphTensors, RecogniserNetwork
from eskin.live import (
    NODE_SCALARS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    SLOT_NS,
    Model,
)
from eskin.registry import Exporter, find_package

OPSET = 20
"""Version of the operators of ONNX."""
OUTPUTS = ("features", "logits", "probabilities")
CHECKED_SIZES = (0, 1, 2, 5, 17, 60, 150)
"""Numbers of taxels of the contacts on which an exported network is checked."""
NEIGHBOURS = 12
"""Number of neighbours of the contacts on which an exported network is checked."""


@dataclass(frozen=True)
class StepInput:
    """The input of one step; its fields are the inputs of the ONNX network, in order.

    Without a contact, as between the two pats of a double pat, forces and targets are
    those of no active taxel.
    """

    scalars: Float[Tensor, "node scalar"]
    """Columns `eskin.live.NODE_SCALARS` of the taxels of the touch and of their
    neighbours."""
    positions: Float[Tensor, "node 3"]
    """Positions relative to any point [cm]."""
    normals: Float[Tensor, "node 3"]
    """Outward unit normals."""
    shear: Float[Tensor, "node 3"]
    """Compressed shear traction; zeros where shear is not measured."""
    forces: Float[Tensor, "node"]
    """Pressure times area in any unit."""
    areas: Float[Tensor, "node"]
    """Areas [cm2]."""
    targets: Int[Tensor, "target"]
    """Active nodes, which receive messages."""
    sources: Int[Tensor, "target k"]
    """Neighbours of each target, as nodes, or -1: the result of the search."""
    summary: Float[Tensor, "1 feature"]
    """Invariants of the touch as a whole."""
    window: Float[Tensor, "slot channel"]
    """Features of the last 2 s, one row a slot of 20 ms. The last row is the slot of
    this reading, with the features of its earlier readings, if there were any."""
    present: Float[Tensor, "slot"]
    """1 where a slot holds a reading, else 0."""


NAMES = tuple(field.name for field in fields(StepInput))


class StepNetwork(nn.Module):
    """A step takes one reading of one touch and the features of those before it."""

    def __init__(self, network: RecogniserNetwork, temperature: float) -> None:
        """Wrap a network and the temperature that calibrates its probabilities."""
        super().__init__()
        self.network = network
        self.temperature = temperature

    def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the features of the last slot, logits and probabilities.

        Args:
            inputs: the fields of a `StepInput`.
        """
        one = StepInput(*inputs)
        index = torch.zeros_like(one.forces, dtype=torch.int64)
        graph = GraphTensors(
            one.scalars,
            one.positions,
            one.normals,
            one.shear,
            one.forces,
            one.areas,
            one.targets,
            one.sources,
            index,
            one.summary,
        )
        new = self.network.embed(graph)
        kept = torch.where(one.present[-1:, None] > 0, one.window[-1:], -torch.inf)
        features = torch.maximum(new, kept)
        e = torch.cat([one.window[:-1], features])[None]
        present = torch.cat([one.present[:-1], torch.ones_like(one.present[-1:])])[None]
        logits = self.network.classify_slots(e, present).mean(dim=0)
        return features[0], logits[0], torch.softmax(logits[0] / self.temperature, 0)


def export_onnx(model: Model, path: Path | str, seed: int = 0) -> float:
    """Write a model as an ONNX network of one step, of any number of taxels and edges.

    The network takes the fields of `StepInput` and returns `features` of the last slot,
    which the caller keeps in `window`, `logits` and `probabilities`. What it has to
    know besides lies in the file's metadata. These are the answers for a touch that is
    open: a layer that the model has for touches that close is left out.

    Args:
        model: the model.
        path: file to write.
        seed: seed of the contacts on which the result is checked.

    Returns:
        Greatest difference of a logit from torch's.

    Raises:
        ExtraError: onnx or onnxruntime is not installed.
        ModelError: the weights do not fit the model's card.
    """
    onnx = find_package("onnx", "onnx", "export", "a model as ONNX")
    runtime = find_package("onnxruntime", "onnxruntime", "export", "a model as ONNX")
    find_package("onnxscript", "onnxscript", "export", "a model as ONNX")
    step = StepNetwork(to_network(model), model.card.temperature).eval()
    rng = np.random.default_rng(seed)
    example = draw_step(rng, step.network, 40)
    count = torch.export.Dim("node")
    edges = torch.export.Dim("target")
    neighbours = torch.export.Dim("neighbour")
    shapes = {name: {0: count} for name in ("scalars", "positions", "normals", "shear")}
    shapes |= {"forces": {0: count}, "areas": {0: count}, "targets": {0: edges}}
    shapes |= {"sources": {0: edges, 1: neighbours}}
    with quiet_exporter():
        program = torch.onnx.export(
            step,
            tuple(getattr(example, name) for name in NAMES),
            input_names=list(NAMES),
            output_names=list(OUTPUTS),
            opset_version=OPSET,
            dynamic_shapes=(tuple(shapes.get(name) for name in NAMES),),
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    exported = program.model_proto
    for key, value in describe_model(model).items():
        exported.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(exported)
    data = exported.SerializeToString()
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    checked = [draw_step(rng, step.network, size) for size in CHECKED_SIZES]
    error = max(measure_error(session, step, one) for one in checked)
    if not np.isfinite(error):
        raise ModelError(
            "the exported network gives numbers that are not finite; allowed is a "
            "model whose logits are finite; train it again"
        )
    with atomic_path(Path(path)) as part:
        part.write_bytes(data)
    return error


@contextmanager
def quiet_exporter() -> Iterator[None]:
    """Keep the warnings of the exporter, which are about torch itself, off stderr."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def describe_model(model: Model) -> dict[str, str]:
    """Return what a program has to know to run the exported network."""
    card = model.card
    shear = SHEAR_SUMMARY if card.kind == "shear" else ()
    return {
        "vocabulary": json.dumps(card.vocabulary),
        "kind": card.kind,
        "slot_seconds": str(SLOT_NS / 1e9),
        "node_scalars": json.dumps(NODE_SCALARS),
        "summary": json.dumps((*PRESSURE_SUMMARY, *shear)),
    }


def draw_step(
    rng: np.random.Generator, network: RecogniserNetwork, nodes: int
) -> StepInput:
    """Draw the input of a step of so many taxels, half of them active.

    The last two readings have been in a window that is half full.
    """
    active = (nodes + 1) // 2
    scalars = len(NODE_SCALARS)
    features = len(network.summary_mean)
    slots = network.config.slots
    size = features + 2 * network.config.width

    def real(*shape: int) -> Tensor:
        return torch.as_tensor(rng.normal(size=shape), dtype=torch.float32)

    forces = rng.uniform(0.1, 5.0, nodes) * (np.arange(nodes) < active)
    sources = rng.integers(-1, max(nodes, 1), (active, NEIGHBOURS))
    present = (np.arange(slots) >= slots // 2) & (rng.random(slots) < 0.8)
    return StepInput(
        scalars=real(nodes, scalars),
        positions=real(nodes, 3),
        normals=nn.functional.normalize(real(nodes, 3)),
        shear=torch.zeros(nodes, 3),
        forces=torch.as_tensor(forces, dtype=torch.float32),
        areas=torch.as_tensor(rng.uniform(0.1, 1.0, nodes), dtype=torch.float32),
        targets=torch.arange(active),
        sources=torch.as_tensor(sources),
        summary=real(1, features),
        window=real(slots, size) * torch.as_tensor(present)[:, None],
        present=torch.as_tensor(present, dtype=torch.float32),
    )


def measure_error(session: Any, step: StepNetwork, one: StepInput) -> float:  # noqa: ANN401
    """Return the greatest difference of a logit between ONNX and torch."""
    tensors = {name: getattr(one, name) for name in NAMES}
    with torch.no_grad():
        _, expected, _ = step(*tensors.values())
    feeds = {name: tensor.numpy() for name, tensor in tensors.items()}
    [found] = session.run(["logits"], feeds)
    return float(np.abs(found - expected.numpy()).max())


ONNX = Exporter(lambda model, path: {"max_error": export_onnx(model, path)}, "model")
