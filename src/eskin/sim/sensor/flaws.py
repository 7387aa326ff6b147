"""Flaws are what real sensors add to the builds of the first sets, and how far."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import MM, Constants
from eskin.skin import Skin

Family = Literal["divider", "logarithmic", "capacitive", "linear"]
"""Name of a family of sensors."""

FAMILIES: tuple[Family, ...] = get_args(Family)
"""Families of sensors: piezoresistive with a divider or a logarithmic converter,
capacitive, and linear (barometric or strain)."""

RESISTIVE = ("divider", "logarithmic")
"""Families of piezoresistive layers, with a gap to close and detours through others."""

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
    """Noise of each taxel over the noise of the electronics."""
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
    """Least and largest number that is added to them, by full scale."""
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

        `levels` holds the level of each flaw that the build has; None draws all of
        them.

        Raises:
            ValueError: there is no such family, flaw or level.
        """
        check_names("family", [family], FAMILIES)
        check_names("flaw", levels or (), FLAWS)
        check_names("level", (levels or {}).values(), ("typical", "high"))
        self.family = family
        self.levels = levels
        self.constants = constants
        self.rng = rng

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
            raise ValueError(f"{what} is {name!r}; allowed are {', '.join(allowed)}")


RISE_SPAN = float(np.log(9.0))
"""Time from 10 to 90 % of an exponential, by its time constant."""


SECONDS_PER_HOUR = 3600.0


def draw_flaws(draw: FlawDraw, skin: Skin, noise: float, full_scale: int) -> Flaws:
    """Draw the flaws of a build of a family.

    `noise` is that of its readout at rest, by full scale.
    """
    constants = draw.constants
    take = draw.take
    is_capacitive = draw.family == "capacitive"
    intermittent = np.flatnonzero(draw_some(draw, skin, "intermittent"))
    swings = [constants.draw("flaw.intermittent_swing", draw.rng) for _ in intermittent]
    working, swinging = constants.array("flaw.intermittent_times")
    size = constants.get_constant("flaw.jump_size").spread
    corrupt = constants.get_constant("flaw.corrupt_size").spread
    assert size and size.median and size.gsd and corrupt
    return Flaws(
        rise=take("lag", "rise") / RISE_SPAN,
        fall=take("lag", "fall") / RISE_SPAN,
        residue=take("creep", "residue"),
        after_tail=take("after", "after_tail"),
        after_tail_size=constants.value("flaw.after_tail_size"),
        neighbours=take("neighbours", "neighbours"),
        column_leak=take("lines", "column_leak"),
        row_leak=take("lines", "row_leak"),
        noise_factor=draw_noise_factor(draw, skin),
        touched_noise=draw_touched_noise(draw, noise),
        line_noise=take("line_noise", "line_noise"),
        drift=draw_drift(draw),
        drift_times=constants.array("flaw.drift_times"),
        # Alike but for a fifth.
        offset_per_kelvin=take("thermal", "thermal_offset")
        * (1.0 + 0.2 * draw.rng.standard_normal(skin.count)),
        warming=take("thermal", "warming"),
        jumps=take("jumps", "jumps") / SECONDS_PER_HOUR,
        jump_size=(size.median, size.gsd, size.high),
        intermittent=intermittent,
        swings=np.array(swings),
        swing_times=(float(working), float(swinging)),
        corrupt=take("corrupt", "corrupt"),
        corrupt_size=(corrupt.low, corrupt.high),
        repeated=take("repeated", "repeated"),
        stamp_jitter=take("jitter", "jitter"),
        cut=round(take("quantisation", "cut") * full_scale) if is_capacitive else 0,
        proximity=take("proximity", "proximity") if is_capacitive else 0.0,
        proximity_reach=take("proximity", "proximity_reach") * MM,
        proximity_times=(
            take("proximity", "proximity_before"),
            take("proximity", "proximity_after"),
        ),
    )


def draw_some(draw: FlawDraw, skin: Skin, flaw: str) -> Bool[np.ndarray, "taxel"]:
    """Draw the taxels that have a flaw; at least one where its share is not zero."""
    share = draw.take(flaw, flaw)
    count = int(np.ceil(share * skin.count - draw.rng.random()))
    if draw.levels is not None and share > 0.0:
        count = max(count, 1)
    some = np.zeros(skin.count, dtype=bool)
    some[draw.rng.permutation(skin.count)[: max(count, 0)]] = True
    return some


def draw_noise_factor(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the noise of taxels over the median taxel's; a share of them is noisy."""
    constants = draw.constants
    rng = draw.rng
    scatter = constants.value("flaw.noise_scatter") * draw.has("noisy_taxels")
    factor = np.exp(scatter * rng.standard_normal(skin.count))
    share = draw.take("noisy_taxels", "noisy_taxels")
    in_columns = rng.random() < constants.value("flaw.noisy_lines")
    group = number_columns(skin) if in_columns else np.arange(skin.count)
    noisy = (rng.random(int(group.max()) + 1) < share)[group]
    factor[noisy] = [
        constants.draw("flaw.noisy_factor", rng) for _ in range(noisy.sum())
    ]
    return factor


def draw_touched_noise(draw: FlawDraw, noise: float) -> float:
    """Draw the noise that a touch adds to a usual taxel, by full scale."""
    factor = draw.take("touched_noise", "touched_noise", 1.0)
    max_noise = draw.constants.value("flaw.touched_most")
    return min(noise * float(np.sqrt(max(factor**2 - 1.0, 0.0))), max_noise)


def draw_drift(draw: FlawDraw) -> Float[np.ndarray, "process"]:
    """Draw the deviations of the slow processes, whose sum falls as a power of f."""
    times = draw.constants.array("flaw.drift_times")
    variances = times ** (draw.take("drift", "drift_slope", 1.0) - 1.0)
    return draw.take("drift", "drift") * np.sqrt(variances / variances.sum())


def number_rows(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Number the rows of all patches."""
    rows = max(patch.rows for patch in skin.patches)
    return skin.patch_index * rows + skin.rows


def number_columns(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Number the columns of all patches."""
    columns = max(patch.columns for patch in skin.patches)
    return skin.patch_index * columns + skin.columns
