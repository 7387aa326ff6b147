"""Tracks: contacts through time, keeping their ids across patches and links."""

from dataclasses import dataclass

from eskin.touch.contacts import Contact


@dataclass(frozen=True, eq=False)
class Track:
    """A contact through time."""

    id: int
    """Counts up from 1 in the order of appearance."""

    onset: int
    """Stamp of its first reading [ns since the epoch]."""

    last: int
    """Stamp of its last reading with contact [ns since the epoch]."""

    contact: Contact
    """Its contact at `last`."""

    parent: int | None = None
    """The track that it split off from."""

    merged_into: int | None = None
    """The track that took its contact over when two contacts became one."""

    ended: bool = False
    """True once there is no contact any more."""


@dataclass(frozen=True)
class TrackConfig:
    """How far a contact may move between two readings."""

    gate: float = 0.03
    """Distance that the centre may jump at once [m]."""

    speed: float = 1.0
    """Speed by which that distance grows with the time between readings [m/s]."""

    coast_seconds: float = 0.2
    """How long a track waits while most of its taxels are not received [s]."""

    gap_seconds: float = 0.5
    """After how long without a reading every track has ended [s]."""
