"""One robot as it was built: its laminate, its readout and what is broken."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.sensor.defects import Defects, draw_defects, no_defects
from eskin.sim.sensor.electronics import (
    Electronics,
    draw_electronics,
    nominal_electronics,
)
from eskin.sim.sensor.velostat import Velostat, draw_velostat, nominal_velostat
from eskin.skin import Skin
from eskin.touch import Calibration


@dataclass(frozen=True, eq=False)
class Build:
    """Everything fixed of the skin on one robot."""

    name: str
    """Name of the build."""
    kind: str
    """`fresh` as in training, `shifted` with wider laws, or `nominal`."""
    velostat: Velostat
    """From pressure to conductance."""
    electronics: Electronics
    """From conductance to counts."""
    defects: Defects
    """What is broken."""
    film_sigma: float
    """Deviation of the film's spread of pressure, a Gaussian [m]."""
    nominal_exponent: float
    """Exponent that its calibration supposes."""
    nominal_activation: float
    """Pressure that its calibration supposes to close a taxel [kPa]."""
    nominal_half: float
    """Pressure at which a nominal taxel reads half scale [kPa]."""

    def calibration(self, skin: Skin) -> Calibration:
        """What its user knows: converter and nominal taxel, not each one's gain."""
        full_scale = self.electronics.full_scale
        return Calibration(
            np.full(skin.count, self.nominal_half / full_scale),
            full_scale,
            curve="divider",
            exponent=self.nominal_exponent,
            unfelt=self.nominal_activation,
            matrix=True,
        )

    def record(self) -> dict[str, float | str]:
        """Its scalars, and means of what differs between taxels."""
        velostat, electronics = self.velostat, self.electronics
        return {
            "build": self.name,
            "build_kind": self.kind,
            "film_sigma": self.film_sigma,
            "half_pressure": velostat.half_pressure,
            "exponent": float(velostat.exponent.mean()),
            "gain_spread": float(np.log(velostat.gain).std()),
            "activation": float(velostat.activation.mean()),
            "bent": float((velostat.bend > 0).mean()),
            "bits": electronics.bits,
            "ghost": electronics.ghost,
            "leak": electronics.leak,
            "noise": electronics.noise,
            "scan": electronics.scan,
            "jitter": electronics.jitter,
            "dead": int(self.defects.dead.sum()),
            "stuck": int(np.isfinite(self.defects.stuck).sum()),
            "dead_lines": " ".join(self.defects.lines),
        }


def draw_build(
    name: str,
    kind: Literal["fresh", "shifted"],
    skin: Skin,
    constants: Constants,
    rng: np.random.Generator,
) -> Build:
    """Draw the skin of one robot."""
    velostat = draw_velostat(kind, skin, constants, rng)
    return Build(
        name=name,
        kind=kind,
        velostat=velostat,
        electronics=draw_electronics(kind, skin, constants, rng),
        defects=draw_defects(kind, skin, constants, rng),
        film_sigma=constants.draw("film.sigma", rng) * METRES,
        nominal_exponent=constants.value("sensor.nominal_exponent"),
        nominal_activation=constants.value("sensor.nominal_activation"),
        nominal_half=nominal_half(velostat.half_pressure, constants),
    )


def nominal_build(skin: Skin, constants: Constants) -> Build:
    """A skin without scatter, noise and faults, to measure the chain with."""
    velostat = nominal_velostat(skin, constants)
    return Build(
        name="nominal",
        kind="nominal",
        velostat=velostat,
        electronics=nominal_electronics(skin, constants),
        defects=no_defects(skin, constants),
        film_sigma=0.0,
        nominal_exponent=constants.value("sensor.nominal_exponent"),
        nominal_activation=constants.value("sensor.nominal_activation"),
        nominal_half=nominal_half(velostat.half_pressure, constants),
    )


METRES = 1e-3


def nominal_half(half_pressure: float, constants: Constants) -> float:
    """The pressure that calibration takes for half scale [kPa].

    It makes a nominal taxel read rightly what is pressed for a time, with its play and
    creep.
    """
    seconds = constants.value("sensor.calibrated_at")
    exponent = constants.value("sensor.nominal_exponent")
    grown = (1.0 + crept(seconds, constants)) ** (1.0 / exponent)
    return float(half_pressure / held(constants) / grown)


def held(constants: Constants) -> float:
    """What the play operators leave of a load that only grew."""
    weights = constants.array("sensor.play_weights.fresh")
    return float(np.sum(weights * (1.0 - constants.array("sensor.play"))))


def crept(seconds: float, constants: Constants) -> float:
    """Relative growth of conductance after a time under load."""
    risen = 1.0 - np.exp(-seconds / constants.array("sensor.creep_times"))
    return float(np.sum(constants.array("sensor.creep") * risen))
