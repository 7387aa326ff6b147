"""What a recording keeps of one event."""

from dataclasses import dataclass


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
