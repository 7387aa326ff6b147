"""`eskin convert` converts a public data set to recordings."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from eskin.app import SourceConfig, load_calibration
from eskin.cli.checks import Needs, Range
from eskin.errors import RecordingError
from eskin.sets.conversion import ConversionResult, SetName, check_source
from eskin.sets.shearsense import convert_shearsense
from eskin.sets.skin_table import ReadingLayout, convert_readings
from eskin.sets.sleeve import convert_sleeve
from eskin.sets.socialtouch import convert_socialtouch
from eskin.sets.table import LAYOUTS, TableLayout, convert_table
from eskin.sets.taxel_poses import PoseFit
from eskin.skin import mount_skin
from eskin.units import format_count

NOMINAL = Range(0, 1000, is_open=True)
"""Allowed pitch [mm] and full scale [kPa] of a public set."""


@dataclass(frozen=True)
class ConvertCommand:
    """Convert a public dataset of touch gestures, or a table, to recordings."""

    dataset: tyro.conf.Positional[Literal[SetName, "table"]]
    """Name of the dataset, or table: frames of any CSV or npz file, or with --skin
    readings of a whole skin of any npz or Parquet file."""

    src: tyro.conf.Positional[Path]
    """Folder with the dataset's own files."""

    out: tyro.conf.Positional[Path]
    """Folder for the recordings, one .mcap for each source file. It is made if it is
    missing."""

    pitch_mm: Annotated[float | None, NOMINAL] = None
    """Distance of neighbouring taxels [mm], not of sleeve and shearsense. By default it
    is taken as unknown, and all contacts at a time are one touch."""

    full_scale_kpa: Annotated[float | None, NOMINAL] = None
    """Pressure at full scale [kPa], not of sleeve and shearsense; 100 by default."""

    skin: str | None = None
    """Skin of a table whose readings are of a whole skin, with joint positions or the
    pose of each taxel: a preset's name, or a folder with skin.yaml."""

    robot_urdf: Annotated[str | None, Needs("skin")] = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    calibration: Annotated[Path | None, Needs("skin")] = None
    """Calibration of counts; by default calibration.json in the skin's folder, else the
    nominal one."""

    rows: Annotated[int | None, Range(1, 1000)] = None
    """Rows of the grid of a table; of a known one it changes them, as do all below."""

    columns: Annotated[int | None, Range(1, 1000)] = None
    """Columns of the grid: the last rows x columns columns of a CSV file."""

    rate: Annotated[float | None, Range(1, 10_000)] = None
    """Readings a second [Hz]."""

    label: str | None = None
    """Column of the gesture; its name, or the beginning of one alone, in any case."""

    person: str | None = None
    """Column of the person; without one, the name of the file."""

    trial: tuple[str, ...] | None = None
    """Columns that change with each repetition, beside label and person."""

    frame: str | None = None
    """Column that counts the readings of a repetition from its start."""

    full_scale: Annotated[float | None, Range(0, is_open=True)] = None
    """Greatest value; by default the least 2^n - 1 that none exceeds, of fractions the
    greatest."""


GEOMETRY = ("pitch_mm", "full_scale_kpa")
"""Options of all sets that state no geometry and units."""
COLUMNS = tuple(each.name for each in fields(TableLayout) if each.name != "names")
"""Options of tables."""
READINGS = ("skin", "robot_urdf", "calibration")
"""Options of tables of readings of a whole skin alone."""
NAMED = ("label", "person", "rate")
"""Options of tables that readings of a whole skin take, too."""
ASSUMED: dict[str, tuple[str, ...]] = {
    "sleeve": (),
    "shearsense": (),
    "socialtouch": GEOMETRY,
}
"""Options of the sets that are no tables."""


def run(command: ConvertCommand) -> dict[str, object]:
    """Convert, and return the numbers of recordings, taxels, readings and labels."""
    name = command.dataset
    check_source(command.src)
    check_given(command)
    options = get_geometry_options(command)
    convert: dict[str, Callable[..., ConversionResult]] = {
        "sleeve": convert_sleeve,
        "shearsense": convert_shearsense,
        "socialtouch": convert_socialtouch,
    }
    fit = None
    if name in convert:
        result = convert[name](command.src, command.out, **options)
    elif command.skin is not None:
        layout = build_reading_layout(command, command.skin)
        result, fit = convert_readings(command.src, command.out, layout)
    else:
        layout = choose_layout(command)
        result = convert_table(command.src, command.out, layout, name, **options)
    print(
        f"{command.out}: {format_count(result.recordings, 'recording')} of "
        f"{format_count(result.taxels, 'taxel')}, "
        f"{format_count(result.readings, 'reading')}, "
        f"{format_count(result.labels, 'label')}"
    )
    told: dict[str, object] = asdict(result)
    if fit is not None:
        print(describe_fit(fit))
        told["poses"] = {
            "worst_mm": 1e3 * fit.worst,
            "rms_mm": 1e3 * fit.rms,
            "where": fit.where,
            "unsolved": fit.unsolved,
        }
    return told


def describe_fit(fit: PoseFit) -> str:
    """Describe how well joint positions fit poses, and which joints are not known."""
    text = (
        f"poses: taxels lie {1e3 * fit.rms:.3g} mm (RMS) from where the joint "
        f"positions put them, at most {1e3 * fit.worst:.3g} mm ({fit.where})"
    )
    if fit.unsolved:
        text += f"; joints that move no taxel are zero: {', '.join(fit.unsolved)}"
    return text


def build_reading_layout(command: ConvertCommand, skin: str) -> ReadingLayout:
    """Return how tables of readings of a skin are read."""
    mounted = mount_skin(skin, command.robot_urdf)
    config = SourceConfig(skin=skin, calibration=command.calibration)
    calibration = load_calibration(config, mounted.skin)
    calibration.check_skin(mounted.skin)
    given = {name: getattr(command, name) for name in NAMED}
    given = {name: value for name, value in given.items() if value is not None}
    return ReadingLayout(mounted, calibration, **given)


def check_given(command: ConvertCommand) -> None:
    """Raise if an option is given that the set does not take."""
    grids = (*GEOMETRY, *COLUMNS)
    allowed = ASSUMED.get(command.dataset, grids)
    if command.dataset == "table":
        allowed = grids if command.skin is None else (*READINGS, *NAMED)
    for name in (*grids, *READINGS):
        if getattr(command, name) is None or name in allowed:
            continue
        names = [key for key, takes in ASSUMED.items() if name in takes]
        names += [*LAYOUTS, "table"] if name in grids else ["table with --skin"]
        given_for = command.dataset + " with --skin" * (command.skin is not None)
        raise RecordingError(
            f"{to_option(name)} is given for {given_for}; allowed are "
            f"{', '.join(names)}; leave it out"
        )


def get_geometry_options(command: ConvertCommand) -> dict[str, float]:
    """Return what was given of pitch [m] and full scale [kPa]."""
    given = {"pitch": command.pitch_mm, "full_scale_kpa": command.full_scale_kpa}
    units = {"pitch": 1e-3, "full_scale_kpa": 1.0}
    return {name: value * units[name] for name, value in given.items() if value}


def choose_layout(command: ConvertCommand) -> TableLayout:
    """Return the layout of the set with the given options, or the layout of a table."""
    given = {name: getattr(command, name) for name in COLUMNS}
    given = {name: value for name, value in given.items() if value is not None}
    known = LAYOUTS.get(command.dataset)
    if known is not None:
        names = () if "label" in given else known.names
        return replace(known, **given, names=names)
    missing = [n for n in ("rows", "columns", "rate", "label") if n not in given]
    if missing:
        raise RecordingError(
            f"a table without {', '.join(map(to_option, missing))}; allowed is a grid "
            "with them, or the readings of a whole skin, with poses or not, with "
            "--skin; give what its files are"
        )
    return TableLayout(**given)


def to_option(name: str) -> str:
    """Return the option of a field."""
    return "--" + name.replace("_", "-")
