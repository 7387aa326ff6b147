"""`eskin skin show`, `check` and `convert` describe, verify and convert a skin."""

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import NOT_NEGATIVE, check_folder, check_way, check_writable
from eskin.cli.guided import (
    SourceCommand,
    WaitReporter,
    describe_least_press,
    describe_taxel,
    open_guided_source,
    say,
)
from eskin.errors import DeviceError, RobotError, SkinError
from eskin.robot import Robot, load_urdf
from eskin.skin import (
    SKIN_PRESETS,
    CheckConfig,
    MountedSkin,
    Skin,
    SkinProblem,
    check_skin,
    describe_problems,
    load_robot_for_skin,
    load_skin,
    parse_skin_folder,
    save_skin,
)
from eskin.skin.files import MANIFEST
from eskin.units import NS_PER_S, format_count

if TYPE_CHECKING:
    from eskin.cli.terminal import SkinPrinter
    from eskin.drivers import Source
    from eskin.skin.wiring import PressResponse
    from eskin.touch import TouchPipeline

ROBOT = tyro.conf.arg(aliases=("--robot",))
# Poses in which the arm shows its skin well [rad].
POSES = {"ur5": (0.4, -1.3, 1.5, -1.2, -1.3, 0.0)}


@dataclass(frozen=True)
class ShowCommand:
    """Show the counts, area and density of each patch of a skin, and draw a picture."""

    skin: tyro.conf.Positional[str]
    """A preset's name, or a folder with skin.yaml."""

    out: Path | None = None
    """Path of the picture to write, such as skin.png."""

    robot_urdf: Annotated[str | None, ROBOT] = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run_show(command: ShowCommand) -> dict[str, object]:
    """Print the figures of one skin and return them."""
    skin = load_skin(command.skin)
    robot = load_robot_for_skin(
        command.skin, command.robot_urdf, mimics=not command.no_mimics
    )
    if command.out is not None:
        check_writable(command.out)
        say(robot.describe_lacking_meshes("drawn") if robot else "")
        draw_picture(skin, command.out, robot)
    patches = build_patch_rows(skin)
    total = summarise_areas(skin.areas)
    print_table(skin, patches, total)
    if command.out is not None:
        print(f"picture: {command.out}")
    return {
        "name": skin.name,
        **total,
        "calibrated": skin.calibrated,
        "patches": patches,
        "picture": None if command.out is None else str(command.out),
    }


def draw_picture(skin: Skin, out: Path, robot: Robot | None) -> None:
    """Draw the skin on its robot in a pose that shows it."""
    from eskin.skin.picture import draw_skin

    pose = POSES.get(robot.name) if robot else None
    draw_skin(skin, out, robot, None if pose is None else np.array(pose))


def summarise_areas(areas: np.ndarray) -> dict[str, object]:
    """Return count, area and density of taxels with these areas [m2]."""
    area = 1e4 * float(areas.sum())
    return {
        "taxels": len(areas),
        "area_cm2": round(area, 3),
        "density_per_cm2": round(len(areas) / area, 4) if area > 0 else 0.0,
    }


def build_patch_rows(skin: Skin) -> list[dict[str, object]]:
    """Return the figures of each patch."""
    return [
        {
            "id": patch.id,
            "link": patch.link,
            "address": patch.address,
            "rows": patch.rows,
            "columns": patch.columns,
            "kind": patch.kind,
            "units": patch.units,
            **summarise_areas(skin.areas[skin.patch_index == number]),
        }
        for number, patch in enumerate(skin.patches)
    ]


def print_table(
    skin: Skin, patches: list[dict[str, object]], total: dict[str, object]
) -> None:
    """Print one line for each patch and one for the whole skin."""
    table = Table(title=f"skin {skin.name}", title_justify="left", box=SIMPLE_HEAD)
    for name in ("patch", "link", "grid", "kind"):
        table.add_column(name)
    for name in ("taxels", "cm²", "/cm²"):
        table.add_column(name, justify="right")
    for row in patches:
        grid = f"{row['rows']} x {row['columns']}"
        named = (row["id"], row["link"], grid, row["kind"])
        table.add_row(*map(str, named), *format_areas(row))
    table.add_section()
    table.add_row("all", "", "", "", *format_areas(total))
    Console(markup=False).print(table)
    if not skin.calibrated:
        print("geometry and units are nominal: lengths and densities mean little")


def format_areas(row: dict[str, object]) -> tuple[str, str, str]:
    """Format count, area and density as they are printed."""
    return (
        str(row["taxels"]),
        f"{row['area_cm2']:.1f}",
        f"{row['density_per_cm2']:.2f}",
    )


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


def run_check(command: CheckCommand) -> dict[str, object]:
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


Format = Literal["skin", "urdf", "icub", "gentact"]
SUFFIXES: dict[str, Format] = {".urdf": "urdf", ".txt": "icub", ".csv": "gentact"}


@dataclass(frozen=True)
class ConvertSkinCommand:
    """Convert a skin from or to the tactile sensors of a URDF, iCub or GenTact files.

    The format is told by the path: NAME.urdf, NAME.csv of GenTact, NAME.txt or a folder
    of such files of the iCub; any other is a skin's folder, or the name of a preset.
    """

    source: tyro.conf.Positional[str]
    """Skin, or file of another project."""

    out: tyro.conf.Positional[Path]
    """What to write."""

    to: Format | None = None
    """Format to write, where the path does not tell it, as for a folder of iCub files.
    """

    robot_urdf: str | None = None
    """Robot of the skin: a URDF file or a preset's name; by default the skin's own, or
    the one in the .urdf that is read. GenTact files need one with shapes, which give
    the normals; to a .urdf, the sensors are added to its URDF."""

    link: str | None = None
    """Link of all taxels, where the file does not tell it."""

    name: str | None = None
    """Name of the skin; that of the file where none is given."""


def run_convert(command: ConvertSkinCommand) -> dict[str, object]:
    """Read a skin, write it, and return its counts."""
    wanted = command.to or SUFFIXES.get(command.out.suffix, "skin")
    if wanted in ("skin", "icub"):
        check_folder(command.out)
    else:
        check_writable(command.out)
    from eskin.skin.gentact import write_gentact
    from eskin.skin.icub import write_icub_positions
    from eskin.skin.tactile_urdf import write_tactile_urdf

    robot = find_robot(command)
    skin = read_skin(command, robot)
    match wanted:
        case "skin":
            save_skin(skin, command.out, robot)
        case "urdf":
            write_tactile_urdf(command.out, skin, robot)
        case "icub":
            write_icub_positions(command.out, skin)
        case "gentact":
            write_gentact(command.out, skin)
    print(
        f"{command.out}: {format_count(skin.count, 'taxel')} of "
        f"{format_count(len(skin.patches), 'patch')}, on "
        f"{format_count(len(set(skin.link_names)), 'link')}"
    )
    return {
        "out": str(command.out),
        "format": wanted,
        "taxels": skin.count,
        "patches": len(skin.patches),
    }


def find_robot(command: ConvertSkinCommand) -> Robot | None:
    """Find the robot of the skin that is converted; None where nothing says it.

    A URDF of tactile sensors alone describes no robot, which is said.
    """
    path = Path(command.source)
    if command.robot_urdf is not None or SUFFIXES.get(path.suffix) != "urdf":
        return load_robot_for_skin(command.source, command.robot_urdf)
    try:
        return load_urdf(path, meshes=False)
    except RobotError as error:
        say(f"without its robot: {error}")
        return None


def read_skin(command: ConvertSkinCommand, robot: Robot | None) -> Skin:
    """Read the skin that is converted.

    Raises:
        SkinError: It cannot be read, or needs the robot.
    """
    from eskin.skin.gentact import read_gentact
    from eskin.skin.icub import read_icub_positions
    from eskin.skin.tactile_urdf import read_tactile_urdf

    path = Path(command.source)
    name = command.name or path.stem
    if command.source in SKIN_PRESETS or (path / MANIFEST).exists():
        return load_skin(command.source)
    files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
    match SUFFIXES.get(files[0].suffix if files else "", "skin"):
        case "urdf":
            return read_tactile_urdf(path, name)
        case "icub":
            return read_icub_positions(files, name, command.link)
        case "gentact" if robot is not None:
            return read_gentact(path, name, robot, command.link)
        case "gentact":
            raise SkinError(
                f"{path} has no normals; allowed is a robot with shapes, which give "
                "them; name it with --robot-urdf"
            )
    return load_skin(command.source)
