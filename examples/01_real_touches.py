"""Recognise touches that real people made.

    python examples/01_real_touches.py --data SocialTouch

Plays the touches of a public set to the recogniser, one reading at a time, as live. Its
weights have learned from simulated people only. `make touches` runs it, in two minutes.
"""

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import eskin
from eskin.errors import EskinError
from eskin.sets import socialtouch as social
from eskin.skin import build_grid_skin
from eskin.touch import Calibration

HELP = """no recordings in {data}; get the files touch_*.csv of \
github.com/yliess86/SocialTouch and run: make touches SOCIALTOUCH=that/folder"""
BEFORE = 20  # scans at rest before a touch
AFTER = 10  # scans at rest after it
PERIOD = social.PERIOD_NS  # from one scan to the next [ns]


@dataclass(frozen=True)
class Demo:
    """Recognise touches that real people made."""

    data: Path
    """The SocialTouch recordings, as downloaded."""


def main(demo: Demo) -> None:
    """Replay touches that have a class of the weights, and count."""
    paths = sorted(demo.data.rglob("touch_*.csv*"))
    if not paths:
        raise EskinError(HELP.format(data=demo.data))
    touches = [touch for path in paths for touch in social.read_repetitions(path)]
    named = [(t, name) for t in touches if (name := social.classify_repetition(t))]
    skin = build_grid_skin(social.ROWS, social.COLUMNS, 0.004, calibrated=True)
    worn = eskin.MountedSkin(skin, eskin.load_robot("table"))
    calibration = Calibration.uniform(skin.count, social.FULL_SCALE, 40.0)
    model = eskin.load_model("ur5-sim")
    right = Counter()
    truths = Counter()
    for touch, truth in named:
        answer = recognise(eskin.Recognizer(model, worn, calibration), touch)
        print(f"  P{touch.person} {touch.gesture:27} {truth:10} taken for {answer}")
        right += Counter({truth: int(answer == truth)})
        truths[truth] += 1
    print("\nright:", ", ".join(f"{n} {right[n]} of {truths[n]}" for n in truths))
    count = len(named)
    often = truths.most_common(1)[0]
    print(
        f"{right.total() / count:.0%} of {count} touches; {1 / len(truths):.0%} by "
        f"chance, {often[1] / count:.0%} by always {often[0]}, "
        f"{count_nearest(named) / count:.0%} by duration, force and path"
    )


def recognise(recognizer: eskin.Recognizer, touch: social.Repetition) -> str:
    """Push every scan; return the last answer to the contact of largest impulse."""
    rows = np.pad(touch.counts, ((BEFORE, AFTER), (0, 0))).astype(np.int32)
    received = np.ones(rows.shape[1], bool)
    names = recognizer.model.card.vocabulary
    answers = {-1: "none"}
    impulses = {-1: 0.0}
    for number, row in enumerate(rows, 1):
        recognizer.push(eskin.Scan(number * PERIOD, row, received, np.empty(0)))
        assert (state := recognizer.state) is not None
        for each in state.open:
            answers[each.id] = names[recognizer.probabilities[each.id].argmax()]
        impulses |= {row.id: row.impulse for row in state.rows}
    return answers[max(answers, key=lambda id: impulses[id])]


def count_nearest(named: list[tuple[social.Repetition, str]]) -> int:
    """Count touches that are nearest to the mean of their class of other people."""
    grid = np.indices((social.ROWS, social.COLUMNS)).reshape(2, -1).T
    values = []
    right = 0
    for touch, _ in named:
        counts = touch.counts[touch.touched].astype(float)
        force = counts.sum(axis=1)
        middles = counts @ grid / force[:, None]
        path = np.linalg.norm(np.diff(middles, axis=0), axis=1).sum()
        values.append((np.ptp(touch.seconds[touch.touched]), force.max(), path))
    values = np.log1p(values) / np.maximum(np.log1p(values).std(axis=0), 1e-9)
    people, truths = np.array([(touch.person, truth) for touch, truth in named]).T
    for row, person, truth in zip(values, people, truths, strict=True):
        names = np.unique(truths[people != person])
        rows = [values[(people != person) & (truths == name)] for name in names]
        away = [np.linalg.norm(part.mean(axis=0) - row) for part in rows]
        right += bool(away) and names[np.argmin(away)] == truth
    return right


if __name__ == "__main__":
    try:
        main(tyro.cli(Demo))
    except EskinError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
