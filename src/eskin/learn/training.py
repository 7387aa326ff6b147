"""This module trains the recogniser on balanced windows and keeps the best epoch."""

import time
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from eskin.learn.batches import (
    Batch,
    BatchBuilder,
    build_sampler,
    check_classes,
)
from eskin.learn.checkpoint import EarlyStopping, TrainingState
from eskin.learn.config import NO_AUGMENTATION, AugmentConfig, TrainConfig
from eskin.learn.dataset import Dataset, find_gestures, find_sessions, hold_out
from eskin.learn.evaluation import predict_clips
from eskin.learn.last_layer import (
    compute_closed_touches,
    fit_closing_layer,
    fit_open_layer,
)
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.processes import ALONE, Processes
from eskin.live import (
    Model,
)
from eskin.live.model_file import OPEN_LAYER
from eskin.progress import show_progress

SAVE_PERIOD = 30.0  # [s] between two checkpoints
VALIDATION_WINDOWS = 256
MIN_LOG_PROBABILITY = -30.0  # in place of minus infinity
TEMPERATURES = np.geomspace(0.3, 5.0, 57).tolist()  # candidates


class Trainer:
    """A trainer trains one network on a data set."""

    def __init__(
        self,
        dataset: Dataset,
        vocabulary: tuple[str, ...],
        config: TrainConfig,
        recordings: list[int] | None = None,
        seed: int = 0,
        validation: Dataset | None = None,
        start: Model | None = None,
        processes: Processes = ALONE,
    ) -> None:
        """Prepare to train.

        Args:
            dataset: data set to train on.
            vocabulary: classes to recognise.
            config: settings of the training.
            recordings: indices of the recordings to train on; all where None.
            seed: seed of all random draws.
            validation: data set to validate on; where None, recordings are held out.
            start: model to start from, by its weights of matching names and shapes, and
                the scale of its inputs; the last layers only with the same vocabulary.
            processes: processes that train together, each by `config.workers` threads.
        """
        self.config = config
        self.vocabulary = vocabulary
        self.seed = seed
        self.processes = processes
        torch.manual_seed(seed)
        rngs = build_generators(seed, config.workers * processes.count)
        first = processes.rank * config.workers
        self.rngs = rngs[first : first + config.workers]
        self.shear = config.shear and dataset.has_shear
        if recordings is None:
            recordings = list(range(dataset.original_count))
        self.holdout = hold_out(
            find_sessions(dataset, recordings),
            find_gestures(dataset, vocabulary),
            0.0 if validation else config.validation,
            rngs[0],
        )
        trained = dataset.with_copies(self.holdout.train)
        self.batches = self.build_batches(dataset, trained, config.augment)
        check_classes(self.batches.sampler, vocabulary)
        self.held_recordings = self.holdout.held
        if validation is not None:
            self.held_recordings = frozenset(range(len(validation.recordings)))
        held_out = self.build_batches(
            validation or dataset, self.held_recordings, NO_AUGMENTATION
        )
        self.held_out = held_out if held_out.sampler.classes else None
        self.network = RecogniserNetwork(config.network, len(vocabulary), self.shear)
        taken = start and copy_matching_weights(self.network, start, vocabulary)
        self.keeps_scale = "summary_mean" in (taken or ())
        self.epochs = 0
        self.stopped = False

    def build_batches(
        self, dataset: Dataset, recordings: frozenset[int], augment: AugmentConfig
    ) -> BatchBuilder:
        """Return a batch builder for some of the recordings."""
        slots = self.config.network.slots
        crop = self.config.augment.crop
        sampler = build_sampler(
            dataset, self.vocabulary, recordings, slots, crop, self.config.shares
        )
        return BatchBuilder(dataset, sampler, augment, slots, self.shear)

    def run(
        self, quiet: bool = False, checkpoint: Path | None = None, facts: str = ""
    ) -> RecogniserNetwork:
        """Train to the end, or until validation no longer improves.

        Args:
            quiet: whether to hide the progress bar.
            checkpoint: file that interrupted training is resumed from; the caller
                removes it.
            facts: description of data and settings, stored in that file.
        """
        config = self.config
        network = self.network
        processes = self.processes
        torch.set_num_threads(1)
        if processes.is_first:
            first = self.batches.build(4 * config.batch, 1, 1, self.rngs[0])
            if not self.keeps_scale:
                network.fit_summary(first.summary)
        else:
            torch.manual_seed(self.seed + processes.rank)
        processes.copy_network(network)
        optimiser = torch.optim.AdamW(network.parameters(), weight_decay=config.decay)
        total = config.epochs * config.steps
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimiser, config.rate, total_steps=total
        )
        best = EarlyStopping(config.patience)
        state = TrainingState(network, optimiser, schedule, best, self.rngs, processes)
        done = state.resume(checkpoint, facts) if checkpoint else 0
        self.epochs = done // config.steps
        last = done if best.should_stop else total
        saved = time.monotonic()
        with (
            show_progress(
                "steps of training", total, done, quiet or not processes.is_first
            ) as update,
            ThreadPoolExecutor(config.workers) as pool,
        ):
            try:
                for step in range(done, last):
                    network.train()
                    self.step(optimiser, pool)
                    schedule.step()
                    update(step + 1)
                    self.epochs, within = divmod(step + 1, config.steps)
                    stop = False
                    if within == 0 and self.held_out is not None:
                        loss = self.validation_loss() if processes.is_first else 0.0
                        stop = best.update(network, processes.broadcast(loss))
                    is_due = stop or time.monotonic() - saved > SAVE_PERIOD
                    if checkpoint and processes.broadcast(is_due):
                        state.save(checkpoint, facts, step + 1)
                        saved = time.monotonic()
                    if stop:
                        break
            except KeyboardInterrupt:
                # What is known so far is kept, from the first whole epoch on.
                if self.epochs <= done // config.steps or processes.count > 1:
                    raise
                self.stopped = True
        best.restore(network)
        if config.ridge and processes.is_first and not self.stopped:
            self.fit_last_layers()
        return network.eval()

    def fit_last_layers(self) -> None:
        """Fit the open layer, then the closing layer, each where it lowers the loss.

        The loss is that of held-out recordings at the best temperature; without any,
        both layers are fitted.
        """
        try:
            self.fit_open_layer()
            self.fit_closing_layer()
        except KeyboardInterrupt:
            self.stopped = True

    def fit_open_layer(self) -> None:
        """Fit the open layer, unless the validation loss is not lower with it."""
        trained = deepcopy(self.network.state_dict())
        has_held_out = self.held_out is not None
        loss = self.calibrated_loss() if has_held_out else 0.0
        plain = replace(self.batches, config=NO_AUGMENTATION)
        config = self.config
        kept = False
        try:
            fit_open_layer(
                self.network,
                plain,
                config.epochs * config.steps * config.batch,
                config.readings,
                config.ridge,
                self.rngs[0],
            )
            kept = not has_held_out or self.calibrated_loss() < loss
        finally:
            if not kept:
                self.network.load_state_dict(trained)

    def fit_closing_layer(self) -> None:
        """Fit the closing layer, unless the loss of held-out touches is not lower."""
        sampler = self.batches.sampler
        has_held_out = self.held_out is not None
        kept = False
        try:
            fit_closing_layer(self.network, sampler, self.config.ridge, self.rngs[0])
            if has_held_out:
                opened, closed = self.closing_losses()
                kept = closed < opened
            else:
                kept = True
        finally:
            if not kept:
                self.network.remove_closing_layer()

    def step(self, optimiser: torch.optim.Optimizer, pool: ThreadPoolExecutor) -> None:
        """Take a step by the mean gradient of the parts of a batch of all workers."""
        parameters = list(self.network.parameters())
        parts = list(pool.map(self.compute_gradients, self.rngs))
        means = [torch.stack(each).mean(dim=0) for each in zip(*parts, strict=True)]
        averages = self.processes.average(means)
        for parameter, gradient in zip(parameters, averages, strict=True):
            parameter.grad = gradient
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimiser.step()

    def compute_gradients(self, rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Return the gradients of one worker's part of a batch."""
        config = self.config
        workers = self.config.workers * self.processes.count
        batch = self.batches.build(
            -(-config.batch // workers),
            -(-config.encoded // workers),
            config.readings,
            rng,
        )
        return torch.autograd.grad(
            self.compute_loss(batch), list(self.network.parameters())
        )

    def compute_loss(self, batch: Batch) -> Float[Tensor, ""]:
        """Return the cross entropy of both branches together, plus the mean of each's.

        Without a graph branch it is that of the summary branch.
        """
        network = self.network

        def loss(logits: Float[Tensor, "window class"]) -> Float[Tensor, ""]:
            labels = batch.labels[: len(logits)]
            smoothing = self.config.smoothing
            return cross_entropy(logits, labels, label_smoothing=smoothing)

        standardised = network.standardise(batch.summary)
        by_summary = network.summary_branch(standardised, batch.slot_index)
        if not network.config.width:
            return loss(by_summary)
        embedded = network.embed(batch.encoded.graphs)
        by_graph = network.graph_branch(embedded, batch.encoded.slot_index)
        both = (by_summary[: len(by_graph)] + by_graph) / 2
        return loss(both) + (loss(by_summary) + loss(by_graph)) / 2

    def validation_loss(self) -> float:
        """Return the loss on windows of the held-out recordings, always the same."""
        logits, labels = self.predict_validation_windows()
        return float(cross_entropy(logits, labels))

    def calibrated_loss(self) -> float:
        """Return the validation loss at the best temperature."""
        return find_temperature(*self.predict_validation_windows())[0]

    def closing_losses(self) -> tuple[float, float]:
        """Return the losses of held-out touches at closing, by open and closing layer.

        Each is at its best temperature.
        """
        assert self.held_out is not None
        rng = np.random.default_rng(0)
        x, labels, _ = compute_closed_touches(self.network, self.held_out.sampler, rng)
        with torch.no_grad():
            opened = self.network.classify_statistics(x.float())
            closed = self.network.classify_statistics(x.float(), closing=True)
        return find_temperature(opened, labels)[0], find_temperature(closed, labels)[0]

    def score_held_out(self) -> tuple[float, float]:
        """Return the accuracy on held-out recordings, and the best temperature.

        The temperature calibrates the logits (Guo et al. 2017). Without such recordings
        these are NaN and 1.
        """
        if self.held_out is None:
            return float("nan"), 1.0
        logits, labels = self.predict_held_out()
        accuracy = float((logits.argmax(dim=1) == labels).double().mean())
        # Clips without a detected touch are `none` whatever the temperature.
        touched = (logits > MIN_LOG_PROBABILITY).sum(dim=1) > 1
        if not touched.any():
            return accuracy, 1.0
        return accuracy, find_temperature(logits[touched], labels[touched])[1]

    def predict_held_out(
        self,
    ) -> tuple[Float[Tensor, "example class"], Int[Tensor, "example"]]:
        """Return logits and classes of held-out clips, or of windows without clips."""
        assert self.held_out is not None
        if not any(self.held_out.dataset.clips):
            return self.predict_validation_windows()
        self.network.eval()
        dataset = self.held_out.dataset
        held = self.held_recordings
        found = predict_clips(self.network, dataset, self.vocabulary, recordings=held)
        logits = np.maximum(found.log_probabilities, MIN_LOG_PROBABILITY)
        return torch.as_tensor(logits), torch.as_tensor(found.truth)

    def predict_validation_windows(
        self,
    ) -> tuple[Float[Tensor, "window class"], Int[Tensor, "window"]]:
        """Return logits and classes of windows of the held-out recordings."""
        self.network.eval()
        with torch.no_grad():
            logits = self.network(self.validation_batch.encoded)
        return logits, self.validation_batch.labels

    @cached_property
    def validation_batch(self) -> Batch:
        """Windows of the held-out recordings, which are always the same."""
        assert self.held_out is not None
        count = VALIDATION_WINDOWS
        readings = self.config.network.slots
        return self.held_out.build(count, count, readings, np.random.default_rng(0))


def find_temperature(
    logits: Float[Tensor, "example class"], labels: Int[Tensor, "example"]
) -> tuple[float, float]:
    """Return the lowest loss of logits over a temperature, and that temperature."""
    return min((float(cross_entropy(logits / t, labels)), t) for t in TEMPERATURES)


def copy_matching_weights(
    network: RecogniserNetwork, model: Model, vocabulary: tuple[str, ...]
) -> frozenset[str]:
    """Copy those weights of a model that the network has by name and shape.

    Weights of the classes are not copied unless the vocabularies are equal, since they
    would belong to other classes. The closing layer is never copied: it is fitted anew.

    Args:
        network: network that is changed.
        model: model whose weights are copied.
        vocabulary: classes of the network.

    Returns:
        The names of the weights that were copied.
    """
    own = network.state_dict()
    same = model.card.vocabulary == vocabulary
    fitting = {
        name: torch.as_tensor(weight)
        for name, weight in model.weights.items()
        if name in own and own[name].shape == weight.shape
        if same or f".{OPEN_LAYER}." not in name
    }
    network.load_state_dict(own | fitting)
    return frozenset(fitting)


def build_generators(seed: int, workers: int) -> list[np.random.Generator]:
    """Return one generator for each worker; the first is seeded by the seed itself."""
    first = np.random.default_rng(seed)
    return [first, *(np.random.default_rng([seed, n]) for n in range(1, workers))]
