"""The index of a set holds a line of JSON for each clip, with plan and touches."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from eskin.errors import GenerationError
from eskin.files import read_file
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.plan import BuildOrigin, ClipPlan, Origin, PairMember

INDEX_NAME = "clips.jsonl"
MAX_INDEX_BYTES = 256 << 20
"""Largest size of an index; a clip takes about 1.5 kB [bytes]."""


@dataclass(frozen=True)
class TouchRow:
    """A touch row describes one true touch of a clip."""

    touch: int
    """Number of the touch in the file, as in `/eskin/truth`."""
    gesture: str
    """Gesture of the vocabulary, `none`, or the name of an unknown gesture."""
    kind: str
    """Variant of the gesture."""
    subject: str
    """Name of the person; empty where no person touched."""
    link: str
    """Link that bears most of the force."""
    onset: float
    """First contact since the start of the clip; negative if before it [s]."""
    end: float
    """Last contact since the start of the clip; may be after its end [s]."""
    impulse: float
    """Force summed over the readings of the clip [N s]."""


@dataclass(frozen=True)
class ClipRow:
    """A clip row describes one clip or stream of a set."""

    file: str
    """Path of its recording below the folder of the set."""
    number: int
    """Number of the clip in the file."""
    start: int
    """Stamp of its first reading [ns since the epoch]."""
    skin: str
    """Name of the skin."""
    pose_group: int
    """Group of the pose at its start."""
    regime: str
    """Distribution of durations as drawn; empty where nothing touched."""
    touches: tuple[TouchRow, ...]
    """True touches of the clip."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""
    plan: ClipPlan
    """Plan of the clip, from which alone it can be simulated again."""

    @property
    def gesture(self) -> str:
        """Return the gesture that the clip shows; empty for a stream."""
        return self.plan.gesture or ""

    @property
    def kind(self) -> str:
        """Return the variant of its gesture as drawn; empty if it is unknown."""
        drawn = self.drawn.get("kind", self.drawn.get("touch0.kind", ""))
        return self.plan.kind or str(drawn)

    @property
    def subject(self) -> str:
        """Return the name of the person."""
        return self.plan.person.name

    @property
    def build(self) -> str:
        """Return the name of the sensor build."""
        return self.plan.build.name

    def to_line(self) -> str:
        """Return the row as one line of JSON, with the fields most used first."""
        facts: dict[str, object] = {
            "file": self.file,
            "number": self.number,
            "start": self.start,
            "gesture": self.gesture,
            "kind": self.kind,
            "subject": self.subject,
            "build": self.build,
            "pose_group": self.pose_group,
            "moving": self.plan.moving,
            "difficulty": self.plan.difficulty,
            "regime": self.regime,
            "skin": self.skin,
            "touches": [asdict(touch) for touch in self.touches],
            "drawn": self.drawn,
            "plan": asdict(self.plan),
        }
        return json.dumps(facts, ensure_ascii=False)

    @classmethod
    def from_line(cls, line: str) -> "ClipRow":
        """Parse a line of the index."""
        facts = json.loads(line)
        parsed: dict[str, Any] = {each.name: facts[each.name] for each in fields(cls)}
        parsed["touches"] = tuple(TouchRow(**touch) for touch in facts["touches"])
        parsed["plan"] = parse_plan(facts["plan"])
        return cls(**parsed)


def parse_plan(facts: dict) -> ClipPlan:
    """Parse the plan in a line of the index."""
    parsed = {
        "seed": tuple(facts["seed"]),
        "person": parse_origin(facts["person"]),
        "session": parse_origin(facts["session"]),
        "build": BuildOrigin(
            **facts["build"] | {"seed": tuple(facts["build"]["seed"])}
        ),
        "groups": tuple(facts["groups"]),
    }
    if facts["company"] is not None:
        parsed["company"] = parse_origin(facts["company"])
    if facts["pose"] is not None:
        parsed["pose"] = tuple(facts["pose"])
    if facts.get("pair") is not None:
        parsed["pair"] = PairMember(**facts["pair"])
    return ClipPlan(**facts | parsed)


def parse_origin(facts: dict) -> Origin:
    """Parse an origin in a line of the index."""
    return Origin(facts["name"], tuple(facts["seed"]))


def build_row(
    file: str,
    number: int,
    start: int,
    skin: str,
    first: int,
    period: float,
    plan: ClipPlan,
    clip: SimulatedClip,
) -> ClipRow:
    """Build the row of a clip.

    `start` is the stamp of its first reading [ns since the epoch], `first` the number
    of its first true touch in the file, `period` the time between two readings [s].
    """
    touches = tuple(
        TouchRow(
            touch=first + place,
            gesture=truth.gesture,
            kind=truth.kind,
            subject=truth.subject,
            link=truth.link,
            onset=float(truth.onset),
            end=float(truth.end),
            impulse=float(truth.force.sum() * period),
        )
        for place, truth in enumerate(clip.truths)
    )
    drawn = {name: to_json_value(value) for name, value in clip.drawn.items()}
    regime = drawn.get("regime", drawn.get("touch0.regime", plan.regime or ""))
    group = int(clip.pose_group)
    return ClipRow(file, number, start, skin, group, str(regime), touches, drawn, plan)


def to_json_value(value: float | str) -> float | str:
    """Return a value that every JSON reader accepts; infinities and NaN are strings."""
    if isinstance(value, str):
        return value
    return float(value) if np.isfinite(value) else str(value)


def read_index(folder: Path | str) -> tuple[ClipRow, ...]:
    """Read every clip of the complete files of a set, in order.

    Raises:
        GenerationError: there is no index, or it cannot be read.
    """
    path = Path(folder) / INDEX_NAME
    try:
        text = read_file(path, MAX_INDEX_BYTES).decode("utf-8", "replace")
        lines = text.splitlines()
    except OSError as error:
        raise GenerationError(
            f"no index {path} ({error.strerror}); generate the set: eskin generate"
        ) from error
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            rows.append(ClipRow.from_line(line))
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise GenerationError(
                f"{path} line {number} is no clip ({type(error).__name__}: {error}); "
                "run the same eskin generate again to repair it"
            ) from error
    return tuple(rows)


def to_text(rows: Iterable[ClipRow]) -> str:
    """Return the lines of rows."""
    return "".join(row.to_line() + "\n" for row in rows)


def remake_clip(row: ClipRow, generator: ClipGenerator) -> SimulatedClip:
    """Simulate one clip of a set again, with the same counts as in its recording.

    Raises:
        GenerationError: the clip generator is of another skin.
    """
    if generator.mounted.skin.name != row.skin:
        raise GenerationError(
            f"clip {row.number} of {row.file} is of skin '{row.skin}', the generator "
            f"of '{generator.mounted.skin.name}'; give a clip generator of that skin"
        )
    return generator.make(row.plan)
