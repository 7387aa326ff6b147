"""`eskin calibrate` measures the calibration of a skin with a person's help."""

import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from itertools import dropwhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro

from eskin.cli.checks import check_writable
from eskin.cli.guided import GuidedCommand, open_guided_source, print_line
from eskin.cli.run import DEFAULT_PORT
from eskin.cli.skin import describe_taxel
from eskin.errors import DeviceError, RecordingError
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.calibration import (
        CalibrationGuide,
        CalibrationResult,
        GuideConfig,
        GuideEvent,
    )
    from eskin.drivers import Source
    from eskin.page import GuideBoard
    from eskin.skin import MountedSkin, Skin
    from eskin.touch import Scan
    from eskin.viewer import CalibrationViewer

MAX_SECONDS, MAX_PRESSES = 120.0, 50
"""Longest time at rest [s], and most presses of a patch."""


@dataclass(frozen=True, kw_only=True)
class CalibrateCommand(GuidedCommand):
    """Measure rest, noise and gains of a skin, and write them to a calibration file.

    Take all hands off first, then press each patch where you are asked to, with one
    fingertip, firmly, for about a second. `eskin run`, `replay`, `train` and
    `evaluate` use the file by --calibration. Ctrl-C writes nothing.
    """

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT; or replay:FILE, a recording of some seconds of rest and then
    presses."""

    out: Path
    """Path of the calibration file to write. As calibration.json in the skin's folder
    it is found by itself."""

    seconds: float = 5.0
    """Time without touch [s]."""

    presses: int = 5
    """Number of presses of each patch; 0 measures rest and noise alone."""

    patch: tuple[str, ...] = ()
    """Patches to press; by default all."""

    force: tuple[float, ...] = ()
    """Force of the presses [N], as of a known weight or with a gauge. Several forces
    are asked for in turn. By default the force is that of people, which varies."""

    wait: float = 30.0
    """Longest time to wait for rest, and for each press, before the patch is left out
    [s]."""

    view: bool = False
    """Guide in the browser too, where the place to press is marked on the robot. It
    begins once the page is opened; a recording is then played as fast as it was made.
    """

    port: int | None = None
    """TCP port of the page on this computer, 8080 by default; 0 takes any free one."""


def run(command: CalibrateCommand) -> dict[str, object]:
    """Guide through the calibration, write the file and return what was measured."""
    from eskin.calibration import CalibrationGuide
    from eskin.recording import write_calibration
    from eskin.skin import MountedSkin

    check_options(command)
    config = build_config(command)
    is_live = not command.source[0].startswith("replay:")
    with ExitStack() as stack:
        pace = 1.0 if command.view else math.inf
        source = open_guided_source(command, pace, stack)
        info = source.info
        robot = info.load_robot(command.robot_urdf)
        mounted = MountedSkin(info.skin, robot)
        guide = CalibrationGuide(mounted, info.calibration, config)
        print(
            f"{info.uri}: skin '{info.skin.name}', "
            f"{format_count(info.skin.count, 'taxel')}"
        )
        page = None
        if command.view:
            page = open_page(command, mounted, info.rate)
            stack.callback(page.close)
        scans = source if page is None else await_page(source, page, is_live)
        guide_person(scans, guide, command.wait if is_live else math.inf, page)
        source.close()
        if guide.rest is None:
            raise (DeviceError if is_live else RecordingError)(
                f"{info.uri} had no {command.seconds:g} s at rest; allowed is that "
                "time without touch, at its beginning or later; take all hands off "
                "and repeat"
            )
        result = guide.finish()
        lines = describe_result(result, info.skin)
        for line in lines:
            say(line)
        write_calibration(command.out, result.calibration)
        lines.append(f"written to {command.out}")
        say(lines[-1])
        if page is not None:
            show_result(page, guide, lines)
    return summarise(result, info.skin, command)


def check_options(command: CalibrateCommand) -> None:
    """Raise if an option is out of range, or the file cannot be written.

    Raises:
        ValueError: for an option.
        EskinError: for the file.
    """
    if not command.source:
        raise ValueError(
            "no source given; allowed are serial:PATH, csv:PATH, udp://HOST:PORT, "
            "xela://HOST:PORT and replay:FILE"
        )
    limits = {
        "seconds": (command.seconds, 1.0, MAX_SECONDS),
        "presses": (command.presses, 0, MAX_PRESSES),
        "wait": (command.wait, 1.0, math.inf),
    }
    limits |= {f"force {force:g}": (force, 0.1, 100.0) for force in command.force}
    for name, (value, low, high) in limits.items():
        if not low <= value <= high:
            raise ValueError(
                f"--{name.split()[0]} is {value:g}; allowed are {low:g} to {high:g}; "
                "change it"
            )
    if command.port is not None and not command.view:
        raise ValueError(
            "--port is given without --view; allowed is both; ask for the page"
        )
    check_writable(command.out)


def build_config(command: CalibrateCommand) -> "GuideConfig":
    """Build what is asked of the person."""
    from eskin.calibration import GuideConfig

    return GuideConfig(command.seconds, command.presses, command.patch, command.force)


def open_page(
    command: CalibrateCommand, mounted: "MountedSkin", rate: float
) -> "CalibrationViewer":
    """Start the page, and print its link.

    Raises:
        DeviceError: the port is not available.
    """
    from eskin.page.link import free_port
    from eskin.viewer import CalibrationViewer, ViewerConfig

    port = free_port(DEFAULT_PORT if command.port is None else command.port)
    config = ViewerConfig(port)
    page = CalibrationViewer(mounted, rate, config)
    print(f"see {config.link}", flush=True)
    return page


def await_page(
    source: "Source", page: "CalibrationViewer", is_live: bool
) -> "Iterator[Scan]":
    """Return the scans from the time on at which a browser has opened the page.

    A recording begins then. Scans of a device do not wait, and are dropped until then.
    """
    if not is_live:
        page.wait_opened()
    return dropwhile(lambda scan: not page.is_opened, source)


def guide_person(
    scans: "Iterable[Scan]",
    guide: "CalibrationGuide",
    wait: float,
    page: "CalibrationViewer | None" = None,
) -> None:
    """Push scans until all is measured, and say what to do and what was felt.

    Args:
        scans: scans of the skin.
        guide: guide through the calibration.
        wait: longest time to wait for rest and for each press [s]; infinite for a
            recording, which nobody can be asked for presses.
        page: page that shows the same as the terminal; None without a page.
    """
    from eskin.units import NS_PER_S

    asks = math.isfinite(wait)
    say(describe_request(guide))
    since: int | None = None
    for scan in scans:
        since = scan.stamp if since is None else since
        was_rest, event = guide.phase == "rest", guide.push(scan)
        limit = wait + guide.config.seconds * was_rest
        is_late = scan.stamp - since > limit * NS_PER_S
        if event is not None:
            say(describe_event(event, guide), page)
        if event is not None and event.kind != "touched":
            since = scan.stamp
            if asks:
                say(describe_request(guide))
        elif is_late and was_rest:
            return
        elif is_late or is_skipped(guide, page):
            since = scan.stamp
            say(describe_skip(guide, is_late), page)
            guide.skip()
            say(describe_request(guide))
        if page is not None and guide.state is not None and page.wants():
            page.show(guide.state, build_board(guide))
        if guide.phase == "done":
            return


def say(line: str, page: "CalibrationViewer | None" = None) -> None:
    """Print a line unless it is empty, and add it to the log of the page."""
    print_line(line)
    if line and page is not None:
        page.tell(line)


def build_board(guide: "CalibrationGuide") -> "GuideBoard":
    """Build what the page shows of the guide."""
    from eskin.page import GuideBoard

    request = guide.request if guide.phase == "press" else None
    taxel = None if request is None else request.taxel
    return GuideBoard(describe_request(guide), guide.progress, taxel)


def show_result(
    page: "CalibrationViewer", guide: "CalibrationGuide", lines: list[str]
) -> None:
    """Show the result in the page until the person closes it there, or by Ctrl-C."""
    from eskin.page import GuideBoard

    assert guide.state is not None
    page.show(guide.state, GuideBoard("finished", 1.0, None, tuple(lines)))
    with suppress(KeyboardInterrupt):
        page.wait_closed()


def is_skipped(guide: "CalibrationGuide", page: "CalibrationViewer | None") -> bool:
    """Tell whether the person has left out, in the page, the patch asked for."""
    if page is None or page.skipped is None or guide.phase != "press":
        return False
    request = guide.request
    return request is not None and guide.skin.patches[request.patch].id == page.skipped


def describe_skip(guide: "CalibrationGuide", is_late: bool) -> str:
    """Describe that the patch asked for is left out, for want of presses or not."""
    request = guide.request
    if request is None:
        return ""
    patch = guide.skin.patches[request.patch].id
    return f"{'nothing felt: ' * is_late}patch '{patch}' is left out"


def describe_request(guide: "CalibrationGuide") -> str:
    """Describe what to do now; empty where nothing is to be done."""
    if guide.phase == "rest":
        return f"hands off for {guide.config.seconds:g} s"
    request = guide.request
    if guide.phase != "press" or request is None:
        return ""
    count = guide.count_presses(request.patch)
    force = "" if request.force is None else f" with {request.force:g} N"
    return (
        f"press {count + 1} of {guide.config.presses}{force}: "
        f"{describe_taxel(guide.skin, request.taxel)}"
    )


def describe_event(event: "GuideEvent", guide: "CalibrationGuide") -> str:
    """Describe what a scan has led to; empty where there is nothing to say."""
    if event.kind == "touched":
        return f"{event.text}: hands off, rest begins again"
    if event.kind == "rested":
        return "rest is measured"
    if event.taxel is None:
        return ""
    verdict = "felt on" if event.kind == "pressed" else f"{event.text}: not used,"
    return f"  {verdict} {describe_taxel(guide.skin, event.taxel)}"


def describe_result(result: "CalibrationResult", skin: "Skin") -> list[str]:
    """Describe noise, faults, and the gain of each patch that was pressed, in lines."""
    lines = []
    noise = result.rest.noise[result.codes < 0]
    if len(noise):
        lines.append(
            f"noise at rest: median {np.median(noise):.2f} counts, worst "
            f"{noise.max():.2f}"
        )
    for fault in result.faults:
        places = {"row": fault.row, "column": fault.column}
        text = "".join(f", {k} {v}" for k, v in places.items() if v is not None)
        lines.append(f"  {fault.kind}: patch '{fault.patch}'{text}")
    rows = build_patch_rows(result, skin)
    lines += [
        f"  patch '{row.id}': gain x {row.gain_ratio:.2f} +- "
        f"{100 * (row.deviation or 0.0):.0f} %, {format_count(row.presses, 'press')}"
        for row in rows
        if row.presses
    ]
    unpressed = [row.id for row in rows if not row.presses]
    if result.presses and unpressed:
        lines.append(f"  not pressed, gain follows the others: {', '.join(unpressed)}")
    return lines


@dataclass(frozen=True)
class PatchRow:
    """A row holds what presses say of one patch."""

    id: str
    presses: int
    gain_ratio: float
    """Gain over the one that was assumed."""
    deviation: float | None
    """Standard deviation of ln gain; None without any press."""


def build_patch_rows(result: "CalibrationResult", skin: "Skin") -> list[PatchRow]:
    """Build one row for each patch of the skin."""
    counts = [0] * len(skin.patches)
    for press in result.presses:
        counts[press.patch] += 1
    gains = result.gains
    return [
        PatchRow(
            patch.id,
            counts[n],
            1.0 if gains is None else float(np.exp(gains.ln_gain[n])),
            None if gains is None else float(gains.gain_deviation[n]),
        )
        for n, patch in enumerate(skin.patches)
    ]


def summarise(
    result: "CalibrationResult", skin: "Skin", command: CalibrateCommand
) -> dict[str, object]:
    """Return what was measured as plain values."""
    calibration, noise = result.calibration, result.rest.noise[result.codes < 0]
    return {
        "taxels": skin.count,
        "noisy": result.count_taxels("noisy"),
        "dead": result.count_taxels("dead"),
        "stuck": result.count_taxels("stuck"),
        "presses": len(result.presses),
        "out": str(command.out),
        "source": calibration.source,
        "noise_median": round(float(np.median(noise)), 3) if len(noise) else None,
        "noise_worst": round(float(noise.max()), 3) if len(noise) else None,
        "faults": [
            {
                "kind": fault.kind,
                "patch": fault.patch,
                "row": fault.row,
                "column": fault.column,
                "taxel": fault.taxel,
            }
            for fault in result.faults
        ],
        "patches": [asdict(row) for row in build_patch_rows(result, skin)],
        "exponent": calibration.exponent,
        "exponent_deviation": calibration.exponent_deviation,
        "unfelt": calibration.unfelt,
        "unfelt_deviation": calibration.unfelt_deviation,
    }
