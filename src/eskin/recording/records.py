"""This module defines the plain data that a recording stores besides its scans."""

from dataclasses import asdict, dataclass, field

RECORD_NAME = "eskin"
SKIN_NAME = "skin"
CALIBRATION_NAME = "calibration.json"
URDF_NAME = "robot.urdf"
FORMAT = "1"
NOTE = "note."
PARTLY_LABELLED = {"labels": "corrections"}
"""Notes of a recording in which only some touches have labels: those that a person has
corrected. Of the others it is not known that they were no gesture."""


@dataclass(frozen=True)
class Metadata:
    """Metadata describe the origin of a recording; empty text means unknown."""

    dataset: str = ""
    """Name of the dataset that the recording belongs to."""
    subject: str = ""
    """Name of the person who touched the skin."""
    session: str = ""
    """Name of the session; recordings of one session belong in one fold."""
    gesture_set: str = ""
    """Name of the vocabulary of the labels."""
    notes: dict[str, str] = field(default_factory=dict)
    """Other facts by name."""

    @property
    def simulated(self) -> bool:
        """Return whether `eskin generate` made it, so that its truth is known."""
        return self.notes.get("simulated") == "true"

    @property
    def partly_labelled(self) -> bool:
        """Return whether touches without a label may have been gestures, too."""
        return PARTLY_LABELLED.items() <= self.notes.items()

    def to_record(self) -> dict[str, str]:
        """Return the flat map of strings that an MCAP metadata record holds."""
        facts = {key: value for key, value in asdict(self).items() if key != "notes"}
        return facts | {NOTE + key: self.notes[key] for key in sorted(self.notes)}

    @classmethod
    def from_record(cls, record: dict[str, str]) -> "Metadata":
        """Build metadata from such a map; ignore other keys."""
        keys = ("dataset", "subject", "session", "gesture_set")
        notes = {k.removeprefix(NOTE): record[k] for k in record if k.startswith(NOTE)}
        return cls(*(record.get(key, "") for key in keys), notes=notes)


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DetectionRecord:
    """A detection as a recording stores it."""

    stamp: int
    """Time of the detection [ns since the epoch]."""
    gesture: str
    """Name of the gesture."""
    confidence: float
    """Calibrated probability."""
    onset: int
    """First reading of the touch [ns since the epoch]."""
    end: int
    """Last reading of the touch so far [ns since the epoch]."""
    link: str
    """Link with the largest share of the touch."""
    patch: str
    """Patch with the largest share of the touch."""
    p_world: Vector
    """Force-weighted centre [m]."""
    n_world: Vector
    """Mean outward unit normal."""
    direction_world: Vector
    """Unit direction of travel; zero if the touch did not move."""
    peak_force: float
    """Largest force of the touch [N]."""


@dataclass(frozen=True)
class EventRecord:
    """An event of the skin or a part of it as a recording stores it."""

    stamp: int
    """Time at which it was noticed [ns since the epoch]."""
    kind: str
    """Kind of event, as in `eskin.drivers.Event`."""
    text: str
    """Description as a sentence."""
    patch: str | None = None
    """Name of the patch, if it concerns one."""
    row: int | None = None
    """Row in the patch, if it concerns a row or a taxel."""
    column: int | None = None
    """Column in the patch, if it concerns a column or a taxel."""
    taxel: int | None = None
    """Index of the taxel in the skin, if it concerns one taxel."""


@dataclass(frozen=True)
class TruthRecord:
    """The ground truth of one touch at one reading, known for a simulated skin."""

    stamp: int
    """Time of the reading [ns since the epoch]."""
    touch: int
    """Number of the touch in its file."""
    gesture: str
    """Name of the gesture; `none` if it is not in the vocabulary."""
    kind: str
    """Variant of the gesture."""
    link: str
    """Link that takes most of the force."""
    force: float
    """Total force on the skin [N]."""
    area: float
    """Contact area [m2]."""
    p_world: Vector
    """Centre of the force [m]."""
