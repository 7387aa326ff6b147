"""Recognise touches that real people made.

    python examples/01_real_touches.py --data Annotated-dataset

Converts the public sleeve recordings, trains on all sessions but the last, then replays
that session one reading at a time, as live, and prints what is recognised beside what
was done. `make touches` runs it, in a minute or two.
"""

import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import eskin
from eskin.errors import EskinError
from eskin.learn.checkpoint import to_model
from eskin.learn.dataset import prepare
from eskin.learn.sets import convert_sleeve
from eskin.learn.training import TrainConfig, Trainer
from eskin.recording import find_recordings, label_instants

HELP = """no recordings in {data}; get the folder Annotated-dataset of \
github.com/mdethmers/Social-Touch-Research and run: make touches DATA=that/folder"""


@dataclass(frozen=True)
class Demo:
    """Recognise touches that real people made."""

    data: Path
    """The public sleeve recordings, as downloaded."""

    train: TrainConfig = TrainConfig(encoded=8, readings=12, validation=0.0)
    """Encodes few graphs, which is quick; `eskin train` gets a little further."""


def main(demo: Demo) -> None:
    """Convert, train, replay, count."""
    if not any(demo.data.rglob("*.json*")):
        raise EskinError(HELP.format(data=demo.data))
    with tempfile.TemporaryDirectory() as folder:
        done = convert_sleeve(demo.data, Path(folder))
        print(f"{done.recordings} recordings, {done.labels} labelled touches")
        paths = find_recordings((Path(folder),))
        sessions = {p: eskin.read_recording(p).metadata.session for p in paths}
        held = max(sessions.values())
        model = train([p for p in paths if sessions[p] != held], demo.train)
        counts = Counter()
        for path in (p for p in paths if sessions[p] == held):
            counts += replay(model, eskin.read_recording(path))
    chance = counts["detections"] / (len(model.card.vocabulary) - 1)
    print(
        f"\nSession {held}, never trained on: {counts['labels']} touches, "
        f"{counts['detections']} found, {counts['right']} right, {chance:.0f} by chance"
    )


def train(paths: list[Path], config: TrainConfig) -> eskin.Model:
    """Train a recogniser."""
    print(f"training on {len(paths)} recordings ...")
    dataset = prepare(paths)
    network = Trainer(dataset, dataset.vocabulary, config).run()
    card = eskin.ModelCard(vocabulary=dataset.vocabulary, network=config.network)
    return to_model(network, card)


def replay(model: eskin.Model, recording: eskin.Recording) -> Counter[str]:
    """Push every scan and print each detection beside the label at its time."""
    mounted = eskin.MountedSkin(recording.skin, eskin.load_robot(recording.robot_name))
    decision = eskin.DecisionConfig(threshold=0.35)
    recognizer = eskin.Recognizer(model, mounted, recording.calibration, decision)
    detections = [d for scan in recording.scans() for d in recognizer.push(scan)]
    counts = Counter(labels=len(recording.labels))
    print(f"\n{recording.path.stem}")
    for found in (d for d in detections + recognizer.finish() if d.gesture != "none"):
        seconds = (found.stamp - recording.start) * 1e-9
        truth = label_at(recording, found.stamp)
        sure = f"{found.confidence:.0%} sure"
        print(f"  {seconds:6.1f} s  {found.gesture:8} {sure:9} label: {truth}")
        counts += Counter(detections=1, right=int(truth == found.gesture))
    return counts


def label_at(recording: eskin.Recording, stamp: int) -> str:
    """The gesture that was made at a stamp."""
    names = ["none", *sorted({label.gesture for label in recording.labels})]
    return names[label_instants(recording.labels, np.array([stamp]), names)[0]]


if __name__ == "__main__":
    try:
        main(tyro.cli(Demo))
    except EskinError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
