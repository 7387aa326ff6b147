"""A build is one sensor as made: its laminate, its readout and its defects."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM, Constants
from eskin.sim.sensor.electronics import (
    Electronics,
    build_nominal_electronics,
    draw_electronics,
    draw_family_electronics,
)
from eskin.sim.sensor.faults import (
    Defects,
    build_intact_defects,
    draw_defects,
    draw_family_defects,
)
from eskin.sim.sensor.flaws import Family, FlawDraw, FlawLevel, Flaws, draw_flaws
from eskin.sim.sensor.velostat import (
    Velostat,
    build_nominal_velostat,
    draw_family_velostat,
    draw_velostat,
)
from eskin.skin import Skin
from eskin.touch import Calibration

BuildKind = Literal[
    "fresh", "shifted", "flawless", "divider", "logarithmic", "capacitive", "linear"
]
"""Laws that a build is drawn from: of the first sets, or of a family; `flawless` is
`fresh` without defects."""


@dataclass(frozen=True, eq=False)
class SensorBuild:
    """A build holds everything fixed of the skin on one robot."""

    name: str
    """Name of the build."""
    kind: str
    """`fresh` as in training, `shifted` with wider laws, the name of a family, or
    `nominal`."""
    velostat: Velostat
    """Laminate, from pressure to conductance."""
    electronics: Electronics
    """Readout, from conductance to counts."""
    defects: Defects
    """Defects of the build."""
    film_sigma: float
    """Standard deviation of the film's Gaussian spread of pressure [m]."""
    nominal_exponent: float
    """Exponent that its calibration assumes."""
    nominal_activation: float
    """Pressure that its calibration assumes to close a taxel [kPa]."""
    nominal_half: float
    """Pressure at which a nominal taxel reads half scale, or full scale if its
    converter is linear or logarithmic [kPa]."""
    calibrated_at: float
    """Time under load at which calibrations read rightly [s]."""
    flaws: Flaws | None = None
    """Flaws that builds of families have; None of other builds."""

    def calibration(self, skin: Skin) -> Calibration:
        """Return the calibration of its user: converter and nominal taxel, no gains.

        Of a family that is what its data sheet says. Of `fresh` and `shifted` builds
        the nominal taxel has the half scale of this very build, as in the sets that
        have always used it.
        """
        nominal = np.full(skin.count, self.nominal_half)
        return self.build_calibration(
            nominal, self.nominal_exponent, self.nominal_activation
        )

    def exact_calibration(self, skin: Skin) -> Calibration:
        """Return a calibration with the build's own constants, which no user knows.

        It has the gain of each taxel, and the mean exponent and activation.
        """
        velostat = self.velostat
        exponent = float(velostat.exponent.mean())
        # Creep and play do not change what a taxel reads at the time of calibration.
        passed = float(np.sum(velostat.play_weights * (1.0 - velostat.play_widths)))
        grown = velostat.gain * self.compute_calibrated_creep()
        half = velostat.half_pressure / passed * grown ** (-1.0 / velostat.exponent)
        activation = float(velostat.activation.mean())
        return replace(
            self.build_calibration(half, exponent, activation), source="exact"
        )

    def compute_calibrated_creep(self) -> Float[np.ndarray, "taxel"]:
        """Return the growth of conductance by creep at the time of calibration."""
        risen = 1.0 - np.exp(-self.calibrated_at / self.velostat.creep_times)
        return 1.0 + self.velostat.creep @ risen

    def build_calibration(
        self, pressure: Float[np.ndarray, "taxel"], exponent: float, activation: float
    ) -> Calibration:
        """Build a calibration with the converter of the build.

        `pressure` is that of each taxel at half scale, or at full scale where the
        converter is linear or logarithmic; `activation` closes a taxel [kPa].
        """
        electronics = self.electronics
        return Calibration(
            pressure / electronics.full_scale,
            electronics.full_scale,
            curve=electronics.curve,
            exponent=exponent,
            unfelt=activation,
            span=electronics.span,
            matrix=electronics.curve != "linear",
        )


def draw_build(
    name: str,
    kind: BuildKind,
    skin: Skin,
    constants: Constants,
    rng: np.random.Generator,
) -> SensorBuild:
    """Draw the skin of one robot; one of a family has all flaws, each drawn."""
    if kind == "flawless":
        whole = build_intact_defects(skin, constants)
        return replace(draw_build(name, "fresh", skin, constants, rng), defects=whole)
    if kind != "fresh" and kind != "shifted":
        return assemble_family_build(name, FlawDraw(kind, None, constants, rng), skin)
    velostat = draw_velostat(kind, skin, constants, rng)
    return replace(
        build_nominal_sensor(skin, constants),
        name=name,
        kind=kind,
        velostat=velostat,
        electronics=draw_electronics(kind, skin, constants, rng),
        defects=draw_defects(kind, skin, constants, rng),
        film_sigma=constants.draw("film.sigma", rng) * MM,
        nominal_half=compute_nominal_half(velostat.half_pressure, constants),
    )


def draw_flawed_build(
    name: str,
    family: Family,
    flaws: Mapping[str, FlawLevel],
    skin: Skin,
    constants: Constants,
    rng: np.random.Generator,
) -> SensorBuild:
    """Draw a build of a family with some flaws only, each at a level.

    Its data sheet is typical of the family, and so is all that is not named: an intact
    build reads what its calibration says. Its noise at rest is the least measured one,
    or typical where a flaw multiplies noise. `flaws` holds the level of each flaw, of
    `FLAWS`.

    Raises:
        ValueError: there is no such family, flaw or level.
    """
    return assemble_family_build(name, FlawDraw(family, flaws, constants, rng), skin)


def assemble_family_build(name: str, draw: FlawDraw, skin: Skin) -> SensorBuild:
    """Draw all parts of a build of a family; a cast sensor spreads pressure more."""
    film = "film.sigma_covered" if draw.family == "linear" else "film.sigma"
    half = draw.take_product("scale")
    exponent = draw.take_product("exponent")
    activation = draw.take_product("activation")
    electronics = draw_family_electronics(draw, skin)
    return SensorBuild(
        name=name,
        kind=draw.family,
        velostat=draw_family_velostat(draw, skin, half, exponent, activation),
        electronics=electronics,
        defects=draw_family_defects(draw, skin),
        film_sigma=draw.constants.draw(film, draw.rng) * MM,
        nominal_exponent=exponent,
        nominal_activation=activation,
        nominal_half=half,
        calibrated_at=draw.constants.value("sensor.calibrated_at"),
        flaws=draw_flaws(
            draw,
            skin,
            electronics.noise / electronics.full_scale,
            electronics.full_scale,
        ),
    )


def build_nominal_sensor(skin: Skin, constants: Constants) -> SensorBuild:
    """Build a skin without scatter, noise and faults, to measure the chain with."""
    velostat = build_nominal_velostat(skin, constants)
    return SensorBuild(
        name="nominal",
        kind="nominal",
        velostat=velostat,
        electronics=build_nominal_electronics(skin, constants),
        defects=build_intact_defects(skin, constants),
        film_sigma=0.0,
        nominal_exponent=constants.value("sensor.nominal_exponent"),
        nominal_activation=constants.value("sensor.nominal_activation"),
        nominal_half=compute_nominal_half(velostat.half_pressure, constants),
        calibrated_at=constants.value("sensor.calibrated_at"),
    )


def compute_nominal_half(half_pressure: float, constants: Constants) -> float:
    """Return the pressure that calibration takes for half scale [kPa].

    With it a nominal taxel reads the true value of what is pressed for a time, with its
    play and creep.
    """
    weights = constants.array("sensor.play_weights.fresh")
    passed = float(np.sum(weights * (1.0 - constants.array("sensor.play"))))
    seconds = constants.value("sensor.calibrated_at")
    risen = 1.0 - np.exp(-seconds / constants.array("sensor.creep_times"))
    creep = float(np.sum(constants.array("sensor.creep") * risen))
    grown = (1.0 + creep) ** (1.0 / constants.value("sensor.nominal_exponent"))
    return float(half_pressure / passed / grown)
