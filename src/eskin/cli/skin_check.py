"""`eskin skin check`: this command lists everything that is wrong with a skin."""

from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from eskin.drivers import Source
from eskin.errors import DeviceError, SkinError
from eskin.robot import Robot
from eskin.skin import (
    SKIN_PRESETS,
    CheckConfig,
    MountedSkin,
    Skin,
    SkinProblem,
    check_skin,
    load_robot_for_skin,
    load_skin,
    parse_skin_folder,
)
from eskin.skin.wiring import PressResponse, PressTarget, choose_press_targets
from eskin.touch import PressDetector, TouchPipeline
from eskin.units import NS_PER_S

TARE = 3.0
"""Without touch at first [s]."""


def answers_of(source: Source, robot: Robot, wait: float) -> list[PressResponse]:
    """Ask for a press on every spot of the skin, and note who answers.

    Args:
        source: of the skin.
        robot: that the skin is on.
        wait: how long each press is awaited [s].
    """
    info = source.info
    pipeline = TouchPipeline(MountedSkin(info.skin, robot), info.calibration)
    print(f"hands off for {TARE:g} s", flush=True)
    tare(source, pipeline)
    answers = []
    for spot in choose_press_targets(info.skin):
        print(f"press {words_of(info.skin, spot.taxel)} ...", end=" ", flush=True)
        taxel = next_press(source, pipeline, wait)
        answers.append(PressResponse(spot, taxel))
        print(verdict(info.skin, spot, taxel), flush=True)
    return answers


def tare(source: Source, pipeline: TouchPipeline) -> None:
    """Let the skin come to rest, whoever touches it meanwhile."""
    until = None
    for scan in source:
        until = scan.stamp + TARE * NS_PER_S if until is None else until
        pipeline.push(scan)
        if scan.stamp >= until:
            return


def next_press(source: Source, pipeline: TouchPipeline, wait: float) -> int | None:
    """The taxel of the next press; None where none comes in time [s]."""
    finder, begun = PressDetector(), None
    for scan in source:
        begun = scan.stamp if begun is None else begun
        taxel = finder.push(pipeline.push(scan))
        if taxel is not None or scan.stamp - begun > wait * NS_PER_S:
            return taxel
    return None


def words_of(skin: Skin, taxel: int) -> str:
    """Where a taxel is, as people find it."""
    patch = skin.patches[int(skin.patch_index[taxel])]
    return (
        f"patch '{patch.id}' on {patch.link}, row {skin.rows[taxel]} of {patch.rows}, "
        f"column {skin.columns[taxel]} of {patch.columns}"
    )


def verdict(skin: Skin, spot: PressTarget, taxel: int | None) -> str:
    """What a press told."""
    if taxel is None:
        return "nothing felt"
    same = skin.patches[int(skin.patch_index[taxel])].id == spot.patch
    place = f"row {skin.rows[taxel]}, column {skin.columns[taxel]}"
    return f"felt at {place}" if same else f"felt on {words_of(skin, taxel)}"


@dataclass(frozen=True)
class Command:
    """Verify a skin: list every problem with its patch and taxel.

    With --live also its wiring, spot by spot: press where you are asked to.
    """

    skin: tyro.conf.Positional[str]
    """A preset's name, or a folder with skin.yaml."""

    robot: str | None = None
    """The robot it is for: ur5, table, tube or a .urdf file; a preset knows its own."""

    tolerance: float = 1e3 * CheckConfig.max_surface_distance
    """Farthest that a taxel may lie from its link's surface [mm]."""

    live: bool = False
    """Then ask for three presses on each patch, and tell how each is wired."""

    source: tuple[str, ...] = ()
    """With --live, where the patches are: serial:PATH or udp://HOST:PORT."""

    calibration: Path | None = None
    """With --live, of the electronics, as for eskin run."""

    wait: float = 30.0
    """With --live, how long each press is awaited [s]."""


def run(command: Command) -> dict[str, object]:
    """Check one skin; problems are printed one a line, then raised as one."""
    robot = load_robot_for_skin(command.skin, command.robot)
    config = CheckConfig(max_surface_distance=1e-3 * command.tolerance)
    problems = find_problems(command.skin, robot, config)
    for problem in problems:
        print(problem)
    if problems:
        raise SkinError(
            f"skin {command.skin} has {len(problems)} problem"
            f"{'s' * (len(problems) > 1)}; mend what is listed"
        )
    if command.live:
        return {"problems": ask_for_presses(command, robot)}
    against = f"on robot {robot.name}" if robot else "without a robot's surface"
    print(f"skin {command.skin}: no problems, checked {against}")
    if robot is None:
        print("--robot ROBOT checks links, surfaces and outward normals too")
    return {"problems": []}


def ask_for_presses(command: Command, robot: Robot | None) -> list[str]:
    """Ask for presses and judge the answers; raise where a patch is wired wrongly."""
    from eskin.app import SourceConfig, open_source
    from eskin.cli.skin_check import answers_of
    from eskin.skin.wiring import check_wiring

    if not command.source:
        raise DeviceError(
            "--live is given without --source; allowed is serial:PATH or "
            "udp://HOST:PORT; say where the patches are"
        )
    if robot is None:
        raise DeviceError(
            "--live is given without --robot; allowed is a robot's name or a .urdf "
            "file; say what the skin is on"
        )
    config = SourceConfig(command.skin, robot, command.calibration)
    with open_source(*command.source, config=config) as source:
        answers = answers_of(source, robot, command.wait)
    found = check_wiring(source.info.skin, answers)
    for line in found:
        print(line)
    if found:
        raise DeviceError(
            f"{len(found)} patch{'es are' if found[1:] else ' is'} not wired as the "
            "skin's file says; mend what is listed"
        )
    print("every patch answered where it was pressed")
    return []


def find_problems(
    skin: str, robot: Robot | None, config: CheckConfig
) -> list[SkinProblem]:
    """What is wrong in the files, and with the taxels that can be read from them."""
    if skin in SKIN_PRESETS:
        return check_skin(load_skin(skin), robot, config)
    draft = parse_skin_folder(Path(skin))
    found = check_skin(draft.skin, robot, config)
    # The check counts the taxels that were read; the file calls them by their ids.
    named = [
        p if p.taxel is None else replace(p, taxel=int(draft.ids[p.taxel]))
        for p in found
    ]
    return [*draft.problems, *named]
