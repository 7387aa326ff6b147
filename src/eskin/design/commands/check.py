"""`eskin skin check` lists the problems of a skin, and checks how it is wired."""

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import NOT_NEGATIVE, check_way
from eskin.cli.guided import (
    SourceCommand,
    WaitReporter,
    describe_least_press,
    describe_taxel,
    open_guided_source,
    say,
)
from eskin.cli.options import ROBOT
from eskin.errors import DeviceError, SkinError
from eskin.robot import Robot
from eskin.skin import (
    SKIN_PRESETS,
    CheckConfig,
    MountedSkin,
    SkinProblem,
    check_skin,
    describe_problems,
    load_robot_for_skin,
    load_skin,
    parse_skin_folder,
)
from eskin.units import NS_PER_S

if TYPE_CHECKING:
    from eskin.cli.terminal import SkinPrinter
    from eskin.drivers import Source
    from eskin.skin.wiring import PressResponse
    from eskin.touch import TouchPipeline

TARE_S = 3.0
"""Time without touch at the start [s]."""


def collect_presses(
    source: "Source", robot: Robot, wait: float
) -> "list[PressResponse]":
    """Ask for a press on every target of the skin and record which taxel answers.

    Args:
        source: source of the skin's scans.
        robot: robot that the skin is mounted on.
        wait: longest time to wait for each press [s].
    """
    from eskin.cli.terminal import SkinPrinter
    from eskin.skin.wiring import PressResponse, choose_press_targets
    from eskin.touch import TouchPipeline

    info = source.info
    pipeline = TouchPipeline(MountedSkin(info.skin, robot), info.calibration)
    printer = SkinPrinter(info.skin)
    say(f"hands off for {TARE_S:g} s")
    tare(source, pipeline)
    answers = []
    for spot in choose_press_targets(info.skin):
        say(f"press {describe_taxel(info.skin, spot.taxel)}")
        taxel = wait_for_press(source, pipeline, wait, printer)
        answers.append(PressResponse(spot, taxel))
        place = "" if taxel is None else describe_taxel(info.skin, taxel)
        say(f"  felt on {place}" if place else "  nothing felt")
    printer.finish()
    return answers


def tare(source: "Source", pipeline: "TouchPipeline") -> None:
    """Let the pipeline tare the skin for the first seconds of the stream."""
    until = None
    for scan in source:
        until = scan.stamp + TARE_S * NS_PER_S if until is None else until
        pipeline.push(scan)
        if scan.stamp >= until:
            return


def wait_for_press(
    source: "Source", pipeline: "TouchPipeline", wait: float, printer: "SkinPrinter"
) -> int | None:
    """Return the taxel of the next press; None if none comes in time [s].

    What happens to the skin meanwhile, and what was felt last, is printed.
    """
    from eskin.touch import PressDetector

    waiting = WaitReporter(source.info.skin, describe_least_press())
    detector = PressDetector()
    start = None
    for scan in source:
        start = scan.stamp if start is None else start
        state = pipeline.push(scan)
        taxel = detector.push(state)
        check_way(state.faults)
        printer.push(scan.stamp, state.faults, source.take_events())
        say(waiting.push(state, "touch" if detector.since is None else None))
        if taxel is not None or scan.stamp - start > wait * NS_PER_S:
            return taxel
    return None


@dataclass(frozen=True, kw_only=True)
class CheckCommand(SourceCommand):
    """Verify a skin: list every problem with its patch and taxel.

    With --live, the wiring is checked as well: press where you are asked to.
    """

    skin: tyro.conf.Positional[str] = field()
    """A preset's name, or a folder with skin.yaml."""

    robot_urdf: Annotated[str | None, ROBOT] = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""

    tolerance: Annotated[float, NOT_NEGATIVE] = 1e3 * CheckConfig.max_surface_distance
    """Largest distance of a taxel from its link's surface [mm]."""

    live: bool = False
    """Ask for three presses on each patch and check how each patch is wired."""

    source: tuple[str, ...] = ()
    """Device for --live: serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT."""

    wait: Annotated[float, NOT_NEGATIVE] = 30.0
    """Longest time to wait for each press of --live [s]."""


def run(command: CheckCommand) -> dict[str, object]:
    """Check one skin; print its problems, then raise one error."""
    robot = load_robot_for_skin(
        command.skin, command.robot_urdf, mimics=not command.no_mimics
    )
    config = CheckConfig(max_surface_distance=1e-3 * command.tolerance)
    problems = find_problems(command.skin, robot, config)
    for line in describe_problems(problems):
        print(line)
    if problems:
        raise SkinError(
            f"skin {command.skin} has {len(problems)} problem"
            f"{'s' * (len(problems) > 1)}; correct what is listed"
        )
    if command.live:
        return {"problems": check_live_wiring(command)}
    against = f"on robot {robot.name}" if robot else "without a robot's surface"
    print(f"skin {command.skin}: no problems, checked {against}")
    if robot is None:
        print("--robot-urdf ROBOT checks links, surfaces and outward normals too")
    else:
        say(robot.describe_lacking_meshes("checked"))
    return {"problems": []}


def check_live_wiring(command: CheckCommand) -> list[str]:
    """Ask for presses and check the answers; raise if a patch is wired wrongly."""
    from eskin.skin.wiring import check_wiring

    if not command.source:
        raise DeviceError(
            "--live is given without --source; allowed is a device, as serial:PATH or "
            "csv:PATH; say where the patches are"
        )
    with ExitStack() as stack:
        source, mounted = open_guided_source(command, stack)
        answers = collect_presses(source, mounted.robot, command.wait)
    found = check_wiring(source.info.skin, answers)
    for line in found:
        print(line)
    if found:
        raise DeviceError(
            f"{len(found)} patch{'es are' if found[1:] else ' is'} not wired as the "
            "skin's file says; correct what is listed"
        )
    print("every patch answered where it was pressed")
    return []


def find_problems(
    skin: str, robot: Robot | None, config: CheckConfig
) -> list[SkinProblem]:
    """Find the problems of a skin's files and of the taxels that can be read."""
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
