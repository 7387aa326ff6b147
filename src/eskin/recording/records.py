"""This module defines the plain data that a recording stores besides its scans."""

from dataclasses import asdict, dataclass, field

RECORD_NAME = "eskin"
SKIN_NAME = "skin"
CALIBRATION_NAME = "calibration.json"
FORMAT = "1"
NOTE = "note."


@dataclass(frozen=True)
class Metadata:
    """Where a recording comes from. Empty text means unknown."""

    dataset: str = ""
    """Name of the set that the recording belongs to."""
    subject: str = ""
    """Who touched."""
    session: str = ""
    """Name of the sitting; recordings of one session belong in one fold."""
    gesture_set: str = ""
    """Name of the vocabulary that the labels are from."""
    notes: dict[str, str] = field(default_factory=dict)
    """Anything else worth keeping, by name."""

    @property
    def simulated(self) -> bool:
        """Whether `eskin generate` made it, so that all that happens is known."""
        return self.notes.get("simulated") == "true"

    def to_record(self) -> dict[str, str]:
        """As the flat map of strings that an MCAP metadata record holds."""
        facts = {key: value for key, value in asdict(self).items() if key != "notes"}
        return facts | {NOTE + key: self.notes[key] for key in sorted(self.notes)}

    @classmethod
    def from_record(cls, record: dict[str, str]) -> "Metadata":
        """From such a map; keys that mean nothing here are left out."""
        notes = {
            key.removeprefix(NOTE): value
            for key, value in record.items()
            if key.startswith(NOTE)
        }
        return cls(
            record.get("dataset", ""),
            record.get("subject", ""),
            record.get("session", ""),
            record.get("gesture_set", ""),
            notes,
        )


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DetectionRecord:
    """What was said of one touch, and when."""

    stamp: int
    """When it was said [ns since the epoch]."""
    gesture: str
    """Name of the gesture."""
    confidence: float
    """Calibrated probability."""
    onset: int
    """First instant of the touch [ns since the epoch]."""
    end: int
    """Last instant of the touch so far [ns since the epoch]."""
    link: str
    """Link touched most."""
    patch: str
    """Patch touched most."""
    p_world: Vector
    """Force-weighted centre [m]."""
    n_world: Vector
    """Mean outward normal, unit."""
    direction_world: Vector
    """Direction of travel, unit; zero where the touch stood still."""
    peak_force: float
    """Largest force of the touch [N]."""


@dataclass(frozen=True)
class EventRecord:
    """Something that happened to the skin or a part of it while it streamed."""

    stamp: int
    """When it was noticed [ns since the epoch]."""
    kind: str
    """What happened, as in `eskin.drivers.Event`."""
    text: str
    """The same as a sentence."""
    patch: str | None = None
    """Its patch, where it is of one."""
    row: int | None = None
    """Row in its patch, where it is of a row or taxel."""
    column: int | None = None
    """Column in its patch, where it is of a column or taxel."""
    taxel: int | None = None
    """Index in the skin, where it is of one taxel."""


@dataclass(frozen=True)
class TruthRecord:
    """One touch at one reading, known where the skin is simulated."""

    stamp: int
    """Of the reading [ns since the epoch]."""
    touch: int
    """Number of the touch in its file."""
    gesture: str
    """Name of the gesture; `none` where it is none of the vocabulary."""
    kind: str
    """Variant of the gesture."""
    link: str
    """Link that bears most of it."""
    force: float
    """Total force on the skin [N]."""
    area: float
    """Contact area [m2]."""
    p_world: Vector
    """Centre of the force [m]."""
