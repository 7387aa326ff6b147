"""These helpers simulate moving hands on skins, and build models of random weights."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch

from eskin.learn.nn import RecogniserNetwork
from eskin.live import Model, ModelCard, NetworkConfig, Recognizer
from eskin.recording import Label, Metadata, RecordingWriter, write_all
from eskin.robot import load_robot
from eskin.skin import MountedSkin, Skin, build_grid_skin, load_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
VOCABULARY = ("none", "poke", "stroke", "grab")


@cache
def mounted(name="grid", calibrated=True, kind="pressure") -> MountedSkin:
    if name == "ur5":
        return MountedSkin(load_skin("ur5"), load_robot("ur5"))
    skin = build_grid_skin(8, 30, kind=kind, calibrated=calibrated)
    return MountedSkin(skin, load_robot("table"))


def calibration_of(skin: Skin) -> Calibration:
    """Return a calibration by which one count is 0.1 kPa, of pressure and of shear."""
    gain = np.full(skin.count, 0.1)
    return Calibration(gain, 4000, shear_gain=0.1, shear_rest=500)


@dataclass(frozen=True)
class Press:
    """A round load moves from one taxel to another of its link."""

    begin: float
    end: float
    source: int
    target: int
    kpa: float = 30.0
    radius: float = 0.02

    def pressure(self, skin: Skin, seconds: float) -> np.ndarray:
        if not self.begin <= seconds < self.end:
            return np.zeros(skin.count)
        part = (seconds - self.begin) / (self.end - self.begin)
        a = skin.positions[self.source]
        b = skin.positions[self.target]
        distance = np.linalg.norm(skin.positions - (a + part * (b - a)), axis=1)
        links = np.array(skin.link_names)[skin.patch_index]
        shape = np.maximum(1 - (distance / self.radius) ** 2, 0)
        swell = 0.5 + np.sin(np.pi * part)
        return self.kpa * swell * shape * (links == links[self.source])


def scans(mounted, presses, rate, seconds, dropped=(), moving=True):
    """Return the scans of some presses without those whose index is `dropped`."""
    rng = np.random.default_rng(0)
    skin = mounted.skin
    joints = len(mounted.robot.joint_names)
    result = []
    for index in range(round(seconds * rate)):
        t = index / rate
        pressure = np.zeros(skin.count)
        for press in presses:
            pressure += press.pressure(skin, t)
        counts = np.rint(10 * pressure + rng.normal(20, 1, skin.count))
        shear = None
        if skin.has_shear:
            drag = np.stack([pressure * np.sin(t), 0.5 * pressure], axis=1)
            shear = np.rint(500 + 3 * drag).astype(np.int32)
        q = 0.3 * np.sin(t * np.arange(1, joints + 1)) * moving
        if index not in dropped:
            received = np.ones(skin.count, bool)
            stamp = START + round(t * SECOND)
            result.append(Scan(stamp, counts.astype(np.int32), received, q, shear))
    return result


def two_hands(mounted):
    """Return a stroke and a poke at once, then a poke beside each of them."""
    count = mounted.skin.count
    a = 65
    b = 72
    c = count - 3
    d = count - 4
    if mounted.robot.name == "ur5":
        patches = [patch.id for patch in mounted.skin.patches]
        arm = mounted.skin.find_taxels(patches[0])
        hand = mounted.skin.find_taxels(patches[-1])
        a = arm[10]
        b = arm[len(arm) // 2]
        c = hand[3]
        d = hand[8]
    return [
        Press(2.3, 3.2, a, b),
        Press(2.6, 2.9, c, c, 40.0),
        Press(3.1, 3.3, d, d, 25.0),
        Press(4.2, 4.5, b, b, 25.0),
    ]


def with_closing_layer(model: Model, change: float = 0.0) -> Model:
    """Return a model with a closing layer, whose weights differ by noise of a size."""
    rng = np.random.default_rng(1)
    weights = dict(model.weights)
    for name, weight in model.weights.items():
        if ".classify." in name:
            noise = change * rng.standard_normal(weight.shape)
            weights[name.replace("classify", "close")] = (weight + noise).astype(
                np.float32
            )
    return replace(model, weights=weights)


def list_faulty_scans():
    """Return scans of two hands on the grid, one taxel of which becomes stuck."""
    found = scans(mounted(), two_hands(mounted()), 50, 6.0)
    for scan in found[25:]:
        scan.counts[100] = 900
    return found


def replay(recording):
    """Yield the readings of a recording as a recogniser sees them."""
    on_robot = MountedSkin(recording.skin, recording.load_robot())
    recognizer = Recognizer(say_always("poke"), on_robot, recording.calibration)
    for scan in recording.scans():
        recognizer.push(scan)
        yield recognizer.state.reading


def network(kind="pressure", seed=0, vocabulary=VOCABULARY, **sizes):
    """Build a network of random weights whose logits are of order one to ten."""
    torch.manual_seed(seed)
    config = NetworkConfig(**sizes)
    net = RecogniserNetwork(config, len(vocabulary), kind == "shear").eval()
    with torch.no_grad():
        for parameter in net.parameters():
            parameter += 0.1 * torch.randn_like(parameter)
        for name, parameter in net.named_parameters():
            if name.endswith("head.classify.weight"):
                parameter *= 3
        net.summary_mean.normal_(0.5, 0.3)
        net.summary_scale.uniform_(0.5, 2.0)
    return net


def model_of(net, vocabulary=VOCABULARY, **entries) -> Model:
    weights = {name: w.numpy() for name, w in net.state_dict().items()}
    kind = "shear" if net.shear else "pressure"
    card = ModelCard(vocabulary, kind=kind, network=net.config, **entries)
    return Model(weights, card)


def say_always(name) -> Model:
    """Build a model that is certain of one class whatever the input."""
    model = model_of(network())
    weights = dict(model.weights)
    for head in ("summary_head", "graph_head"):
        weights[f"{head}.classify.weight"] = 0 * weights[f"{head}.classify.weight"]
        bias = np.where(np.array(VOCABULARY) == name, 9.0, 0.0)
        weights[f"{head}.classify.bias"] = bias.astype(np.float32)
    return Model(weights, model.card)


def record(path, mounted, stream, labels=()):
    """Write a recording of scans."""
    metadata = Metadata(dataset="scene", session="one")
    skin = mounted.skin
    calibration = calibration_of(mounted.skin)
    writer = RecordingWriter(path, mounted.robot.name, skin, calibration, metadata)
    with writer:
        write_all(writer, stream, labels)
    return path


def label(begin, end, gesture):
    return Label(START + round(begin * SECOND), START + round(end * SECOND), gesture)
