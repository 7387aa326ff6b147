"""`eskin generate` simulates touches and writes them as recordings."""

import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from eskin.cli.checks import Excludes, Needs, Range
from eskin.progress import show_progress
from eskin.sim.commands.untouched import print_untouched
from eskin.sim.dataset import GenerationSettings, generate
from eskin.sim.dataset.sets import ALL_SETS, RECORDED_GROUPS, RECORDED_SETS
from eskin.sim.people.recorded import find_recorded_people
from eskin.sim.scene import load_environment
from eskin.sim.sensor.flaws import Family
from eskin.skin import SKIN_PRESETS
from eskin.units import format_count

# A checker of types cannot know the names of a tuple; the command line does.
if TYPE_CHECKING:
    SetName = str
else:
    SetName = Literal[ALL_SETS]

SKINS = (
    "ur5",
    "ur5-half",
    "ur5-double",
    "ur5-sparse",
    "ur5-dense",
    "ur5-shapes",
    "ur5-missing",
    "ur10",
    "base",
    "post",
)
"""Skins that come with eskin and that people are simulated on."""


@dataclass(frozen=True)
class GenerateCommand:
    """Simulate people who touch a skin, and record them."""

    out: tyro.conf.Positional[Path]
    """Folder for the recordings and their index. The same command continues where it
    stopped."""

    skin: str = "ur5"
    """Skin that is touched: the name of one that comes with eskin, or a skin's folder.
    """

    robot_urdf: str | None = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    set: SetName = "train"
    """Name of the set of clips or streams."""

    clips: int | None = None
    """Number of clips, of streams, or of clips of each kind of pair; by default that of
    the set."""

    subjects: int | None = None
    """Number of people; by default it suits the number of clips."""

    seed: int = 0
    """Random seed."""

    workers: Annotated[int | None, Range(1)] = None
    """Number of processes; by default one for each core."""

    ray: Annotated[str | None, Excludes("workers")] = None
    """Address of a Ray cluster whose machines generate, HOST:PORT of its head or auto,
    in place of processes of this computer."""

    families: tuple[Family, ...] | None = None
    """Families of sensors: each session has a new build of one of them, in turn. By
    default the builds are those of the set."""

    difficulty: float | None = None
    """Width of the spreads, where 0 is the easiest; by default the published one."""

    recorded: Path | None = None
    """Folder of the public SocialTouch set, whose recorded touches the sets `recorded`
    (classes of the paper) and `recorded-groups` (its own 12) place on the skin, and
    `devices` on devices, as it does those of the public CapFingerId set."""

    people: Annotated[tuple[int, ...] | None, Needs("recorded")] = None
    """Participants of that folder whose touches are placed; by default all."""


def run(command: GenerateCommand) -> dict[str, object]:
    """Generate recordings; return the number of clips and the time taken."""
    check_skin(command)
    settings = build_settings(command)
    workers = os.cpu_count() or 1 if command.workers is None else command.workers
    print_untouched(command.skin, command.robot_urdf)
    with ExitStack() as stack:
        write = None
        if command.ray is not None:
            from eskin.sim.dataset.cluster import open_cluster

            write = stack.enter_context(open_cluster(command.ray))
        update = stack.enter_context(show_progress("clips", settings.clip_set.clips))
        result = generate(
            command.out, settings, workers, on_progress=update, write=write
        )
    rate = round(result.clips_per_minute, 1)
    print(
        f"{command.out}: {format_count(result.clips, 'clip')} in "
        f"{format_count(result.files, 'recording')}, "
        f"{result.made} of them made in {result.seconds:.1f} s, {rate} a minute"
    )
    return {
        "clips": result.clips,
        "made": result.made,
        "recordings": result.files,
        "seconds": round(result.seconds, 2),
        "clips_per_minute": rate,
    }


def check_skin(command: GenerateCommand) -> None:
    """Raise if nobody is simulated on the skin.

    A skin that is not a preset is loaded, so that one without a robot is refused before
    anything is written.

    Raises:
        ValueError: for a preset.
        SkinError: when there is no such skin.
    """
    if command.skin in SKIN_PRESETS and command.skin not in SKINS:
        raise ValueError(
            f"--skin is '{command.skin}'; allowed are {', '.join(SKINS)} or a folder "
            "with skin.yaml"
        )
    if command.skin not in SKIN_PRESETS:
        load_environment(command.skin, command.robot_urdf)


def build_settings(command: GenerateCommand) -> GenerationSettings:
    """Build the settings of the generation, with the recorded people if any."""
    recorded = None
    if command.recorded is not None:
        grouped = command.set == RECORDED_GROUPS
        needed = RECORDED_SETS.get(command.set, ())
        recorded = find_recorded_people(
            command.recorded, command.people, grouped, needed
        )
    return GenerationSettings(
        set_name=command.set,
        skin=command.skin,
        seed=command.seed,
        clips=command.clips,
        subjects=command.subjects,
        difficulty=command.difficulty,
        families=command.families,
        recorded=recorded,
        robot=command.robot_urdf,
    )
