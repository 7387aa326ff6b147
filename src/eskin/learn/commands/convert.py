"""`eskin convert` converts a public data set to recordings."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from eskin.cli.checks import Range
from eskin.errors import RecordingError
from eskin.learn.sets import (
    ConversionResult,
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
)
from eskin.units import format_count

NOMINAL = Range(0, 1000, is_open=True)
"""Allowed pitch [mm] and full scale [kPa] of a public set."""


@dataclass(frozen=True)
class ConvertCommand:
    """Convert a public dataset of touch gestures to recordings."""

    dataset: tyro.conf.Positional[Literal["sleeve", "shearsense", "socialtouch"]]
    """Name of the dataset."""

    src: tyro.conf.Positional[Path]
    """Folder with the dataset's own files."""

    out: tyro.conf.Positional[Path]
    """Folder for the recordings, one .mcap for each source file. It is made if it is
    missing."""

    pitch_mm: Annotated[float | None, NOMINAL] = None
    """Distance of neighbouring taxels [mm], of socialtouch alone, which states none. By
    default it is taken as unknown, and all contacts at a time are one touch."""

    full_scale_kpa: Annotated[float | None, NOMINAL] = None
    """Pressure at full scale [kPa], of socialtouch alone; 100 by default."""


def run(command: ConvertCommand) -> dict[str, object]:
    """Convert, and return the numbers of recordings, taxels, readings and labels."""
    options = get_geometry_options(command)
    convert: dict[str, Callable[..., ConversionResult]] = {
        "sleeve": convert_sleeve,
        "shearsense": convert_shearsense,
        "socialtouch": convert_socialtouch,
    }
    result = convert[command.dataset](command.src, command.out, **options)
    print(
        f"{command.out}: {format_count(result.recordings, 'recording')} of "
        f"{format_count(result.taxels, 'taxel')}, "
        f"{format_count(result.readings, 'reading')}, "
        f"{format_count(result.labels, 'label')}"
    )
    return asdict(result)


def get_geometry_options(command: ConvertCommand) -> dict[str, float]:
    """Return what was given of pitch [m] and full scale [kPa]; raise if it is wrong."""
    options = {}
    for name, unit in (("pitch_mm", 1e-3), ("full_scale_kpa", 1.0)):
        value = getattr(command, name)
        if value is None:
            continue
        option = "--" + name.replace("_", "-")
        if command.dataset != "socialtouch":
            raise RecordingError(
                f"{option} is given for {command.dataset}; allowed is socialtouch; "
                "leave it out"
            )
        options[name.removesuffix("_mm")] = value * unit
    return options
