"""This module trains baselines that are networks, and streams readings to them."""

from abc import abstractmethod
from copy import deepcopy
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import cross_entropy
from torch.optim.lr_scheduler import ConstantLR, OneCycleLR

from eskin.learn.config import AugmentConfig
from eskin.skin import MountedSkin
from lab.baselines.interface import (
    Baseline,
    BaselineStream,
    Labels,
    Probabilities,
    RollingWindow,
    SkinWindows,
    WindowStream,
)

Schedule = Literal["one-cycle", "constant"]


@dataclass(frozen=True)
class FitConfig:
    """These settings determine how a network is trained."""

    epochs: int = 40
    """Largest number of epochs."""
    drawn: int | None = None
    """Most windows of an epoch, which are drawn at random; None takes all."""
    batch: int = 16
    """Windows in a step."""
    rate: float = 2e-3
    """Learning rate of Adam at the start, or the highest of the cycle."""
    schedule: Schedule = "one-cycle"
    """Schedule of the learning rate."""
    held_out: float = 0.0
    """Share of the windows held out to choose the epoch; 0 trains to the end."""
    patience: int = 10
    """Epochs without a better accuracy on these after which training ends."""
    augment: AugmentConfig | None = None
    """Limits of the augmentation; None takes windows as they were recorded."""


MOST_HELD = 250
"""Most windows that the epoch is chosen by, which are classified after each."""
SCORED_AT_ONCE = 16
"""Windows that are classified together to choose the epoch."""


class WindowNetwork(nn.Module):
    """A window network maps windows to logits."""

    @abstractmethod
    def forward(
        self, pressure: Float[Tensor, "clip 100 taxel"], q: Float[Tensor, "clip 100 j"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of each window."""


class ReadingNetwork(WindowNetwork):
    """A reading network encodes each reading alone, then classifies the window."""

    @abstractmethod
    def encode(
        self, pressure: Float[Tensor, "reading taxel"], q: Float[Tensor, "reading j"]
    ) -> Float[Tensor, "reading feature"]:
        """Return the features of each reading."""

    @abstractmethod
    def classify(
        self, features: Float[Tensor, "clip 100 feature"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of each window."""

    def forward(
        self, pressure: Float[Tensor, "clip 100 taxel"], q: Float[Tensor, "clip 100 j"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of each window."""
        features = self.encode(pressure.flatten(0, 1), q.flatten(0, 1))
        return self.classify(features.unflatten(0, pressure.shape[:2]))


class NetworkBaseline(Baseline):
    """A network baseline classifies windows with a network.

    Attributes:
        history: accuracy and negative loss of each epoch on the windows held out.
    """

    def __init__(self, mounted: MountedSkin, config: FitConfig | None = None) -> None:
        """Create an untrained baseline for a skin on its robot."""
        super().__init__(mounted)
        self.config = config or FitConfig()
        self.network: WindowNetwork | None = None
        self.history: list[tuple[float, float]] = []

    @abstractmethod
    def build(self) -> WindowNetwork:
        """Return a network of `classes` classes with random weights."""

    def fit_windows(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Fit windows that have been checked."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network = self.build()
            rng = np.random.default_rng(seed)
            own, held = hold_windows_out(clips, self.config.held_out, rng)
            self.train_network(self.network, clips, labels, own, held, rng)
        self.network.eval()

    def train_network(
        self,
        network: WindowNetwork,
        clips: SkinWindows,
        labels: Labels,
        own: Int[np.ndarray, "own"],
        held: Int[np.ndarray, "held"],
        rng: np.random.Generator,
    ) -> None:
        """Train on some windows; keep the weights of the epoch that is best on others.

        Args:
            network: network to train.
            clips: all windows.
            labels: class of each.
            own: windows to train on.
            held: windows to choose the epoch by; none trains to the end.
            rng: random generator of the augmentation.
        """
        config = self.config
        adam = torch.optim.Adam(network.parameters(), config.rate)
        drawn = min(len(own), config.drawn or len(own))
        steps = config.epochs * -(-drawn // config.batch)
        if config.schedule == "one-cycle":
            schedule = OneCycleLR(adam, config.rate, total_steps=steps)
        else:
            schedule = ConstantLR(adam, factor=1.0)
        truth = torch.from_numpy(labels.astype(np.int64))
        self.history = []
        best = (-1.0, 0.0)
        best_epoch = 0
        kept = network.state_dict()
        for epoch in range(config.epochs):
            network.train()
            for chosen in torch.randperm(len(own))[:drawn].split(config.batch):
                rows = own[chosen.numpy()]
                pressure = clips.pressure[rows]
                if config.augment is not None:
                    pressure = augment_windows(pressure, config.augment, rng)
                logits = network(*to_tensors(pressure, clips.q[rows]))
                adam.zero_grad()
                cross_entropy(logits, truth[rows]).backward()
                adam.step()
                schedule.step()
            if len(held) == 0:
                continue
            score = score_windows(network.eval(), clips, truth, held)
            self.history.append(score)
            if score > best:
                best = score
                best_epoch = epoch
                kept = deepcopy(network.state_dict())
            if epoch - best_epoch >= config.patience:
                break
        if len(held):
            network.load_state_dict(kept)

    def predict_windows(self, clips: SkinWindows) -> Probabilities:
        """Classify windows that have been checked."""
        assert self.network is not None
        pairs = zip(clips.pressure, clips.q, strict=True)
        with torch.inference_mode():
            logits = [self.network(*to_tensors(p[None], q[None])) for p, q in pairs]
            return torch.cat(logits).softmax(dim=1).numpy()

    def build_streams(self) -> dict[str, BaselineStream]:
        """Return streams that encode whole windows or, if possible, one reading."""
        streams: dict[str, BaselineStream] = {"": WindowStream(self)}
        if isinstance(self.network, ReadingNetwork):
            streams["cached"] = CachedStream(self.mounted, self.network)
        return streams


@final
class CachedStream(BaselineStream):
    """A cached stream encodes the newest reading and keeps earlier features."""

    def __init__(self, mounted: MountedSkin, network: ReadingNetwork) -> None:
        """Start with a window without touch."""
        self.network = network
        pressure = np.zeros((1, mounted.skin.count), np.float32)
        q = np.zeros((1, len(mounted.robot.joint_names)))
        with torch.inference_mode():
            feature = network.encode(*to_tensors(pressure, q)).numpy()[0]
        self.window = RollingWindow(feature.shape)
        self.window.buffer[:] = feature

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Return the probabilities of the window that ends with this reading."""
        with torch.inference_mode():
            feature = self.network.encode(*to_tensors(pressure[None], q[None]))
            window = torch.from_numpy(self.window.push(feature.numpy()[0]))
            return self.network.classify(window[None]).softmax(dim=1).numpy()[0]


def hold_windows_out(
    clips: SkinWindows, share: float, rng: np.random.Generator
) -> tuple[Int[np.ndarray, "own"], Int[np.ndarray, "held"]]:
    """Return windows to train on, and some of a share of the examples held out.

    All windows of an example are on one side, since they overlap.
    """
    numbers = clips.example
    if numbers is None:
        numbers = np.arange(clips.count)
    examples = rng.permutation(np.unique(numbers))
    out = np.isin(numbers, examples[: round(share * len(examples))])
    held = rng.permutation(np.flatnonzero(out))
    return np.flatnonzero(~out), held[:MOST_HELD]


def score_windows(
    network: WindowNetwork,
    clips: SkinWindows,
    truth: Int[Tensor, "clip"],
    held: Int[np.ndarray, "held"],
) -> tuple[float, float]:
    """Return accuracy and negative mean loss on some windows."""
    found = []
    with torch.inference_mode():
        for rows in np.array_split(held, -(-len(held) // SCORED_AT_ONCE)):
            found.append(network(*to_tensors(clips.pressure[rows], clips.q[rows])))
        logits = torch.cat(found)
        right = (logits.argmax(dim=1) == truth[held]).double().mean()
        return float(right), -float(cross_entropy(logits, truth[held]))


def augment_windows(
    pressure: Float[np.ndarray, "clip 100 taxel"],
    config: AugmentConfig,
    rng: np.random.Generator,
) -> Float[np.ndarray, "clip 100 taxel"]:
    """Return windows of other people and sensors, as the recogniser's are augmented.

    The force of a person, the gain of each taxel, an offset and dead taxels are drawn
    as there. A window is moved in time by up to half of its length, so that a touch may
    end at any of its readings; what is moved in is without touch.
    """
    clips, readings, taxels = pressure.shape
    gains = np.exp(config.gain * rng.standard_normal((clips, 1)))
    gains = gains * np.exp(config.taxel_gain * rng.standard_normal((clips, taxels)))
    dead = rng.random((clips, 1)) * config.dead
    gains = np.where(rng.random((clips, taxels)) < dead, 0.0, gains)
    offsets = rng.random((clips, 1, 1)) * config.offset
    moved = np.zeros(pressure.shape, np.float32)
    for clip, shift in enumerate(rng.integers(-readings // 2, readings // 2, clips)):
        source = slice(max(0, -shift), min(readings, readings - shift))
        target = slice(max(0, shift), min(readings, readings + shift))
        moved[clip, target] = pressure[clip, source]
    scaled = moved * gains[:, None].astype(np.float32) - offsets.astype(np.float32)
    return np.maximum(scaled, 0.0)


def to_tensors(pressure: np.ndarray, q: np.ndarray) -> tuple[Tensor, Tensor]:
    """Return both as tensors of float32."""
    arrays = (np.ascontiguousarray(each, np.float32) for each in (pressure, q))
    first, second = map(torch.from_numpy, arrays)
    return first, second


def use_one_thread() -> None:
    """Make torch compute in one thread."""
    torch.set_num_threads(1)
