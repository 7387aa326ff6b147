"""`eskin convert`: public sets of touch gestures to recordings."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True)
class Command:
    """Convert a public set of touch gestures to recordings."""

    dataset: tyro.conf.Positional[Literal["sleeve", "shearsense", "socialtouch"]]
    """Which set it is."""

    src: tyro.conf.Positional[Path]
    """Folder with the set's own files."""

    out: tyro.conf.Positional[Path]
    """Folder for the recordings, one .mcap a source file; made if it is missing."""


def run(command: Command) -> dict[str, object]:
    """Convert and return recordings, taxels, readings and labels."""
    from eskin.recording import (
        convert_shearsense,
        convert_sleeve,
        convert_socialtouch,
    )

    convert = {
        "sleeve": convert_sleeve,
        "shearsense": convert_shearsense,
        "socialtouch": convert_socialtouch,
    }
    result = convert[command.dataset](command.src, command.out)
    print(
        f"{command.out}: {result.recordings} recordings of {result.taxels} taxels, "
        f"{result.readings} readings, {result.labels} labels"
    )
    return asdict(result)
