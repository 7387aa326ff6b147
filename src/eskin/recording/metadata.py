"""Who and what was recorded."""

from dataclasses import asdict, dataclass, field

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
