"""This module lets several processes train one network, as `torchrun` starts them."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import torch
from torch import Tensor, distributed, nn

T = TypeVar("T")


@dataclass(frozen=True)
class Processes:
    """Processes train one network together; each draws windows of its own."""

    rank: int = 0
    """Number of this process; the first, 0, validates, writes and prints."""
    count: int = 1
    """Number of processes."""

    @property
    def is_first(self) -> bool:
        """Return whether this process is the first one."""
        return self.rank == 0

    def average(self, gradients: Sequence[Tensor]) -> list[Tensor]:
        """Return the mean of the gradients of all processes."""
        if self.count == 1:
            return list(gradients)
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        distributed.all_reduce(flat)
        parts = (flat / self.count).split([g.numel() for g in gradients])
        return [part.view_as(g) for part, g in zip(parts, gradients, strict=True)]

    def broadcast(self, value: T) -> T:
        """Return the value that the first process has."""
        if self.count == 1:
            return value
        values = [value]
        distributed.broadcast_object_list(values, src=0)
        return values[0]

    def copy_network(self, network: nn.Module) -> None:
        """Give a network the weights that the first process has."""
        state = network.state_dict()
        network.load_state_dict(self.broadcast(state))

    def gather(self, value: T) -> list[T]:
        """Return the values of all processes, in their order."""
        if self.count == 1:
            return [value]
        values: list[Any] = [None] * self.count
        distributed.all_gather_object(values, value)
        return values

    @contextmanager
    def first_alone(self) -> Iterator[None]:
        """Let the others begin a block once the first process has ended it."""
        if self.count > 1 and not self.is_first:
            distributed.barrier()
        yield
        if self.count > 1 and self.is_first:
            distributed.barrier()


ALONE = Processes()
"""One process."""


@contextmanager
def join_processes() -> Iterator[Processes]:
    """Join the processes that `torchrun` has started; without it there is one.

    They are joined by gloo, which runs on processors, on one machine and on several.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield ALONE
        return
    distributed.init_process_group("gloo")
    try:
        yield Processes(distributed.get_rank(), count)
    finally:
        distributed.destroy_process_group()
