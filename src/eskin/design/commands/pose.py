"""`eskin skin pose` measures where a patch is mounted, with a person's help."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
import tyro

from eskin.cli.checks import check_folder, check_new
from eskin.cli.guided import (
    Dialogue,
    PressCommand,
    guide_presses,
    open_guided_source,
    say,
    show_result,
)
from eskin.files import atomic_path
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.calibration import PressRequest
    from eskin.calibration.pose import PoseEstimate, PoseGuide


@dataclass(frozen=True, kw_only=True)
class PoseCommand(PressCommand):
    """Measure where patches are mounted, and write a skin with them where they are.

    Take all hands off for three seconds, then press each point of a file with one
    fingertip, in their order, firmly, for about a second. Points are places on the
    outside of the patches, measured on the link: five or more of a patch, spread over
    it. Ctrl-C writes nothing.
    """

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT; or replay:FILE, a recording of rest and then of the presses."""

    points: Path
    """CSV file of the points, with columns patch, x_mm, y_mm, z_mm in the frame of the
    patch's link."""

    out: Path
    """Folder of the corrected skin."""


def run(command: PoseCommand) -> dict[str, object]:
    """Guide through the presses, write the skin and return what was measured."""
    from eskin.calibration.pose import PoseGuide, move_patch, read_points
    from eskin.skin import save_skin

    command.check_page_options()
    check_folder(command.out)
    with ExitStack() as stack:
        source, mounted = open_guided_source(command, stack)
        skin = mounted.skin
        points = read_points(command.points, skin)
        guide = PoseGuide(mounted, source.info.calibration, points)
        page = guide_presses(command, source, PoseDialogue(guide), stack)
        estimates = guide.finish()
        for estimate in estimates:
            skin = move_patch(skin, estimate)
        save_skin(skin, command.out, mounted.robot)
        lines = [describe_estimate(estimate, guide) for estimate in estimates]
        show_result(page, guide, [*lines, f"written to {command.out}"])
    return {
        "presses": len(guide.presses),
        "out": str(command.out),
        "patches": [summarise(each) for each in estimates],
    }


@dataclass(frozen=True, kw_only=True)
class PointsCommand:
    """List the places of a patch whose presses tell most of where it is mounted.

    Mark them on the patch, measure them on its link in place of the coordinates that
    are written, which are those of the skin's file, and give the file to `eskin skin
    pose`.
    """

    skin: tyro.conf.Positional[str]
    """Skin: a preset's name or a skin's folder."""

    patch: tuple[str, ...] = ()
    """Patches; by default all."""

    presses: int = 10
    """Number of presses of each patch."""

    out: Path
    """New CSV file, with columns patch, row, column, x_mm, y_mm, z_mm."""


def run_points(command: PointsCommand) -> dict[str, object]:
    """Write the places to press, and return how many there are."""
    from eskin.calibration.pose import choose_taxels
    from eskin.skin import load_skin

    check_new(command.out)
    skin = load_skin(command.skin)
    lines = ["patch,row,column,x_mm,y_mm,z_mm"]
    for number in skin.find_patches(command.patch):
        patch = skin.patches[number].id
        for taxel in choose_taxels(skin, patch, command.presses).tolist():
            x, y, z = (f"{1e3 * each:.2f}" for each in skin.positions[taxel])
            cell = f"{skin.rows[taxel]},{skin.columns[taxel]}"
            lines.append(f"{patch},{cell},{x},{y},{z}")
    with atomic_path(command.out) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    count = len(lines) - 1
    say(f"{command.out}: {format_count(count, 'point')}; measure where they are")
    return {"points": count, "out": str(command.out)}


@final
class PoseDialogue(Dialogue["PoseGuide"]):
    """Puts presses at known points into words."""

    def describe_press(self, request: "PressRequest") -> str:
        """Describe where to press, and how many points are left."""
        x, y, z = (1e3 * each for each in request.p_link)
        patch = self.guide.points[self.guide.waiting[0]].patch
        count = format_count(len(self.guide.waiting), "point")
        return (
            f"press at x {x:.1f}, y {y:.1f}, z {z:.1f} mm of its link, on patch "
            f"'{patch}'; {count} left"
        )

    def describe_progress(self) -> str:
        """Describe how well the patch of the last press is placed so far."""
        try:
            found = self.guide.estimate(self.guide.presses[-1].point.patch)
        except ValueError:
            return ""
        half = found.half_widths
        return (
            f"; so far to {1e3 * half[3:].max():.1f} mm and "
            f"{np.rad2deg(half[:3].max()):.1f} degrees"
        )

    def describe_skip(self, request: "PressRequest") -> str:
        """Describe that a point is left out."""
        return "the point is left out"


def describe_estimate(estimate: "PoseEstimate", guide: "PoseGuide") -> str:
    """Describe how a patch is moved, with 95 % intervals of each component."""
    half = estimate.half_widths
    turn = ", ".join(
        f"{np.rad2deg(value):+.1f} ± {np.rad2deg(each):.1f}"
        for value, each in zip(estimate.rotation, half[:3], strict=True)
    )
    shift = ", ".join(
        f"{1e3 * value:+.1f} ± {1e3 * each:.1f}"
        for value, each in zip(estimate.shift, half[3:], strict=True)
    )
    count = sum(press.point.patch == estimate.patch for press in guide.presses)
    return (
        f"patch '{estimate.patch}': shifted by {shift} mm and turned by {turn} degrees "
        f"about x, y, z of its link, from {format_count(count, 'press')} that scatter "
        f"by {1e3 * estimate.noise[0]:.1f} mm"
    )


def summarise(estimate: "PoseEstimate") -> dict[str, object]:
    """Return an estimate as plain values."""
    turn, shift = np.split(estimate.deviations, 2)
    return {
        "id": estimate.patch,
        "shift_mm": np.round(1e3 * estimate.shift, 3).tolist(),
        "shift_deviation_mm": np.round(1e3 * shift, 3).tolist(),
        "rotation_deg": np.round(np.rad2deg(estimate.rotation), 3).tolist(),
        "rotation_deviation_deg": np.round(np.rad2deg(turn), 3).tolist(),
        "noise_mm": round(1e3 * estimate.noise[0], 3),
    }
