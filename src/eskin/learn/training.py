"""This module trains the recogniser: balanced windows, one learning-rate cycle, the
best epoch kept.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from rich.progress import Progress
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from eskin.graph import GraphConfig
from eskin.learn.augment import NO_AUGMENTATION, AugmentConfig
from eskin.learn.batches import Batch, BatchBuilder, build_sampler, check_classes
from eskin.learn.checkpoint import EarlyStopping, TrainingState
from eskin.learn.dataset import Dataset
from eskin.learn.holdout import find_gestures, find_sessions, hold_out
from eskin.learn.scoring import predict_clips
from eskin.model import Model, NetworkConfig, check_limits
from eskin.nn import RecogniserNetwork

LIMITS = {
    "epochs": (1, np.inf),
    "steps": (1, np.inf),
    "batch": (1, np.inf),
    "encoded": (1, np.inf),
    "readings": (1, np.inf),
    "workers": (1, np.inf),
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

    workers: int = 1
    """Parts of each batch that are made and differentiated at the same time, one a
    core; with dropout and more than one, no two trainings are the same to the bit."""

    graph: GraphConfig = field(default_factory=GraphConfig)
    """How contacts become graphs."""

    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """How training windows vary."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    @property
    def graph_used(self) -> GraphConfig:
        """The graphs to train on: without shear, it touches no taxel either."""
        return self.graph if self.shear else self.graph.without_shear()

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)


SAVE_PERIOD = 30.0
"""Time between two writings of where training stands [s]."""

VALIDATION_WINDOWS = 256
"""Windows that validation looks at."""

MIN_LOG_PROBABILITY = -30.0
"""Stands for the log-probability of what cannot be."""

TEMPERATURES = np.geomspace(0.3, 5.0, 57)
"""The temperatures tried."""


class Trainer:
    """Trains one network on a data set."""

    def __init__(
        self,
        dataset: Dataset,
        vocabulary: tuple[str, ...],
        config: TrainConfig,
        recordings: list[int] | None = None,
        seed: int = 0,
        validation: Dataset | None = None,
        start: Model | None = None,
    ) -> None:
        """Prepare to train.

        Args:
            dataset: to train on.
            vocabulary: classes to tell apart.
            config: how.
            recordings: those of the data set to train on, all where None.
            seed: decides everything that is drawn.
            validation: to validate on; where None, some of the recordings are held out.
            start: whose weights to start from, wherever they fit.
        """
        self.config, self.vocabulary, self.seed = config, vocabulary, seed
        torch.manual_seed(seed)
        self.rngs = build_generators(seed, config.workers)
        chosen = list(range(dataset.own)) if recordings is None else recordings
        self.holdout = hold_out(
            find_sessions(dataset, chosen),
            find_gestures(dataset, vocabulary),
            0.0 if validation else config.validation,
            self.rngs[0],
        )
        self.shear = config.shear and dataset.has_shear
        self.graph = config.graph if self.shear else config.graph.without_shear()
        learned = dataset.with_copies(self.holdout.train)
        self.maker = self.build_batches(dataset, learned, config.augment)
        check_classes(self.maker.sampler, vocabulary)
        source, held = dataset, self.holdout.held
        if validation is not None:
            source = validation
            held = frozenset(range(len(validation.recordings)))
        self.held_recordings = held
        held_maker = self.build_batches(source, held, NO_AUGMENTATION)
        self.held = held_maker if held_maker.sampler.classes else None
        self.network = RecogniserNetwork(config.network, len(vocabulary), self.shear)
        if start is not None:
            copy_matching_weights(self.network, start)
        self.epochs = 0

    def build_batches(
        self, dataset: Dataset, recordings: frozenset[int], augment: AugmentConfig
    ) -> BatchBuilder:
        """Draws windows of some recordings."""
        slots = self.config.network.slots
        crop = self.config.augment.crop
        sampler = build_sampler(dataset, self.vocabulary, recordings, slots, crop)
        return BatchBuilder(dataset, sampler, augment, slots, self.shear)

    def run(
        self, quiet: bool = False, kept: Path | None = None, facts: str = ""
    ) -> RecogniserNetwork:
        """Train to the end or until validation no longer improves.

        Args:
            quiet: whether to show no progress.
            kept: file to go on from where training was cut; removed by the caller.
            facts: names data and settings in that file.
        """
        config, network = self.config, self.network
        torch.set_num_threads(1)
        first = self.maker.make(4 * config.batch, 1, 1, self.rngs[0])
        network.standardise_by(first.summary)
        optimiser = torch.optim.AdamW(network.parameters(), weight_decay=config.decay)
        total = config.epochs * config.steps
        cycle = torch.optim.lr_scheduler.OneCycleLR(
            optimiser, config.rate, total_steps=total
        )
        best = EarlyStopping(config.patience)
        course = TrainingState(network, optimiser, cycle, best, self.rngs)
        done = course.go_on(kept, facts) if kept else 0
        self.epochs = done // config.steps
        last = done if best.should_stop else total
        saved = time.monotonic()
        with (
            Progress(disable=quiet, transient=True) as progress,
            ThreadPoolExecutor(config.workers) as pool,
        ):
            task = progress.add_task("Training", total=total, completed=done)
            for step in range(done, last):
                network.train()
                self.step(optimiser, pool)
                cycle.step()
                progress.advance(task)
                self.epochs, within = divmod(step + 1, config.steps)
                over = within == 0 and self.is_over(best)
                if kept and (over or time.monotonic() - saved > SAVE_PERIOD):
                    course.keep(kept, facts, step + 1)
                    saved = time.monotonic()
                if over:
                    break
        best.restore(network)
        return network.eval()

    def is_over(self, best: EarlyStopping) -> bool:
        """Whether validation at the end of an epoch says so."""
        return self.held is not None and best.is_enough(
            self.network, self.validation_loss()
        )

    def step(self, optimiser: torch.optim.Optimizer, pool: ThreadPoolExecutor) -> None:
        """One step: every worker differentiates a part of the batch."""
        parameters = list(self.network.parameters())
        parts = list(pool.map(self.gradients, self.rngs))
        for parameter, *gradients in zip(parameters, *parts, strict=True):
            parameter.grad = torch.stack(gradients).mean(dim=0)
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimiser.step()

    def gradients(self, rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Gradients of one worker's part of a batch."""
        config, workers = self.config, self.config.workers
        batch = self.maker.make(
            -(-config.batch // workers),
            -(-config.encoded // workers),
            config.readings,
            rng,
        )
        return torch.autograd.grad(self.loss(batch), list(self.network.parameters()))

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

    def validation_loss(self) -> float:
        """Loss on windows of the recordings held out, always the same ones."""
        logits, labels = self.validation_logits()
        return float(cross_entropy(logits, labels))

    def validation_accuracy(self) -> float:
        """Share of what is held out that is recognised; NaN if nothing is."""
        if self.held is None:
            return float("nan")
        logits, labels = self.held_answers()
        return float((logits.argmax(dim=1) == labels).double().mean())

    def fit_temperature(self) -> float:
        """What to divide logits by for honest probabilities (Guo et al. 2017)."""
        if self.held is None:
            return 1.0
        logits, labels = self.held_answers()
        # Where nothing was felt `none` is certain, whatever the network thinks.
        felt = (logits > MIN_LOG_PROBABILITY).sum(dim=1) > 1
        if not felt.any():
            return 1.0
        logits, labels = logits[felt], labels[felt]
        losses = [float(cross_entropy(logits / t, labels)) for t in TEMPERATURES]
        return float(TEMPERATURES[int(np.argmin(losses))])

    def held_answers(
        self,
    ) -> tuple[Float[Tensor, "example class"], Int[Tensor, "example"]]:
        """Logits and classes of the clips held out, of windows where there are none."""
        assert self.held is not None
        if not any(self.held.dataset.clips):
            return self.validation_logits()
        self.network.eval()
        answers = predict_clips(
            *(self.network, self.held.dataset, self.vocabulary),
            recordings=self.held_recordings,
        )
        certain = np.maximum(answers.log_probabilities, MIN_LOG_PROBABILITY)
        return torch.as_tensor(certain), torch.as_tensor(answers.truth)

    def validation_logits(
        self,
    ) -> tuple[Float[Tensor, "window class"], Int[Tensor, "window"]]:
        """Logits and classes of windows of the recordings held out."""
        assert self.held is not None
        self.network.eval()
        every = self.config.network.slots
        batch = self.held.make(
            VALIDATION_WINDOWS, VALIDATION_WINDOWS, every, np.random.default_rng(0)
        )
        with torch.no_grad():
            return self.network(batch.some), batch.labels


def copy_matching_weights(network: RecogniserNetwork, model: Model) -> None:
    """Take a model's weights wherever the network has one of that name and shape."""
    own = network.state_dict()
    fitting = {
        name: torch.as_tensor(weight)
        for name, weight in model.weights.items()
        if name in own and own[name].shape == weight.shape
    }
    network.load_state_dict(own | fitting)


def build_generators(seed: int, workers: int) -> list[np.random.Generator]:
    """One generator a worker; with one worker, that of the seed itself."""
    first = np.random.default_rng(seed)
    return [first, *(np.random.default_rng([seed, n]) for n in range(1, workers))]
