"""This module trains baselines that are networks, and streams readings to them."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import cross_entropy
from torch.optim.lr_scheduler import ConstantLR, OneCycleLR

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
    """Number of passes over the windows."""
    batch: int = 16
    """Windows in a step."""
    rate: float = 2e-3
    """Learning rate of Adam, or the highest of the cycle."""
    schedule: Schedule = "one-cycle"
    """Schedule of the learning rate."""


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
    """A network baseline classifies windows with a network."""

    def __init__(self, mounted: MountedSkin, config: FitConfig | None = None) -> None:
        """Create an untrained baseline for a skin on its robot."""
        super().__init__(mounted)
        self.config = config or FitConfig()
        self.network: WindowNetwork | None = None

    @abstractmethod
    def build(self) -> WindowNetwork:
        """Return a network of `classes` classes with random weights."""

    def fit_windows(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Fit windows that have been checked."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = self.build().train()
            config = self.config
            adam = torch.optim.Adam(network.parameters(), config.rate)
            steps = config.epochs * -(-clips.count // config.batch)
            if config.schedule == "one-cycle":
                schedule = OneCycleLR(adam, config.rate, total_steps=steps)
            else:
                schedule = ConstantLR(adam, factor=1.0)
            truth = torch.from_numpy(labels.astype(np.int64))
            for _ in range(config.epochs):
                for chosen in torch.randperm(clips.count).split(config.batch):
                    rows = chosen.numpy()
                    logits = network(*to_tensors(clips.pressure[rows], clips.q[rows]))
                    adam.zero_grad()
                    cross_entropy(logits, truth[chosen]).backward()
                    adam.step()
                    schedule.step()
        self.network = network.eval()

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


def to_tensors(pressure: np.ndarray, q: np.ndarray) -> tuple[Tensor, Tensor]:
    """Return both as tensors of float32."""
    arrays = (np.ascontiguousarray(each, np.float32) for each in (pressure, q))
    first, second = map(torch.from_numpy, arrays)
    return first, second


def use_one_thread() -> None:
    """Make torch compute in one thread."""
    torch.set_num_threads(1)
