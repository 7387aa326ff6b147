"""Where a recording is played, and how fast."""

from typing import final


@final
class Playing:
    """A place on a timeline that moves on while it is played.

    Attributes:
        length: of the recording [s].
        seconds: where it is [s].
        speed: seconds of the recording in a second.
        is_on: whether it moves on.
    """

    def __init__(self, length: float) -> None:
        """Stand at the beginning."""
        self.length = length
        self.seconds = 0.0
        self.speed = 1.0
        self.is_on = False

    def seek(self, seconds: float) -> None:
        """Go somewhere [s]; not beyond either end."""
        self.seconds = min(max(seconds, 0.0), self.length)

    def toggle(self) -> None:
        """Play or pause; at the end, play from the beginning."""
        if not self.is_on and self.seconds >= self.length:
            self.seconds = 0.0
        self.is_on = not self.is_on

    def advance(self, elapsed: float) -> bool:
        """Let time pass [s]; whether the place has changed."""
        if not self.is_on:
            return False
        self.seek(self.seconds + elapsed * self.speed)
        self.is_on = self.seconds < self.length
        return True
