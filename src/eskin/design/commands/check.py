"""`eskin skin check` lists the problems of a skin, and checks how it is wired."""

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, final

import tyro

from eskin.cli.checks import NOT_NEGATIVE
from eskin.cli.guided import (
    Dialogue,
    SourceCommand,
    describe_taxel,
    guide_person,
    open_guided_source,
    say,
)
from eskin.cli.options import ROBOT
from eskin.errors import DeviceError, SkinError
from eskin.robot import Robot
from eskin.skin import (
    SKIN_PRESETS,
    CheckConfig,
    SkinProblem,
    check_skin,
    describe_problems,
    load_robot_for_skin,
    load_skin,
    parse_skin_folder,
)

if TYPE_CHECKING:
    from eskin.calibration import PressRequest


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
    from eskin.calibration.wiring_guide import WiringGuide
    from eskin.skin.wiring import check_wiring

    if not command.source:
        raise DeviceError(
            "--live is given without --source; allowed is a device, as serial:PATH or "
            "csv:PATH; say where the patches are"
        )
    with ExitStack() as stack:
        source, mounted = open_guided_source(command, stack)
        guide = WiringGuide(mounted, source.info.calibration)
        dialogue = WiringDialogue(guide)
        guide_person(source, dialogue, command.wait, take_events=source.take_events)
    found = check_wiring(guide.skin, guide.finish())
    for line in found:
        print(line)
    if found:
        raise DeviceError(
            f"{len(found)} patch{'es are' if found[1:] else ' is'} not wired as the "
            "skin's file says; correct what is listed"
        )
    print("every patch answered where it was pressed")
    return []


@final
class WiringDialogue(Dialogue[Any]):
    """Puts presses on the targets of a skin into words."""

    def describe_press(self, request: "PressRequest") -> str:
        """Describe where to press."""
        return f"press {describe_taxel(self.guide.skin, request.taxel)}"

    def describe_skip(self, request: "PressRequest") -> str:
        """Describe that a press is left out."""
        return "the press is left out"


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
