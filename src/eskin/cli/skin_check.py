"""`eskin skin check`: everything that is wrong with a skin."""

from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from eskin.errors import DeviceError, SkinError
from eskin.robot import Robot
from eskin.skin import (
    SKIN_PRESETS,
    CheckConfig,
    SkinProblem,
    check_skin,
    load_robot_for_skin,
    load_skin,
    parse_skin_folder,
)


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
    from eskin.cli.presses import answers_of
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
