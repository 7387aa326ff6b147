"""`eskin skin pose` measures where a patch is mounted, with a person's help."""

import math
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro

from eskin.cli.checks import check_folder
from eskin.cli.guided import GuidedCommand, open_guided_source, print_line
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.calibration.pose import PoseEstimate, PoseGuide
    from eskin.touch import Scan


@dataclass(frozen=True, kw_only=True)
class PoseCommand(GuidedCommand):
    """Measure where patches are mounted, and write a skin with them where they are.

    Take all hands off for three seconds, then press each point of a file with one
    fingertip, in their order, firmly, for about a second. Points are places on the
    outside of the patches, measured on the link: five or more of a patch, spread over
    it. Ctrl-C writes nothing.
    """

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH (one or several) or udp://HOST:PORT; or replay:FILE, a
    recording of rest and then of the presses."""

    points: Path
    """CSV file of the points, with columns patch, x_mm, y_mm, z_mm in the frame of the
    patch's link."""

    out: Path
    """Folder of the corrected skin."""

    wait: float = 30.0
    """Longest time to wait for each press before its point is left out [s]."""


def run(command: PoseCommand) -> dict[str, object]:
    """Guide through the presses, write the skin and return what was measured."""
    from eskin.calibration.pose import PoseGuide, move_patch, read_points
    from eskin.skin import MountedSkin, save_skin

    if not 1.0 <= command.wait < math.inf:
        raise ValueError(
            f"--wait is {command.wait:g}; allowed are 1 and above; change it"
        )
    check_folder(command.out)
    is_live = not (command.source and command.source[0].startswith("replay:"))
    with ExitStack() as stack:
        source = open_guided_source(command, math.inf, stack)
        info = source.info
        points = read_points(command.points, info.skin)
        mounted = MountedSkin(info.skin, info.load_robot(command.robot_urdf))
        guide = PoseGuide(mounted, info.calibration, points)
        guide_person(source, guide, command.wait if is_live else math.inf)
    skin = info.skin
    estimates = guide.finish()
    for estimate in estimates:
        skin = move_patch(skin, estimate)
        print_line(describe_estimate(estimate, guide))
    save_skin(skin, command.out)
    print_line(f"written to {command.out}")
    return {
        "presses": len(guide.presses),
        "out": str(command.out),
        "patches": [summarise(each) for each in estimates],
    }


def guide_person(scans: "Iterable[Scan]", guide: "PoseGuide", wait: float) -> None:
    """Push scans until all points are pressed, and say what to do and what was felt.

    Args:
        scans: scans of the skin.
        guide: guide through the presses.
        wait: longest time to wait for each press [s]; infinite for a recording.
    """
    from eskin.units import NS_PER_S

    print_line("hands off for 3 s")
    since = 0
    for scan in scans:
        event = guide.push(scan)
        late = guide.rested and scan.stamp - since > wait * NS_PER_S
        if event is not None:
            since = scan.stamp
            print_line({"refused": f"  {event.text}: not used"}.get(event.kind, ""))
            print_line("  felt" if event.kind == "pressed" else "")
        elif late:
            since = scan.stamp
            print_line("  nothing felt: the point is left out")
            guide.skip()
        if guide.is_done:
            return
        if event is not None or late:
            print_line(describe_request(guide))


def describe_request(guide: "PoseGuide") -> str:
    """Describe the point to press next."""
    point = guide.waiting[0]
    x, y, z = (1e3 * each for each in point.p_link)
    return (
        f"press at x {x:.1f}, y {y:.1f}, z {z:.1f} mm of its link, on patch "
        f"'{point.patch}'; {format_count(len(guide.waiting), 'point')} left"
    )


def describe_estimate(estimate: "PoseEstimate", guide: "PoseGuide") -> str:
    """Describe how a patch is moved, with 95 % intervals of each component."""
    half = 1.96 * estimate.deviations
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
