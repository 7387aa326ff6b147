"""What virtual patches are plugged into: the abstract port."""

from abc import abstractmethod

from eskin.closing import Closing


class Port(Closing):
    """Takes what patches say to whoever listens.

    Attributes:
        framed: whether packets need framing on it, as on a serial line.
        unheard: packets that nobody was there for, or had no room for.
        bytes: how many were sent.
    """

    framed: bool

    def __init__(self) -> None:
        """Start counting."""
        self.unheard = 0
        self.bytes = 0

    @property
    @abstractmethod
    def uri(self) -> str:
        """What a listener opens it by."""

    @abstractmethod
    def send(self, chunks: list[bytes]) -> None:
        """Send packets, framed where the port wants that; each whole or not at all."""

    @abstractmethod
    def flush(self) -> None:
        """Wait until what was sent has been taken, if somebody takes it."""

    @abstractmethod
    def unplug(self) -> None:
        """Vanish, as the port of a module without power does."""

    @abstractmethod
    def plug(self) -> None:
        """Be there again."""
