"""The clips of a generated set, from the index beside its recordings."""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from eskin.errors import RecordingError
from eskin.units import NS_PER_S

INDEX_NAME = "clips.jsonl"


@dataclass(frozen=True)
class Clip:
    """One clip: what was done in two seconds of a recording."""

    start: int
    """Stamp of its first reading [ns since the epoch]."""
    end: int
    """Stamp behind its last one [ns since the epoch]."""
    gesture: str
    """What it was made for."""
    kind: str
    """Variant of the gesture."""


def clips_of(path: Path) -> tuple[Clip, ...]:
    """The clips of a recording, in order; none where it is no file of a set of clips.

    Raises:
        RecordingError: there is an index that cannot be read.
    """
    for folder in (path.parent, path.parent.parent):
        index = folder / INDEX_NAME
        if index.is_file():
            name = path.relative_to(folder).as_posix()
            return read_clips(index).get(name, ())
    return ()


@lru_cache(maxsize=4)
def read_clips(index: Path) -> dict[str, tuple[Clip, ...]]:
    """The clips of each file of a set."""
    found: dict[str, list[Clip]] = {}
    for number, line in enumerate(index.read_text(encoding="utf-8").splitlines(), 1):
        try:
            facts = json.loads(line)
            if facts["gesture"]:
                start, seconds = int(facts["start"]), float(facts["plan"]["seconds"])
                clip = Clip(
                    start,
                    start + round(seconds * NS_PER_S),
                    str(facts["gesture"]),
                    str(facts["kind"]),
                )
                found.setdefault(str(facts["file"]), []).append(clip)
        except (ValueError, KeyError, TypeError) as error:
            raise RecordingError(
                f"{index} line {number} is no clip ({type(error).__name__}: {error}); "
                "run the same eskin generate again to repair it"
            ) from error
    return {name: tuple(clips) for name, clips in found.items()}
