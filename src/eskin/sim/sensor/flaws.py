"""Flaws are what real sensors add to the builds of the first sets, and how far."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import Constants

Family = Literal["divider", "logarithmic", "capacitive", "linear"]
"""Name of a family of sensors."""

FAMILIES: tuple[Family, ...] = get_args(Family)
"""Families of sensors: piezoresistive with a divider or a logarithmic converter,
capacitive, and linear (barometric or strain)."""

FLAWS = (
    "noise",
    "noisy_taxels",
    "touched_noise",
    "line_noise",
    "drift",
    "thermal",
    "offset",
    "jumps",
    "gain",
    "exponent",
    "activation",
    "bend",
    "creep",
    "lag",
    "after",
    "hysteresis",
    "quantisation",
    "neighbours",
    "lines",
    "proximity",
    "dead",
    "stuck",
    "intermittent",
    "dead_line",
    "jitter",
    "lost",
    "repeated",
    "corrupt",
    "rate",
)
"""Flaws that a build of a family may have."""

FlawLevel = Literal["typical", "high"]
"""How strong a flaw is: typical or high in the ranges of the constants."""


@dataclass(frozen=True, eq=False)
class Flaws:
    """Flaws hold what only builds of families have, of the layer and of the readout."""

    rise: float
    """Time constant with which the signal of a taxel rises [s]."""
    fall: float
    """Time constant with which it falls [s]."""
    residue: float
    """Part of the creep that a released taxel still shows; it goes as it came."""
    after_tail: float
    """Share of touches of a taxel that leave a large shift of the baseline."""
    after_tail_size: float
    """Size of that shift, of either sign, by full scale."""
    neighbours: float
    """Part of each of its four neighbours that a taxel reads."""
    column_leak: float
    """Part of the sum of the others of its column that a taxel reads."""
    row_leak: float
    """Part of the sum of the others of its row that a taxel reads."""
    proximity: float
    """Apparent pressure under a body about to touch, by that at half scale; zero
    unless capacitive."""
    proximity_reach: float
    """Distance sideways over which it falls [m]."""
    proximity_times: tuple[float, float]
    """Time constants with which it grows before a contact and falls after it [s]."""
    noise_factor: Float[np.ndarray, "taxel"]
    """Noise of each taxel by that of the electronics."""
    touched_noise: float
    """Noise that a touch adds, by full scale, the same at every level."""
    line_noise: float
    """Share of the variance at rest that the taxels of a row have in common."""
    drift: Float[np.ndarray, "process"]
    """Deviations of the slow processes whose sum falls as 1/f, by full scale."""
    drift_times: Float[np.ndarray, "process"]
    """Time constants of these processes [s]."""
    offset_per_kelvin: Float[np.ndarray, "taxel"]
    """Shift of the reading at rest with temperature, by full scale [1/K]."""
    warming: float
    """Deviation of the rate at which a session warms [K/s]."""
    jumps: float
    """Rate of steps of a taxel's reading that stay [1/s]."""
    jump_size: tuple[float, float, float]
    """Median, geometric deviation and largest size of these steps, by full scale."""
    intermittent: Int[np.ndarray, "some"]
    """Taxels whose contact is intermittent."""
    swings: Float[np.ndarray, "some"]
    """Reading of each of these without contact, by full scale."""
    swing_times: tuple[float, float]
    """Mean times for which they work, and for which they do not [s]."""
    corrupt: float
    """Share of values that are wrong in one reading."""
    corrupt_size: tuple[float, float]
    """Least and largest size of what is added to them, by full scale."""
    repeated: float
    """Share of readings of a patch that repeat its last one."""
    stamp_jitter: float
    """Deviation of a reading's stamp [s]."""
    cut: int
    """Counts below which the converter gives zero."""


@final
class FlawDraw:
    """A flaw draw takes each constant of the flaws at a level, or draws it."""

    def __init__(
        self,
        family: Family,
        levels: Mapping[str, FlawLevel] | None,
        constants: Constants,
        rng: np.random.Generator,
    ) -> None:
        """Prepare to draw the flaws of a build.

        Args:
            family: one of `FAMILIES`.
            levels: level of each flaw that the build has; None draws all of them.
            constants: constants of the simulation.
            rng: random generator.

        Raises:
            ValueError: there is no such family, flaw or level.
        """
        check_names("family", [family], FAMILIES)
        check_names("flaw", levels or (), FLAWS)
        check_names("level", (levels or {}).values(), ("typical", "high"))
        self.family, self.levels = family, levels
        self.constants, self.rng = constants, rng

    def has(self, flaw: str) -> bool:
        """Tell whether the build has a flaw."""
        return self.levels is None or flaw in self.levels

    def find_name(self, name: str) -> str:
        """Return the name of a constant, of the family itself where it has its own."""
        own = f"{name}.{self.family}"
        return own if own in self.constants.entries else name

    def take(self, flaw: str, name: str, intact: float = 0.0) -> float:
        """Return a constant of a flaw; `intact` where the build does not have it."""
        if not self.has(flaw):
            return intact
        full = self.find_name(f"flaw.{name}")
        if self.levels is None:
            return self.constants.draw(full, self.rng)
        return self.constants.at_level(full, self.levels[flaw])

    def take_product(self, name: str) -> float:
        """Return what the data sheet says, typical where flaws have levels."""
        full = self.find_name(f"family.{name}")
        if self.constants.get_constant(full).spread is None:
            return self.constants.value(full)
        if self.levels is None:
            return self.constants.draw(full, self.rng)
        return self.constants.at_level(full, "typical")

    def take_signed(self, flaw: str, name: str) -> float:
        """Return a constant of a flaw with either sign."""
        return self.take(flaw, name) * (1.0 if self.rng.random() < 0.5 else -1.0)


def check_names(what: str, names: Iterable[str], allowed: tuple[str, ...]) -> None:
    """Refuse names that are not allowed."""
    for name in names:
        if name not in allowed:
            raise ValueError(
                f"{what} is {name!r}; allowed are {', '.join(allowed)}; correct it"
            )
