"""The readout of one build: from conductance to counts, and when."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.skin import Skin


@dataclass(frozen=True, eq=False)
class Electronics:
    """What is fixed of the readout."""

    bits: int
    """Resolution of the converter."""
    ghost: float
    """Part of each detour over three other taxels that a taxel reads."""
    ghost_least: float
    """Ghosts weaker than this are left out."""
    leak: float
    """Part of each other taxel of its row and column that a taxel reads."""
    base: Float[np.ndarray, "taxel"]
    """Reading of a free taxel by full scale."""
    walk: float
    """Step of the baseline's random walk [counts]."""
    after: float
    """Deviation of the baseline after a touch, by full scale."""
    after_whole: float
    """Signal by full scale from which a touch leaves the whole of that."""
    after_time: Float[np.ndarray, "taxel"]
    """Time in which that is forgotten [s]."""
    noise: float
    """Deviation of a reading [counts]."""
    noise_relative: float
    """Deviation by the reading itself; added as variances."""
    phase: Float[np.ndarray, "patch"]
    """Age of a patch's scan when a reading is put together [s]."""
    scan: float
    """Time to scan all rows of a patch [s]."""
    jitter: float
    """Deviation of a scan's time [s]."""
    period: float
    """Time between two readings [s]."""
    step: float
    """Time between two values of the pressures that come in [s]."""

    @property
    def full_scale(self) -> int:
        """Largest count of the converter."""
        return 2**self.bits - 1


def nominal_electronics(skin: Skin, constants: Constants) -> Electronics:
    """A readout without ghosts, drift and noise, all taxels at once."""
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
    """Draw the readout of a build of a kind."""
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
