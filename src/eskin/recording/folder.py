"""Finding recordings in folders."""

from collections.abc import Iterable
from pathlib import Path

from eskin.errors import RecordingError


def find_recordings(places: Iterable[Path | str]) -> tuple[Path, ...]:
    """The files given, and all `.mcap` files below the folders given, sorted.

    Raises:
        RecordingError: when a place does not exist or a folder holds no recording.
    """
    found: list[Path] = []
    for place in map(Path, places):
        if place.is_dir():
            inside = sorted(place.rglob("*.mcap"))
            if not inside:
                raise RecordingError(
                    f"no .mcap file below {place}; convert or record some first"
                )
            found += inside
        elif place.is_file():
            found.append(place)
        else:
            raise RecordingError(
                f"no recording at {place}; give .mcap files or folders that hold some"
            )
    once: dict[Path, Path] = {}
    for path in found:
        once.setdefault(path.resolve(), path)
    return tuple(once.values())
