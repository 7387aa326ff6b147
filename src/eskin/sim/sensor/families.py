"""This module draws the parts of a build of a family of sensors."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import MM, Constants
from eskin.sim.sensor.defects import Defects, draw_line, find_line_taxels
from eskin.sim.sensor.electronics import Electronics
from eskin.sim.sensor.flaws import FlawDraw, Flaws
from eskin.sim.sensor.velostat import Velostat, draw_bend
from eskin.skin import Skin
from eskin.touch.calibration import Curve

CURVES: dict[str, Curve] = {
    "divider": "divider",
    "logarithmic": "logarithmic",
    "capacitive": "divider",
    "linear": "linear",
}
"""Curve of each family; a capacitive taxel saturates as a divider does."""

RESISTIVE = ("divider", "logarithmic")
"""Families of piezoresistive layers, with a gap to close and detours through others."""

MAX_EARLY_CREEP = 0.7
"""Largest part of the conductance at the time of calibration that is creep."""

RISE_SPAN = float(np.log(9.0))
"""Time from 10 to 90 % of an exponential, by its time constant."""

SECONDS_PER_HOUR = 3600.0


def draw_family_velostat(
    draw: FlawDraw, skin: Skin, half_pressure: float, exponent: float, activation: float
) -> Velostat:
    """Draw the layer of a build of a family.

    With its own hysteresis and creep, a taxel without other flaws reads what the data
    sheet says after `sensor.calibrated_at`.

    Args:
        draw: draw of the build's flaws.
        skin: skin of the taxels.
        half_pressure: pressure of conductance 1 by the data sheet [kPa].
        exponent: exponent by the data sheet.
        activation: activation by the data sheet [kPa].
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
    own = exponent * np.exp(draw_exponent_deviation(draw, skin))
    grown = 1.0 + creep @ risen
    held = float(np.sum(weights * (1.0 - play)))
    return Velostat(
        half_pressure=half_pressure,
        bend=draw_family_bend(draw, skin),
        activation=draw_family_activation(draw, skin, activation),
        play_widths=play,
        play_weights=weights,
        play_min_load=constants.value("sensor.play_least"),
        exponent=own,
        creep=creep,
        creep_times=creep_times,
        recovery_times=constants.array("sensor.recovery_times"),
        recovery_share=constants.value("sensor.recovery_share"),
        gain=draw_family_gain(draw, skin) / grown / held**own,
        session_gain=(0.0, 0.04 if draw.has("gain") else 0.0),
        temperature=draw.take("thermal", "temperature"),
        temperature_gain=draw.take("thermal", "thermal_gain"),
    )


def draw_exponent_deviation(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw how far the ln exponent of each taxel is from the data sheet's."""
    device = draw.take_signed("exponent", "exponent")
    taxel = draw.take("exponent", "exponent_taxel")
    return device + taxel * draw.rng.standard_normal(skin.count)


def draw_family_creep(
    draw: FlawDraw,
    skin: Skin,
    times: Float[np.ndarray, "process"],
    risen: Float[np.ndarray, "process"],
) -> Float[np.ndarray, "taxel process"]:
    """Draw creep that grows about evenly with the logarithm of time.

    Args:
        draw: draw of the build's flaws.
        skin: skin of the taxels.
        times: time constants of the processes [s].
        risen: share of each that has risen at the time of calibration, by which the
            growth in a doubling of time is meant.
    """
    rate = draw.take("creep", "creep") * float(np.log2(times[1] / times[0]))
    scatter = np.log(draw.constants.value("sensor.creep_scatter.fresh"))
    drawn = np.exp(scatter * draw.rng.standard_normal(len(skin.patches)))
    patches = np.minimum(rate * drawn, MAX_EARLY_CREEP / risen.sum())
    growth = patches / (1.0 - patches * risen.sum())
    return np.repeat(growth[skin.patch_index][:, None], len(times), axis=1)


def draw_family_gain(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the gains of taxels, about those of their lines, patches and device."""
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


def number_rows(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Number the rows of all patches."""
    rows = max(patch.rows for patch in skin.patches)
    return skin.patch_index * rows + skin.rows


def draw_family_activation(
    draw: FlawDraw, skin: Skin, nominal: float
) -> Float[np.ndarray, "taxel"]:
    """Draw activation pressures about those of their patches and their device."""
    device = draw.take("activation", "activation", nominal)
    patches = draw.rng.standard_normal(len(skin.patches))[skin.patch_index]
    taxels = draw.rng.standard_normal(skin.count)
    if not draw.has("activation"):
        return np.full(skin.count, device)
    value = draw.constants.value
    between, inside = value("flaw.activation_patch"), value("sensor.activation_scatter")
    return device * between**patches * inside**taxels


def draw_family_bend(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the preload of a share of the taxels of a resistive layer."""
    if draw.family not in RESISTIVE or not draw.has("bend"):
        return np.zeros(skin.count)
    share = draw.take("bend", "bent")
    return draw_bend(share, "sensor.bend.shifted", skin, draw.constants, draw.rng)


def draw_family_electronics(draw: FlawDraw, skin: Skin, span: float) -> Electronics:
    """Draw the readout of a build of a family."""
    constants, rng = draw.constants, draw.rng
    best = draw.take_product("bits")
    bits = round(best - draw.take("quantisation", "bits_lost"))
    is_late = draw.has("jitter")
    phase = np.array([constants.draw("sensor.phase", rng) for _ in skin.patches])
    scan = constants.draw("sensor.scan", rng)
    ghosts = draw.take("lines", "ghost") if draw.family in RESISTIVE else 0.0
    return Electronics(
        bits=bits,
        ghost=ghosts,
        ghost_least=constants.value("sensor.ghost_least"),
        leak=0.0,
        base=draw_base(draw, skin),
        walk=0.0,
        after=draw.take("after", "after"),
        after_whole=constants.value("sensor.after_whole"),
        after_time=np.full(skin.count, draw.take("after", "after_time", 1.0)),
        noise=draw_noise(draw) * (2**bits - 1),
        noise_relative=0.0,
        phase=phase * is_late,
        scan=scan * is_late,
        jitter=draw.take("jitter", "jitter"),
        period=draw.take("rate", "period", constants.value("sensor.period")),
        step=constants.value("time.step"),
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
    most = draw.constants.value("flaw.offset_most")
    return np.minimum(draw.take("offset", "offset") * drawn, most)


def draw_noise(draw: FlawDraw) -> float:
    """Draw the noise at rest by full scale.

    Where the build does not have that flaw the noise is the least, or typical where it
    has one that multiplies noise.
    """
    factors = ("noisy_taxels", "touched_noise", "line_noise")
    level = "typical" if any(draw.has(flaw) for flaw in factors) else "low"
    least = draw.constants.at_level(draw.find_name("flaw.noise"), level)
    return max(draw.take("noise", "noise", least), least * (draw.levels is not None))


def draw_noise_factor(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the noise of taxels by that of the median; a share of them is noisy."""
    constants, rng = draw.constants, draw.rng
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


def number_columns(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Number the columns of all patches."""
    columns = max(patch.columns for patch in skin.patches)
    return skin.patch_index * columns + skin.columns


def draw_family_defects(draw: FlawDraw, skin: Skin) -> Defects:
    """Draw the lasting faults of a build of a family; readings get lost one by one."""
    rng = draw.rng
    dead = draw_some(draw, skin, "dead")
    stuck = np.full(skin.count, np.nan)
    stuck[draw_some(draw, skin, "stuck")] = rng.random()
    stuck = np.where(np.isnan(stuck), np.nan, rng.random(skin.count))
    share = draw.take("dead_line", "dead_line")
    hit = rng.random(len(skin.patches)) < share
    if draw.levels is not None and share > 0.0:
        hit[rng.integers(len(skin.patches))] = True
    lines = tuple(draw_line(int(patch), skin, rng) for patch in np.flatnonzero(hit))
    for line in lines:
        dead |= find_line_taxels(line, skin)
    return Defects(dead, stuck, lines, draw.take("lost", "lost"), dropped_run=1.0)


def draw_some(draw: FlawDraw, skin: Skin, flaw: str) -> Bool[np.ndarray, "taxel"]:
    """Draw the taxels that have a flaw; at least one where its share is not zero."""
    share = draw.take(flaw, flaw)
    count = int(np.ceil(share * skin.count - draw.rng.random()))
    if draw.levels is not None and share > 0.0:
        count = max(count, 1)
    some = np.zeros(skin.count, dtype=bool)
    some[draw.rng.permutation(skin.count)[: max(count, 0)]] = True
    return some


def draw_touched_noise(draw: FlawDraw, noise: float) -> float:
    """Draw the noise that a touch adds to that of a usual taxel, by full scale."""
    factor = draw.take("touched_noise", "touched_noise", 1.0)
    most = draw.constants.value("flaw.touched_most")
    return min(noise * float(np.sqrt(max(factor**2 - 1.0, 0.0))), most)


def draw_flaws(draw: FlawDraw, skin: Skin, electronics: Electronics) -> Flaws:
    """Draw the flaws of a build of a family with this readout."""
    full_scale = electronics.full_scale
    noise = electronics.noise / full_scale
    constants, take = draw.constants, draw.take
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
        offset_per_kelvin=draw_offset_per_kelvin(draw, skin),
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
        cut=draw_cut(draw, full_scale),
        proximity=draw_proximity(draw),
        proximity_reach=take("proximity", "proximity_reach") * MM,
        proximity_times=(
            take("proximity", "proximity_before"),
            take("proximity", "proximity_after"),
        ),
    )


def draw_drift(draw: FlawDraw) -> Float[np.ndarray, "process"]:
    """Draw the deviations of the slow processes, whose sum falls as a power of f."""
    times = draw.constants.array("flaw.drift_times")
    variances = times ** (draw.take("drift", "drift_slope", 1.0) - 1.0)
    return draw.take("drift", "drift") * np.sqrt(variances / variances.sum())


def draw_offset_per_kelvin(draw: FlawDraw, skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Draw the shift of readings with temperature, alike but for a fifth."""
    mean = draw.take("thermal", "thermal_offset")
    return mean * (1.0 + 0.2 * draw.rng.standard_normal(skin.count))


def draw_cut(draw: FlawDraw, full_scale: int) -> int:
    """Draw the counts below which a capacitive converter gives zero."""
    if draw.family != "capacitive":
        return 0
    return round(draw.take("quantisation", "cut") * full_scale)


def draw_proximity(draw: FlawDraw) -> float:
    """Draw what a capacitive taxel feels of a body that does not touch it."""
    if draw.family != "capacitive":
        return 0.0
    return draw.take("proximity", "proximity")


def get_span(draw: FlawDraw) -> float:
    """Draw the span of a logarithmic converter; 0 of others."""
    return draw.take_product("span") if CURVES[draw.family] == "logarithmic" else 0.0


def draw_film_sigma(draw: FlawDraw, constants: Constants) -> float:
    """Draw the spread of pressure in the layer [mm]; a cast sensor spreads it more."""
    name = "film.sigma_covered" if draw.family == "linear" else "film.sigma"
    return constants.draw(name, draw.rng)
