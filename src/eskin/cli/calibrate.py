"""`eskin calibrate` measures the calibration of a skin with a person's help."""

from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
import tyro

from eskin.cli.checks import check_writable
from eskin.cli.guided import (
    Dialogue,
    PressCommand,
    describe_taxel,
    guide_presses,
    open_guided_source,
    show_result,
)
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.calibration import CalibrationGuide, CalibrationResult, PressRequest
    from eskin.skin import Skin
    from eskin.touch import Fault

MAX_SECONDS = 120.0
MAX_PRESSES = 50
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
    """Path of the calibration file to write, in place of an earlier one. As
    calibration.json in the skin's folder it is found by itself."""

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
    from eskin.calibration import CalibrationGuide, GuideConfig
    from eskin.recording import write_calibration

    check_options(command)
    is_known = command.bits is not None or command.calibration is not None
    config = GuideConfig(
        command.seconds, command.presses, command.patch, command.force, is_known
    )
    with ExitStack() as stack:
        source, mounted = open_guided_source(command, stack)
        guide = CalibrationGuide(mounted, source.info.calibration, config)
        page = guide_presses(command, source, CalibrationDialogue(guide), stack)
        result = guide.finish()
        written = f"written to {command.out}"
        if command.out.exists():
            written += ", in place of the calibration that was there"
        write_calibration(command.out, result.calibration)
        lines = describe_result(result, mounted.skin)
        if result.calibration.full_scale != guide.assumed.full_scale:
            lines.append(
                f"full scale is {result.calibration.full_scale:,}, as presses and "
                "counts say; --bits states another"
            )
        show_result(page, guide, [*lines, written])
    return summarise(result, mounted.skin, command)


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
                f"--{name.split()[0]} is {value:g}; allowed are {low:g} to {high:g}"
            )
    command.check_page_options()
    check_writable(command.out)


@final
class CalibrationDialogue(Dialogue["CalibrationGuide"]):
    """Puts a calibration into words."""

    guide: "CalibrationGuide"

    def describe_press(self, request: "PressRequest") -> str:
        """Describe where to press, and which press of the patch it is."""
        guide = self.guide
        count = guide.count_presses(int(guide.skin.patch_index[request.taxel]))
        force = "" if request.force is None else f" with {request.force:g} N"
        return (
            f"press {count + 1} of {guide.config.presses}{force}: "
            f"{describe_taxel(guide.skin, request.taxel)}"
        )

    def list_faults(self) -> "Sequence[Fault]":
        """List the faults of the skin now, and those found while it was at rest."""
        return [*super().list_faults(), *self.guide.faults.faults]

    def describe_skip(self, request: "PressRequest") -> str:
        """Describe that a patch is left out, and why light presses may not be felt."""
        bits = self.guide.fewer_bits
        why = "" if bits is None else f"; for a converter of {bits} bits --bits {bits}"
        return f"patch '{request.name}' is left out{why}"


def describe_result(result: "CalibrationResult", skin: "Skin") -> list[str]:
    """Describe noise, faults, and the gain of each patch that was pressed, in lines."""
    from eskin.stream import describe_places

    lines = []
    noise = result.rest.noise[result.codes < 0]
    if len(noise):
        lines.append(
            f"noise at rest: median {np.median(noise):.2f} counts, worst "
            f"{noise.max():.2f}"
        )
    if result.faults:
        lines.append(
            f"left out: {describe_places(result.faults, skin)}, out of order while "
            "hands were off"
        )
    if result.restless:
        lines.append(
            f"not used for presses: {format_count(result.restless, 'taxel')} that "
            "seemed touched while hands were off"
        )
    if result.calibration.falling:
        lines.append("counts fall under pressure, which the file says (falling)")
    rows = build_patch_rows(result, skin)
    if result.presses:
        lines.append(describe_presses(result))
        lines.append("the pressure of a count, against what was assumed before:")
    lines += [
        f"  patch '{row['id']}': gain x {row['gain_ratio']:.2f} +- "
        f"{100 * row['deviation']:.0f} %, from {format_count(row['presses'], 'press')}"
        for row in rows
        if row["presses"]
    ]
    unpressed = [row["id"] for row in rows if not row["presses"]]
    if result.presses and unpressed:
        lines.append(f"  not pressed, gain follows the others: {', '.join(unpressed)}")
    return lines


def describe_presses(result: "CalibrationResult") -> str:
    """Describe how many of the presses that were felt are used, and why others not."""
    used = len(result.presses)
    refused = len(result.refusals)
    felt = format_count(used + refused, "press")
    if not refused:
        return f"{felt} felt, and all of them used"
    counts = Counter(reason.cause for reason in result.refusals)
    told = {reason.cause: reason.what for reason in result.refusals}
    why = ", ".join(f"{told[cause]} ({count})" for cause, count in counts.items())
    return f"{felt} felt: {used} used, {refused} not used since {why}"


def build_patch_rows(result: "CalibrationResult", skin: "Skin") -> list[dict[str, Any]]:
    """Build what presses say of each patch of the skin.

    `gain_ratio` is the gain over the one that was assumed, `deviation` the standard
    deviation of its natural logarithm, None where nothing was pressed.
    """
    gains = result.gains
    return [
        {
            "id": patch.id,
            "presses": sum(press.patch == n for press in result.presses),
            "gain_ratio": 1.0 if gains is None else float(np.exp(gains.ln_gain[n])),
            "deviation": None if gains is None else float(gains.gain_deviation[n]),
        }
        for n, patch in enumerate(skin.patches)
    ]


def summarise(
    result: "CalibrationResult", skin: "Skin", command: CalibrateCommand
) -> dict[str, object]:
    """Return what was measured as plain values."""
    calibration = result.calibration
    noise = result.rest.noise[result.codes < 0]
    return {
        "taxels": skin.count,
        **{kind: result.count_taxels(kind) for kind in ("noisy", "dead", "stuck")},
        "presses": len(result.presses),
        "refused": len(result.refusals),
        "out": str(command.out),
        "source": calibration.source,
        "falling": calibration.falling,
        "full_scale": calibration.full_scale,
        "noise_median": round(float(np.median(noise)), 3) if len(noise) else None,
        "noise_worst": round(float(noise.max()), 3) if len(noise) else None,
        "faults": [
            {
                key: getattr(fault, key)
                for key in ("kind", "patch", "row", "column", "taxel")
            }
            for fault in result.faults
        ],
        "patches": build_patch_rows(result, skin),
        "exponent": calibration.exponent,
        "exponent_deviation": calibration.exponent_deviation,
        "unfelt": calibration.unfelt,
        "unfelt_deviation": calibration.unfelt_deviation,
    }
