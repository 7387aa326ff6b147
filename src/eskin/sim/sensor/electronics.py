"""This module draws the readout of a build, from conductance to counts."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.skin import Skin
from eskin.touch.calibration import Curve


@dataclass(frozen=True, eq=False)
class Electronics:
    """The electronics hold what is fixed of the readout."""

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
    """Level over conductance: that of a divider, in proportion, or logarithmic."""
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
    return Electronics(
        bits=bits,
        ghost=draw(f"sensor.ghost.{kind}", rng),
        ghost_least=constants.value("sensor.ghost_least"),
        leak=draw(f"sensor.leak.{kind}", rng),
        base=np.array([draw("sensor.base", rng) for _ in range(skin.count)]),
        walk=constants.value("sensor.walk") * coarser,
        after=constants.value(f"sensor.after.{kind}"),
        after_whole=constants.value("sensor.after_whole"),
        after_time=np.array(
            [draw("sensor.after_time", rng) for _ in range(skin.count)]
        ),
        noise=draw(f"sensor.noise.{kind}", rng) * coarser,
        noise_relative=constants.value("sensor.noise_relative"),
        phase=np.array([draw("sensor.phase", rng) for _ in skin.patches]),
        scan=draw("sensor.scan", rng),
        jitter=draw("sensor.jitter", rng),
        period=constants.value("sensor.period"),
        step=constants.value("time.step"),
    )
