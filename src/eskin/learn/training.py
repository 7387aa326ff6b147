"""Training: balanced windows, one learning-rate cycle, the best epoch kept."""

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from rich.progress import Progress
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from eskin.graph import GraphConfig
from eskin.learn.augment import AugmentConfig, augment
from eskin.learn.dataset import Dataset
from eskin.learn.holdout import gestures_made, hold_out, sittings_of
from eskin.learn.sampler import check_classes, make_sampler
from eskin.learn.windows import cut, thin, to_input, to_places
from eskin.model import NetworkConfig, check_limits
from eskin.nn import NetworkInput, Places, RecogniserNetwork, summary

VALIDATION = 256
"""Windows that validation looks at."""

TEMPERATURES = np.geomspace(0.3, 5.0, 57)
"""The temperatures tried."""

LIMITS = {
    "epochs": (1, np.inf),
    "steps": (1, np.inf),
    "batch": (1, np.inf),
    "encoded": (1, np.inf),
    "readings": (1, np.inf),
    "threads": (1, np.inf),
    "patience": (0, np.inf),
    "rate": (1e-9, 1.0),
    "decay": (0.0, np.inf),
    "smoothing": (0.0, 1.0),
    "validation": (0.0, 0.9),
}
"""Smallest and largest values of the settings."""


@dataclass(frozen=True)
class TrainConfig:
    """How the network is trained."""

    epochs: int = 10
    """Epochs of `steps` steps."""

    steps: int = 40
    """Steps an epoch."""

    batch: int = 64
    """Windows a step."""

    encoded: int = 32
    """Of these, windows whose graphs are encoded, which is what takes the time: the
    summary view sees all."""

    readings: int = 25
    """Of an encoded window, readings whose graphs are encoded, drawn anew each time."""

    rate: float = 3e-3
    """Highest learning rate of the cycle."""

    decay: float = 0.3
    """Weight decay."""

    smoothing: float = 0.1
    """Label smoothing."""

    patience: int = 5
    """Epochs without a better validation loss that are waited for; one more stops."""

    validation: float = 0.15
    """Share of the recordings held out to choose the epoch, in whole sessions; 0 trains
    to the end."""

    shear: bool = True
    """Whether shear is used where every skin measures it."""

    threads: int = 1
    """Threads of torch; graphs are small, and more threads mostly wait."""

    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """How training windows vary."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    @property
    def graph(self) -> GraphConfig:
        """The graphs to train on: without shear, it touches no taxel either."""
        return GraphConfig() if self.shear else GraphConfig().without_shear()

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)


@dataclass(frozen=True)
class Batch:
    """Training windows: the summary of every reading, the graphs of some."""

    summary: Float[Tensor, "reading feature"]
    """Of every reading."""
    places: Places
    """Where those readings stand."""
    some: NetworkInput
    """Of the first windows, the readings whose graphs are encoded."""
    labels: Int[Tensor, "window"]
    """Class of each window."""


class Trainer:
    """Trains one network on a data set."""

    def __init__(
        self,
        dataset: Dataset,
        vocabulary: tuple[str, ...],
        config: TrainConfig,
        recordings: list[int] | None = None,
        seed: int = 0,
    ) -> None:
        """Prepare to train on some of the recordings, by default on all."""
        self.dataset, self.config = dataset, config
        self.rng = np.random.default_rng(seed)
        torch.manual_seed(seed)
        chosen = (
            list(range(len(dataset.recordings))) if recordings is None else recordings
        )
        self.holdout = hold_out(
            sittings_of(dataset, chosen),
            gestures_made(dataset, vocabulary),
            config.validation,
            self.rng,
        )
        window = (config.network.slots, config.augment.crop)
        self.sampler = make_sampler(dataset, vocabulary, self.holdout.train, *window)
        check_classes(self.sampler, vocabulary)
        validation = make_sampler(dataset, vocabulary, self.holdout.held, *window)
        self.held = validation if validation.classes else None
        self.shear = config.shear and dataset.has_shear
        self.graph = config.graph if self.shear else config.graph.without_shear()
        self.network = RecogniserNetwork(config.network, len(vocabulary), self.shear)
        self.epochs = 0

    def run(self, quiet: bool = False) -> RecogniserNetwork:
        """Train to the end or until validation no longer improves."""
        config, network = self.config, self.network
        torch.set_num_threads(config.threads)
        network.standardise_by(self.batch(4 * config.batch).summary)
        optimiser = torch.optim.AdamW(network.parameters(), weight_decay=config.decay)
        total = config.epochs * config.steps
        cycle = torch.optim.lr_scheduler.OneCycleLR(
            optimiser, config.rate, total_steps=total
        )
        best = Best(config.patience)
        with Progress(disable=quiet, transient=True) as progress:
            task = progress.add_task("Training", total=total)
            for self.epochs in range(1, config.epochs + 1):
                network.train()
                for _ in range(config.steps):
                    self.step(optimiser)
                    cycle.step()
                    progress.advance(task)
                if self.held is not None and best.is_enough(
                    network, self.validation_loss()
                ):
                    break
        best.restore(network)
        return network.eval()

    def step(self, optimiser: torch.optim.Optimizer) -> None:
        """One step on one batch."""
        loss = self.loss(self.batch(self.config.batch))
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        optimiser.step()

    def loss(self, batch: Batch) -> Float[Tensor, ""]:
        """Cross entropy of each view and of both together."""
        network, smoothing = self.network, self.config.smoothing
        standardised = network.standardised(batch.summary)
        by_summary = network.summary_view(standardised, batch.places)
        by_graph = network.graph_view(
            network.embed(batch.some.graphs), batch.some.places
        )
        both = (by_summary[: len(by_graph)] + by_graph) / 2
        together, summary_alone, graph_alone = (
            cross_entropy(
                logits, batch.labels[: len(logits)], label_smoothing=smoothing
            )
            for logits in (both, by_summary, by_graph)
        )
        return together + (summary_alone + graph_alone) / 2

    def batch(self, count: int) -> Batch:
        """A batch of augmented training windows."""
        ends, firsts, labels = self.sampler.draw(count, self.rng)
        windows = cut(self.dataset, ends, firsts, self.config.network.slots)
        graphs = self.dataset.graphs.select(windows.rows)
        varied = augment(graphs, windows.window, self.rng, self.config.augment)
        places = replace(windows, rows=np.arange(len(windows.rows)))
        some = thin(places.first(self.config.encoded), self.config.readings, self.rng)
        return Batch(
            summary=torch.as_tensor(summary(varied, self.shear)),
            places=to_places(windows),
            some=to_input(varied.select(some.rows), some, self.shear),
            labels=torch.tensor(labels),
        )

    def validation_loss(self) -> float:
        """Loss on windows of the recordings held out, always the same ones."""
        logits, labels = self.validation_logits()
        return float(cross_entropy(logits, labels))

    def validation_accuracy(self) -> float:
        """Share of the same windows that are recognised; NaN if none are held out."""
        if self.held is None:
            return float("nan")
        logits, labels = self.validation_logits()
        return float((logits.argmax(dim=1) == labels).double().mean())

    def temperature(self) -> float:
        """What to divide logits by for honest probabilities (Guo et al. 2017)."""
        if self.held is None:
            return 1.0
        logits, labels = self.validation_logits()
        losses = [float(cross_entropy(logits / t, labels)) for t in TEMPERATURES]
        return float(TEMPERATURES[int(np.argmin(losses))])

    def validation_logits(
        self,
    ) -> tuple[Float[Tensor, "window class"], Int[Tensor, "window"]]:
        """Logits and classes of windows of the recordings held out."""
        assert self.held is not None
        self.network.eval()
        ends, firsts, labels = self.held.draw(VALIDATION, np.random.default_rng(0))
        windows = cut(self.dataset, ends, firsts, self.config.network.slots)
        graphs = self.dataset.graphs.select(windows.rows)
        with torch.no_grad():
            logits = self.network(to_input(graphs, windows, self.shear))
        return logits, torch.tensor(labels)


class Best:
    """Remembers the weights with the lowest validation loss."""

    def __init__(self, patience: int) -> None:
        """Start with nothing."""
        self.patience, self.waited = patience, 0
        self.loss = float("inf")
        self.weights: dict[str, Tensor] | None = None

    def is_enough(self, network: nn.Module, loss: float) -> bool:
        """Take in an epoch; True when it is time to stop."""
        if loss < self.loss:
            self.loss, self.waited = loss, 0
            self.weights = {k: v.clone() for k, v in network.state_dict().items()}
        else:
            self.waited += 1
        return self.waited > self.patience

    def restore(self, network: nn.Module) -> None:
        """Put the best weights back, if any were kept."""
        if self.weights is not None:
            network.load_state_dict(self.weights)
