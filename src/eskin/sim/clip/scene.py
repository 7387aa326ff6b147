"""A scene: what happens to the robot, and what the skin feels of it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.clip.truth import TrueTouch
from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.contact import Felt, feel
from eskin.sim.contact.press import Press


@dataclass(frozen=True, eq=False)
class Scene:
    """All that happens between two instants, on the simulator's clock."""

    q: Float[np.ndarray, "time joint"]
    """Joint positions [rad]."""
    touches: tuple[TrueTouch, ...]
    """Their presses start at steps of this scene."""

    @property
    def steps(self) -> int:
        """Length."""
        return len(self.q)


@dataclass(frozen=True, eq=False)
class Part:
    """What one press does within a scene."""

    press: Press
    """The part of the press that lies in the scene."""
    felt: Felt
    """What the skin feels of it."""

    @property
    def span(self) -> slice:
        """Steps of the scene."""
        return slice(self.press.first, self.press.first + self.press.steps)


def parts_of(
    touch: TrueTouch, steps: int, charts: tuple[Chart, ...], constants: Constants
) -> list[Part]:
    """What each press of a touch does within a scene of so many steps."""
    presses = (cropped(press, steps) for press in touch.presses)
    return [
        Part(press, feel(press, charts[press.chart], constants))
        for press in presses
        if press is not None
    ]


def cropped(press: Press, steps: int) -> Press | None:
    """The part of a press that lies in a scene of so many steps, if any."""
    low, high = max(0, -press.first), min(press.steps, steps - press.first)
    if high <= low:
        return None
    return replace(
        press,
        first=press.first + low,
        force=press.force[low:high],
        centre=press.centre[low:high],
        angle=press.angle[low:high],
    )


def add_up(
    parts: list[Part], steps: int, count: int
) -> tuple[Float[np.ndarray, "time active"], Int[np.ndarray, "active"]]:
    """Pressure of all presses together [kPa], and the taxels it is on, ascending.

    Args:
        parts: the presses.
        steps: length of the scene.
        count: taxels of the skin.
    """
    touched = [part.felt.taxels for part in parts]
    taxels = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *touched]))
    column_of = np.zeros(count, dtype=np.int64)
    column_of[taxels] = np.arange(len(taxels))
    pressure = np.zeros((steps, len(taxels)))
    for part in parts:
        pressure[part.span, column_of[part.felt.taxels]] += part.felt.pressure
    return pressure, taxels
