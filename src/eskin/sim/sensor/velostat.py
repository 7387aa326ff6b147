"""This module draws the sensing laminate of a build, from pressure to conductance."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import Constants
from eskin.sim.sensor.flaws import RESISTIVE, FlawDraw, number_rows
from eskin.skin import Skin


@dataclass(frozen=True, eq=False)
class Velostat:
    """This class holds the fixed laminate, whose conductance 1 reads half scale."""

    half_pressure: float
    """Pressure that gives conductance 1 at first touch, without play [kPa]."""
    bend: Float[np.ndarray, "taxel"]
    """Pressure that the bent laminate puts on itself [kPa]."""
    activation: Float[np.ndarray, "taxel"]
    """Pressure that closes the gap of the grid [kPa]."""
    play_widths: Float[np.ndarray, "operator"]
    """Half widths of the play operators, relative to the largest load of the touch."""
    play_weights: Float[np.ndarray, "operator"]
    """Weights of the play operators."""
    play_min_load: float
    """Least load that sets those widths, relative to `half_pressure`."""
    exponent: Float[np.ndarray, "taxel"]
    """Exponent of conductance over load."""
    creep: Float[np.ndarray, "taxel process"]
    """Relative growth of conductance under lasting load."""
    creep_times: Float[np.ndarray, "process"]
    """Time constants of creep [s]."""
    recovery_times: Float[np.ndarray, "two"]
    """Time constants of recovery after release [s]."""
    recovery_share: float
    """Part of creep that recovers with the first of them."""
    gain: Float[np.ndarray, "taxel"]
    """Conductance relative to a nominal taxel."""
    session_gain: tuple[float, float]
    """Mean and standard deviation of what a session adds to a taxel's ln gain."""
    temperature: float
    """Standard deviation of a session's temperature [K]."""
    temperature_gain: float
    """Relative growth of conductance with temperature [1/K]."""


def build_nominal_velostat(skin: Skin, constants: Constants) -> Velostat:
    """Build a laminate whose taxels are all nominal."""
    same = np.ones(skin.count)
    law = constants.get_constant("sensor.half_pressure.fresh").spread
    half = law.median if law and law.median else 1.0
    return Velostat(
        half_pressure=half * constants.factors.get("sensor.half_pressure.fresh", 1.0),
        bend=0.0 * same,
        activation=constants.value("sensor.nominal_activation") * same,
        play_widths=constants.array("sensor.play"),
        play_weights=constants.array("sensor.play_weights.fresh"),
        play_min_load=constants.value("sensor.play_least"),
        exponent=constants.value("sensor.nominal_exponent") * same,
        creep=np.tile(constants.array("sensor.creep"), (skin.count, 1)),
        creep_times=constants.array("sensor.creep_times"),
        recovery_times=constants.array("sensor.recovery_times"),
        recovery_share=constants.value("sensor.recovery_share"),
        gain=same,
        session_gain=(0.0, 0.0),
        temperature=0.0,
        temperature_gain=constants.value("sensor.temperature_gain"),
    )


def draw_velostat(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Velostat:
    """Draw the laminate of a build of some kind.

    Activations and exponents lie about the mean of their patch, gains about its gain;
    creep is the same within a patch.
    """
    value = constants.value
    normal = rng.standard_normal
    half_pressure = constants.draw(f"sensor.half_pressure.{kind}", rng)
    share = constants.draw(f"sensor.bent.{kind}", rng)
    bend = draw_bend(share, f"sensor.bend.{kind}", skin, constants, rng)
    activation = draw_per_patch(f"sensor.activation.{kind}", skin, constants, rng)
    scatter = np.log(value("sensor.activation_scatter"))
    activation = activation * np.exp(scatter * normal(skin.count))
    exponent = draw_per_patch(f"sensor.exponent.{kind}", skin, constants, rng)
    exponent += value(f"sensor.exponent_scatter.{kind}") * normal(skin.count)
    creep = constants.array("sensor.creep")
    scatter = np.log(value(f"sensor.creep_scatter.{kind}"))
    creep = creep * np.exp(scatter * normal((len(skin.patches), len(creep))))
    patches = normal(len(skin.patches))
    taxels = normal(skin.count)
    between = value(f"sensor.gain_patch.{kind}") * patches[skin.patch_index]
    return replace(
        build_nominal_velostat(skin, constants),
        half_pressure=half_pressure,
        bend=bend,
        activation=activation,
        play_weights=constants.array(f"sensor.play_weights.{kind}"),
        exponent=np.clip(exponent, *constants.array("sensor.exponent_limits")),
        creep=creep[skin.patch_index],
        gain=np.exp(between + value(f"sensor.gain_taxel.{kind}") * taxels),
        session_gain=get_normal_law(f"sensor.session_gain.{kind}", constants),
        temperature=get_normal_law(f"sensor.temperature.{kind}", constants)[1],
    )


def get_normal_law(name: str, constants: Constants) -> tuple[float, float]:
    """Return mean and deviation of a constant that is drawn again in every session."""
    law = constants.get_constant(name).spread
    factor = constants.factors.get(name, 1.0)
    if law is None or law.mean is None or law.sd is None:
        raise ValueError(f"constant '{name}' has no normal law; give it mean and sd")
    return law.mean * factor, law.sd * factor


def draw_per_patch(
    name: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Float[np.ndarray, "taxel"]:
    """Draw a constant once a patch, for all its taxels."""
    drawn = np.array([constants.draw(name, rng) for _ in skin.patches])
    return drawn[skin.patch_index]


def draw_bend(
    share: float, name: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Float[np.ndarray, "taxel"]:
    """Draw the preload of a share of the taxels, nearest the edges of their patches."""
    rank = count_steps_from_edge(skin) + rng.random(skin.count)
    bent = np.argsort(rank)[: round(share * skin.count)]
    bend = np.zeros(skin.count)
    bend[bent] = [constants.draw(name, rng) for _ in bent]
    return bend


def count_steps_from_edge(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Count the rows or columns from each taxel to the nearest edge of its patch."""
    rows = np.array([patch.rows for patch in skin.patches])[skin.patch_index]
    columns = np.array([patch.columns for patch in skin.patches])[skin.patch_index]
    across = np.minimum(skin.rows, rows - 1 - skin.rows)
    along = np.minimum(skin.columns, columns - 1 - skin.columns)
    return np.minimum(across, along)


def draw_family_velostat(
    draw: FlawDraw, skin: Skin, half_pressure: float, exponent: float, activation: float
) -> Velostat:
    """Draw the layer of a build of a family.

    With its own hysteresis and creep, a taxel without other flaws reads what the data
    sheet says after `sensor.calibrated_at`. Exponent, and pressures [kPa], are those of
    the data sheet.
    """
    constants = draw.constants
    lagging = draw.take("hysteresis", "hysteresis")
    play = constants.array("sensor.play")
    weights = np.append(
        1.0 - lagging, np.full(len(play) - 1, lagging / (len(play) - 1))
    )
    creep_times = constants.array("flaw.creep_times")
    risen = 1.0 - np.exp(-constants.value("sensor.calibrated_at") / creep_times)
    creep = draw_family_creep(draw, skin, creep_times, risen)
    device = draw.take_signed("exponent", "exponent")
    taxels = draw.take("exponent", "exponent_taxel")
    own = exponent * np.exp(device + taxels * draw.rng.standard_normal(skin.count))
    grown = 1.0 + creep @ risen
    passed = float(np.sum(weights * (1.0 - play)))
    return replace(
        build_nominal_velostat(skin, constants),
        half_pressure=half_pressure,
        bend=draw_family_bend(draw, skin),
        activation=draw_family_activation(draw, skin, activation),
        play_weights=weights,
        exponent=own,
        creep=creep,
        creep_times=creep_times,
        gain=draw_family_gain(draw, skin) / grown / passed**own,
        session_gain=(0.0, 0.04 if draw.has("gain") else 0.0),
        temperature=draw.take("thermal", "temperature"),
        temperature_gain=draw.take("thermal", "thermal_gain"),
    )


MAX_EARLY_CREEP = 0.7
"""Largest part of the conductance at the time of calibration that is creep."""


def draw_family_creep(
    draw: FlawDraw,
    skin: Skin,
    times: Float[np.ndarray, "process"],
    risen: Float[np.ndarray, "process"],
) -> Float[np.ndarray, "taxel process"]:
    """Draw creep that grows about evenly with the logarithm of time.

    `risen` is the share of each process, of time constant `times` [s], that has risen
    at the time of calibration, by which the growth in a doubling of time is meant.
    """
    rate = draw.take("creep", "creep") * float(np.log2(times[1] / times[0]))
    scatter = np.log(draw.constants.value("sensor.creep_scatter.fresh"))
    drawn = np.exp(scatter * draw.rng.standard_normal(len(skin.patches)))
    patches = np.minimum(rate * drawn, MAX_EARLY_CREEP / risen.sum())
    growth = patches / (1.0 - patches * risen.sum())
    return np.repeat(growth[skin.patch_index][:, None], len(times), axis=1)


def draw_family_gain(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the gains of taxels, about the gains of lines, patches and device."""
    rng = draw.rng
    ln = np.full(skin.count, draw.take_signed("gain", "gain_device"))
    for name, group in (
        ("gain_patch", skin.patch_index),
        ("gain_line", number_rows(skin)),
        ("gain_taxel", np.arange(skin.count)),
    ):
        deviation = draw.take("gain", name)
        ln += deviation * rng.standard_normal(int(group.max()) + 1)[group]
    return np.exp(ln)


def draw_family_activation(
    draw: FlawDraw, skin: Skin, nominal: float
) -> Float[np.ndarray, "taxel"]:
    """Draw activation pressures about the pressures of patches and device."""
    device = draw.take("activation", "activation", nominal)
    patches = draw.rng.standard_normal(len(skin.patches))[skin.patch_index]
    taxels = draw.rng.standard_normal(skin.count)
    if not draw.has("activation"):
        return np.full(skin.count, device)
    value = draw.constants.value
    between = value("flaw.activation_patch")
    inside = value("sensor.activation_scatter")
    return device * between**patches * inside**taxels


def draw_family_bend(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the preload of a share of the taxels of a resistive layer."""
    if draw.family not in RESISTIVE or not draw.has("bend"):
        return np.zeros(skin.count)
    share = draw.take("bend", "bent")
    return draw_bend(share, "sensor.bend.shifted", skin, draw.constants, draw.rng)
