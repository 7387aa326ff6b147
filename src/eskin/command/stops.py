"""Since when an arm is paused and held, whoever asked for it."""

from typing import final

from eskin.command.arm import ArmState
from eskin.units import NS_PER_S


@final
class Stops:
    """Follows the arm's state; all times are in ns since the epoch."""

    def __init__(self) -> None:
        """It is neither paused nor held."""
        self.paused_since: int | None = None
        self.held_since: int | None = None
        self.pauses = 0

    def look(self, state: ArmState, now: int) -> None:
        """Take in the arm's state at a time."""
        if self.paused_since is None or state.pauses != self.pauses:
            self.pause(state, now)
        if not state.paused:
            self.paused_since = None
        held = now if self.held_since is None else self.held_since
        self.held_since = None if state.holding is None else held

    def pause(self, state: ArmState, now: int) -> None:
        """Take in that it was paused just now, paused already or not."""
        self.paused_since, self.pauses = now, state.pauses

    def hold(self, now: int) -> None:
        """Take in that it was held just now."""
        self.held_since = now

    def resume(self) -> None:
        """Take in that a pause is over."""
        self.paused_since = None

    def objection(self, onset: int, now: int, least: float) -> str | None:
        """Why a touch must not set the arm in motion; None: it may once it ends.

        Args:
            onset: of the touch.
            now: the time.
            least: how long a pause lasts at least [s].
        """
        if self.paused_since is None:
            return "nobody has paused it"
        if onset <= self.paused_since:
            return "the touch began before the pause"
        if self.held_since is not None and onset <= self.held_since:
            return "the touch began before the hold"
        passed = (now - self.paused_since) / NS_PER_S
        return f"it was paused only {passed:.1f} s ago" if passed < least else None
