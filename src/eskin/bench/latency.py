"""What one step of the engine costs, and one of every baseline, in one run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eskin.bench.clips import random_clips
from eskin.bench.scene import (
    Scene,
    large_skin,
    on_forearm,
    on_upper_arm,
    round_forearm,
)
from eskin.bench.timing import (
    EngineSubject,
    Row,
    StreamSubject,
    Subject,
    row_of,
    time_together,
)
from eskin.learn.baselines import NETWORKS, FitConfig, SkinWindows, make_baseline
from eskin.robot import load_robot
from eskin.skin import MountedSkin

FEW, GRAB = 20, 83
"""Active taxels of a light touch and of a full grab."""

NETWORK_CLIPS = 20
"""A network is fitted on so many: its step takes as long whatever its weights are."""


@dataclass(frozen=True)
class LatencyConfig:
    """What is timed, and how often."""

    active: int = 60
    """Active taxels of the contact that all are timed on."""

    taxels: int = 2112
    """Of the skin: 2112 is the ur5 skin, more are the same with skin around it."""

    steps: int = 5000
    """Steps timed of the engine in each scene, and at most of each baseline."""

    clips: int = 581
    """Random clips that the baselines are fitted on; the paper had 581."""

    def __post_init__(self) -> None:
        """Refuse what cannot be timed."""
        if self.steps < 10:
            raise ValueError(
                f"--steps is {self.steps}; allowed are 10 and above; change it"
            )
        if self.clips < NETWORK_CLIPS:
            raise ValueError(
                f"--clips is {self.clips}; allowed are {NETWORK_CLIPS} and above; "
                "change it"
            )


def latency(config: LatencyConfig, baselines: Sequence[str]) -> list[Row]:
    """Time the engine on several scenes, and baselines on the first of them.

    Args:
        config: what is timed, and how often.
        baselines: their names.
    """
    mounted = MountedSkin(large_skin(config.taxels), load_robot("ur5"))
    subjects = engine_subjects(mounted, config.active)
    subjects += baseline_subjects(mounted, config, baselines)
    times = time_together(subjects, config.steps)
    unit = float(np.median(times[0]))
    return [row_of(s, t, unit) for s, t in zip(subjects, times, strict=True)]


def scaled(taxels: Sequence[int], active: Sequence[int], steps: int) -> list[Row]:
    """Time the engine alone on skins and contacts of several sizes, all in turn.

    Args:
        taxels: of each skin.
        active: of each contact, on the skin of the same place in `taxels`.
        steps: timed of each.
    """
    skins = {count: large_skin(count) for count in sorted(set(taxels))}
    robot = load_robot("ur5")
    subjects: list[Subject] = []
    for count, pressed in zip(taxels, active, strict=True):
        mounted = MountedSkin(skins[count], robot)
        scene = Scene(mounted, on_forearm(mounted.skin, pressed))
        subjects.append(EngineSubject("eskin", mounted, scene))
    times = time_together(subjects, steps)
    unit = float(np.median(times[0]))
    return [row_of(s, t, unit) for s, t in zip(subjects, times, strict=True)]


def engine_subjects(mounted: MountedSkin, active: int) -> list[Subject]:
    """The engine on the contact asked for, idle, and on other touches."""
    skin = mounted.skin
    two = np.concatenate([on_forearm(skin, active), on_upper_arm(skin, active)])
    touches = {
        ("eskin", active): on_forearm(skin, active),
        ("eskin", 0): on_forearm(skin, 1)[:0],
        ("eskin", FEW): on_forearm(skin, FEW),
        ("eskin, grab", GRAB): round_forearm(skin, GRAB),
        ("eskin, two touches", 2 * active): two,
    }
    return [
        EngineSubject(name, mounted, Scene(mounted, taxels))
        for (name, _), taxels in touches.items()
    ]


def baseline_subjects(
    mounted: MountedSkin, config: LatencyConfig, names: Sequence[str]
) -> list[Subject]:
    """Every way in which the named baselines, fitted, answer one reading."""
    if not names:
        return []
    clips, labels = random_clips(mounted, config.clips)
    few = SkinWindows(clips.pressure[:NETWORK_CLIPS], clips.q[:NETWORK_CLIPS])
    subjects: list[Subject] = []
    for name in names:
        baseline = make_baseline(name, mounted, FitConfig(epochs=1))
        if name in NETWORKS:
            baseline.fit(few, labels[:NETWORK_CLIPS])
        else:
            baseline.fit(clips, labels)
        for way, stream in baseline.streams().items():
            scene = Scene(mounted, on_forearm(mounted.skin, config.active))
            title = f"{name}, {way}" if way else name
            subjects.append(StreamSubject(title, mounted, scene, stream))
    return subjects
