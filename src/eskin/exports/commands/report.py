"""`eskin report` writes a report of the forces and pressures of touches."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from eskin.cli.checks import POSITIVE, check_writable, load_overrides
from eskin.exports.limits import build_open_limits, read_limits
from eskin.exports.loads import measure_loads
from eskin.exports.report import write_report
from eskin.recording import read_recording
from eskin.units import format_count


@dataclass(frozen=True)
class ReportCommand:
    """Write peak and held force and pressure of every touch of a recording, as HTML.

    With --limits they stand beside limits of your own, as from ISO/TS 15066, none of
    which come with eskin. The report is no safety function.

    The file of limits is YAML: `source` (a text), `quasi_static_after` [s], and
    `regions`, a list of {name, links, patches, transient, quasi_static}, the last two
    {force, pressure} in N and kPa (1 N/cm2 is 10 kPa).
    """

    recording: tyro.conf.Positional[Path]
    """The recording, an .mcap file."""

    limits: Path | None = None
    """YAML file of limits, by region of the skin."""

    held: Annotated[float, POSITIVE] = 1.0
    """Time for which a force or pressure counts as held, without --limits [s]."""

    out: Path | None = None
    """The HTML file; by default the recording's name with the suffix .html."""

    robot_urdf: str | None = None
    """Robot in place of the recorded one, as for its meshes: a URDF file or a preset's
    name."""

    calibration: Path | None = None
    """Calibration file to use in place of the recorded one."""


def run(command: ReportCommand) -> dict[str, object]:
    """Write the report; return the values of each touch."""
    out = command.out or command.recording.with_suffix(".html")
    check_writable(out)
    overrides = load_overrides(command.calibration, command.robot_urdf)
    recording = read_recording(command.recording, overrides)
    limits = build_open_limits(recording.skin, command.held)
    if command.limits is not None:
        limits = read_limits(command.limits, recording.skin)
    found = measure_loads(recording, limits)
    write_report(found, out)
    rows = [
        {
            "region": load.region.name,
            "touch": load.touch.id,
            "onset": load.touch.onset,
            "gesture": load.gesture,
            "clipped": load.is_clipped,
            "above": load.above,
            **{name: value for name, (value, _) in load.values.items()},
        }
        for load in found.loads
    ]
    above = sum(bool(load.above) for load in found.loads)
    loads = format_count(len(rows), "load")
    print(f"{out}: {loads}, {above} above a limit; no safety function")
    return {"loads": rows, "above": above, "doubts": found.list_doubts()}
