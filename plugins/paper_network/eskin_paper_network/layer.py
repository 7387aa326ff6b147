"""This module implements the paper's layer (its equation 2) for sparse edges."""

from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from eskin_paper_network.layer_kernels import (
    EdgeGradients,
    EdgeInputs,
    EdgeWeights,
    return_messages,
    sum_messages,
)


class MessageSum(torch.autograd.Function):
    """Sums messages and moves over the sources of each target, by compiled kernels."""

    @staticmethod
    def forward(
        context: Any,  # noqa: ANN401
        first: Int[np.ndarray, "target+1"],
        source: Int[np.ndarray, "edge"],
        length: Float[np.ndarray, "edge"],
        moves: bool,
        of_target: Float[Tensor, "target width"],
        of_source: Float[Tensor, "row width"],
        x: Float[Tensor, "row 3"],
        *weights: Tensor,
    ) -> tuple[Float[Tensor, "target width"], Float[Tensor, "target 3"]]:
        """Return the sums over j of m_ij and of (x_i - x_j) phi_x(m_ij)."""
        context.edges = (first, source, length, moves)
        context.save_for_backward(of_target, of_source, x, *weights)
        messages = np.zeros(tuple(of_target.shape), np.float32)
        steps = np.zeros((len(of_target), 3), np.float32)
        inputs = EdgeInputs(*as_arrays(of_target, of_source, x), first, source, length)
        sum_messages(inputs, EdgeWeights(*as_arrays(*weights)), moves, messages, steps)
        return torch.from_numpy(messages), torch.from_numpy(steps)

    @staticmethod
    def backward(context: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Return the gradients of all inputs that are tensors."""
        first, source, length, moves = context.edges
        of_target, of_source, x, *weights = context.saved_tensors
        of_messages, of_steps = as_arrays(*gradients)
        found = EdgeGradients(
            *(
                np.zeros(tuple(each.shape), np.float32)
                for each in (of_target, of_source, x, *weights)
            )
        )
        return_messages(
            EdgeInputs(*as_arrays(of_target, of_source, x), first, source, length),
            EdgeWeights(*as_arrays(*weights)),
            moves,
            of_messages,
            of_steps,
            of_messages.any(axis=1) | of_steps.any(axis=1),
            found,
        )
        return (None, None, None, None, *map(torch.from_numpy, found))


def as_arrays(*tensors: Tensor) -> list[np.ndarray]:
    """Return tensors as contiguous arrays, without their gradients."""
    return [each.detach().contiguous().numpy() for each in tensors]


@final
class PaperLayer(nn.Module):
    """This layer is one EGCL, as the paper's equation 2 defines it.

    m_ij = phi_e(v_i, v_j, |x_i - x_j|^2, e_ij), e_ij the kinematic distance
    x_i <- x_i + C sum_j (x_i - x_j) phi_x(m_ij), C = 1 / K
    v_i <- phi_h(v_i, sum_j m_ij)

    phi_e's first layer is split into parts of i, j and the edge, for speed.

    Attributes:
        moves: whether it moves the coordinates, which nothing reads after the last
            layer.
        uses_length: whether phi_e sees |x_i - x_j|^2 and e_ij.
    """

    def __init__(self, width: int, k: int, moves: bool, uses_length: bool) -> None:
        """Create a layer of `width` channels for `k` neighbours inside a patch."""
        super().__init__()
        self.C = 1.0 / k
        self.moves = moves
        self.uses_length = uses_length
        self.of_target = nn.Linear(width, width)
        self.of_source = nn.Linear(width, width, bias=False)
        self.of_edge = nn.Linear(2, width, bias=False)
        self.message = nn.Linear(width, width)
        self.move = nn.Sequential(
            nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 1, bias=False)
        )
        self.update = nn.Sequential(
            nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(
        self,
        v: Float[Tensor, "row width"],
        x: Float[Tensor, "row 3"],
        first: Int[np.ndarray, "target+1"],
        source: Int[np.ndarray, "edge"],
        length: Float[np.ndarray, "edge"],
    ) -> tuple[Float[Tensor, "target width"], Float[Tensor, "target 3"]]:
        """Return features and coordinates of the targets, the first rows.

        Args:
            v: features of all rows.
            x: coordinates of all rows.
            first: first edge of each target.
            source: row of the source of each edge.
            length: e_ij of each edge.
        """
        targets = len(first) - 1
        of_edge = self.of_edge.weight
        messages, steps = MessageSum.apply(
            first,
            source,
            length,
            self.moves,
            self.of_target(v[:targets]),
            self.of_source(v),
            x,
            of_edge.T if self.uses_length else torch.zeros_like(of_edge.T),
            self.message.weight.T,
            self.message.bias,
            self.move[0].weight.T,
            self.move[0].bias,
            self.move[2].weight[0],
        )
        updated = self.update(torch.cat([v[:targets], messages], dim=1))
        return updated, x[:targets] + self.C * steps
