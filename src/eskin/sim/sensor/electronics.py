"""This module draws the readout of a build, from conductance to counts."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.sensor.flaws import RESISTIVE, FlawDraw
from eskin.skin import Skin
from eskin.touch.calibration import Curve


@dataclass(frozen=True, eq=False)
class Electronics:
    """The electronics hold the constants of the readout."""

    bits: int
    """Resolution of the converter."""
    ghost: float
    """Part of each detour over three other taxels that a taxel reads."""
    ghost_least: float
    """Part below which ghosts are left out."""
    leak: float
    """Part of each other taxel of its row and column that a taxel reads."""
    base: Float[np.ndarray, "taxel"]
    """Reading of a free taxel, relative to full scale."""
    walk: float
    """Step of the baseline's random walk [counts]."""
    after: float
    """Standard deviation of the baseline's shift after a touch, relative to full
    scale."""
    after_whole: float
    """Signal relative to full scale from which a touch leaves the whole shift."""
    after_time: Float[np.ndarray, "taxel"]
    """Time constant in which the shift decays [s]."""
    noise: float
    """Standard deviation of a reading [counts]."""
    noise_relative: float
    """Standard deviation relative to the reading itself; variances add up."""
    phase: Float[np.ndarray, "patch"]
    """Age of a patch's scan when a reading is assembled [s]."""
    scan: float
    """Time to scan all rows of a patch [s]."""
    jitter: float
    """Standard deviation of a scan's time [s]."""
    period: float
    """Time between two readings [s]."""
    step: float
    """Time between two values of the incoming pressure [s]."""
    curve: Curve = "divider"
    """Level over conductance: of a divider, in proportion, or logarithmic."""
    span: float = 0.0
    """Conductance at full scale of a logarithmic converter by that from which levels
    grow as its logarithm; 0 of other converters."""

    @property
    def full_scale(self) -> int:
        """Return the largest count of the converter."""
        return 2**self.bits - 1


def build_nominal_electronics(skin: Skin, constants: Constants) -> Electronics:
    """Build a readout without ghosts, drift and noise that reads all taxels at once."""
    whole = constants.value("sensor.noise_bits")
    return Electronics(
        bits=round(whole),
        ghost=0.0,
        ghost_least=constants.value("sensor.ghost_least"),
        leak=0.0,
        base=np.zeros(skin.count),
        walk=0.0,
        after=0.0,
        after_whole=constants.value("sensor.after_whole"),
        after_time=np.ones(skin.count),
        noise=0.0,
        noise_relative=0.0,
        phase=np.zeros(len(skin.patches)),
        scan=0.0,
        jitter=0.0,
        period=constants.value("sensor.period"),
        step=constants.value("time.step"),
    )


def draw_electronics(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Electronics:
    """Draw the readout of a build of some kind."""
    bits = int(constants.choose(f"sensor.bits.{kind}", rng))
    coarser = 2.0 ** (bits - constants.value("sensor.noise_bits"))
    draw = constants.draw
    return replace(
        build_nominal_electronics(skin, constants),
        bits=bits,
        ghost=draw(f"sensor.ghost.{kind}", rng),
        leak=draw(f"sensor.leak.{kind}", rng),
        base=np.array([draw("sensor.base", rng) for _ in range(skin.count)]),
        walk=constants.value("sensor.walk") * coarser,
        after=constants.value(f"sensor.after.{kind}"),
        after_time=np.array(
            [draw("sensor.after_time", rng) for _ in range(skin.count)]
        ),
        noise=draw(f"sensor.noise.{kind}", rng) * coarser,
        noise_relative=constants.value("sensor.noise_relative"),
        phase=np.array([draw("sensor.phase", rng) for _ in skin.patches]),
        scan=draw("sensor.scan", rng),
        jitter=draw("sensor.jitter", rng),
    )


CURVES: dict[str, Curve] = {
    "divider": "divider",
    "logarithmic": "logarithmic",
    "capacitive": "divider",
    "linear": "linear",
}
"""Curve of each family; a capacitive taxel saturates as a divider does."""


def draw_family_electronics(draw: FlawDraw, skin: Skin) -> Electronics:
    """Draw the readout of a build of a family."""
    constants = draw.constants
    rng = draw.rng
    is_logarithmic = CURVES[draw.family] == "logarithmic"
    span = draw.take_product("span") if is_logarithmic else 0.0
    best = draw.take_product("bits")
    bits = round(best - draw.take("quantisation", "bits_lost"))
    is_late = draw.has("jitter")
    phase = np.array([constants.draw("sensor.phase", rng) for _ in skin.patches])
    scan = constants.draw("sensor.scan", rng)
    ghosts = draw.take("lines", "ghost") if draw.family in RESISTIVE else 0.0
    return replace(
        build_nominal_electronics(skin, constants),
        bits=bits,
        ghost=ghosts,
        base=draw_base(draw, skin),
        after=draw.take("after", "after"),
        after_time=np.full(skin.count, draw.take("after", "after_time", 1.0)),
        noise=draw_noise(draw) * (2**bits - 1),
        phase=phase * is_late,
        scan=scan * is_late,
        jitter=draw.take("jitter", "jitter"),
        period=draw.take("rate", "period", constants.value("sensor.period")),
        curve=CURVES[draw.family],
        span=span,
    )


def draw_base(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the reading of free taxels by full scale."""
    nominal = draw.take_product("base")
    scatter = np.log(draw.constants.value("flaw.offset_scatter"))
    drawn = np.exp(scatter * draw.rng.standard_normal(skin.count))
    if not draw.has("offset"):
        return np.full(skin.count, nominal)
    max_base = draw.constants.value("flaw.offset_most")
    return np.minimum(draw.take("offset", "offset") * drawn, max_base)


def draw_noise(draw: FlawDraw) -> float:
    """Draw the noise at rest by full scale.

    Where the build does not have that flaw the noise is the least, or typical where it
    has one that multiplies noise.
    """
    factors = ("noisy_taxels", "touched_noise", "line_noise")
    level = "typical" if any(draw.has(flaw) for flaw in factors) else "low"
    min_noise = draw.constants.at_level(draw.find_name("flaw.noise"), level)
    return max(
        draw.take("noise", "noise", min_noise), min_noise * (draw.levels is not None)
    )
