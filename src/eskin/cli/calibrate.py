"""`eskin calibrate` measures the calibration of a skin with a person's help."""

import math
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
import tyro

from eskin.cli.checks import check_writable
from eskin.cli.guided import (
    Dialogue,
    PressCommand,
    await_page,
    build_place,
    guide_person,
    open_guided_source,
    open_page,
    print_line,
    show_result,
)
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
    from eskin.page import PressPlace
    from eskin.skin import Skin

MAX_SECONDS, MAX_PRESSES = 120.0, 50
"""Longest time at rest [s], and most presses of a patch."""


@dataclass(frozen=True, kw_only=True)
class CalibrateCommand(PressCommand):
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


def run(command: CalibrateCommand) -> dict[str, object]:
    """Guide through the calibration, write the file and return what was measured."""
    from eskin.calibration import CalibrationGuide
    from eskin.recording import write_calibration
    from eskin.skin import MountedSkin

    check_options(command)
    config = build_config(command)
    is_live = command.is_live
    with ExitStack() as stack:
        source = open_guided_source(command, stack)
        info = source.info
        robot = info.load_robot(command.robot_urdf)
        mounted = MountedSkin(info.skin, robot)
        guide = CalibrationGuide(mounted, info.calibration, config)
        print(
            f"{info.uri}: skin '{info.skin.name}', "
            f"{format_count(info.skin.count, 'taxel')}"
        )
        page = open_page(command, mounted, info.rate, stack)
        scans = await_page(source, page, is_live)
        wait = command.wait if is_live else math.inf
        guide_person(scans, CalibrationDialogue(guide), wait, page)
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
            print_line(line)
        write_calibration(command.out, result.calibration)
        lines.append(f"written to {command.out}")
        print_line(lines[-1])
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
    }
    limits |= {f"force {force:g}": (force, 0.1, 100.0) for force in command.force}
    for name, (value, low, high) in limits.items():
        if not low <= value <= high:
            raise ValueError(
                f"--{name.split()[0]} is {value:g}; allowed are {low:g} to {high:g}; "
                "change it"
            )
    command.check_page_options()
    check_writable(command.out)


def build_config(command: CalibrateCommand) -> "GuideConfig":
    """Build what is asked of the person."""
    from eskin.calibration import GuideConfig

    return GuideConfig(command.seconds, command.presses, command.patch, command.force)


@final
class CalibrationDialogue(Dialogue["CalibrationGuide"]):
    """Puts a calibration into words."""

    def __init__(self, guide: "CalibrationGuide") -> None:
        """Keep the guide."""
        self.guide = guide

    def describe_press(self) -> str:
        """Describe where to press now; empty where nothing is to be pressed."""
        guide, request = self.guide, self.guide.request
        if request is None:
            return ""
        count = guide.count_presses(request.patch)
        force = "" if request.force is None else f" with {request.force:g} N"
        return (
            f"press {count + 1} of {guide.config.presses}{force}: "
            f"{describe_taxel(guide.skin, request.taxel)}"
        )

    def describe_event(self, event: "GuideEvent") -> str:
        """Describe what a scan has led to; empty where there is nothing to say."""
        if event.kind == "touched":
            return f"{event.text}: hands off, rest begins again"
        if event.kind == "rested":
            return "rest is measured"
        if event.taxel is None:
            return ""
        verdict = "felt on" if event.kind == "pressed" else f"{event.text}: not used,"
        return f"  {verdict} {describe_taxel(self.guide.skin, event.taxel)}"

    def describe_skip(self) -> str:
        """Describe that the patch asked for is left out."""
        request = self.guide.request
        if request is None:
            return ""
        return f"patch '{self.guide.skin.patches[request.patch].id}' is left out"

    def find_place(self) -> "PressPlace | None":
        """Find the place to press now; None where none is to be pressed."""
        request, mounted = self.guide.request, self.guide.mounted
        if request is None:
            return None
        name = mounted.skin.patches[request.patch].id
        p_link = mounted.skin.positions[request.taxel]
        return build_place(name, mounted, request.taxel, p_link)


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
