"""This module prepares a build for the kernels: stages, drift and scan times."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.sensor.build import SensorBuild
from eskin.sim.sensor.kernels import (
    DIVIDER,
    IN_PROPORTION,
    LOGARITHMIC,
    Converter,
    LayerState,
    Readout,
    SensorLayer,
    TaxelArrays,
)
from eskin.skin import Skin
from eskin.touch.calibration import Curve

MIN_WARMED_GAIN = 0.2
"""Smallest gain of a cold sensor, in units of that at the temperature of calibration:
the linear law holds near it only."""


@dataclass(frozen=True)
class SensorStages:
    """These flags select the stages of the sensor that work; others do nothing."""

    bending: bool = True
    """Bent laminate presses on itself."""
    threshold: bool = True
    """Small pressures do not close the gap."""
    hysteresis: bool = True
    """Load lags behind pressure."""
    power: bool = True
    """Conductance is a power of load."""
    creep: bool = True
    """Conductance grows under lasting load and recovers slowly."""
    gain: bool = True
    """Taxels, patches and sessions differ."""
    proximity: bool = True
    """A capacitive taxel feels bodies close to it."""
    ghosting: bool = True
    """A taxel reads others of its patch."""
    divider: bool = True
    """A divider, or what a family has in its place, stands before the converter."""
    drift: bool = True
    """Temperature, wandering baselines, and shifts of them after a touch."""
    noise: bool = True
    """Readings are noisy."""
    faults: bool = True
    """Taxels and lines are broken, readings do not arrive."""
    skew: bool = True
    """Patches and rows are scanned one after the other."""


@dataclass(frozen=True, eq=False)
class SensorSession:
    """A session holds what has drifted since the build was calibrated."""

    gain: Float[np.ndarray, "taxel"]
    """Factor on the conductance of each taxel."""
    temperature_offset: float
    """Temperature above the temperature of calibration [K]."""
    warming: float = 0.0
    """Rate at which it rises [K/s]."""
    drift: Float[np.ndarray, "process taxel"] | None = None
    """State of the slow processes of the flaws, by their standard deviations; each
    sensor starts with that of the slowest ones. All are drawn for each where None."""


def draw_session(build: SensorBuild, rng: np.random.Generator) -> SensorSession:
    """Draw a session of a build."""
    velostat = build.velostat
    mean, deviation = velostat.session_gain
    drift = mean + deviation * rng.standard_normal(len(velostat.gain))
    temperature = velostat.temperature * float(rng.standard_normal())
    gain = np.exp(drift)
    if build.flaws is None:
        return SensorSession(gain, temperature)
    warming = build.flaws.warming * float(rng.standard_normal())
    slow = rng.standard_normal((len(build.flaws.drift), len(gain)))
    return SensorSession(gain, temperature, warming, slow)


def build_taxel_arrays(
    live: Int[np.ndarray, "live"], ages: Float[np.ndarray, "taxel"], skin: Skin
) -> TaxelArrays:
    """Lay live taxels out in the arrays of their patches.

    `live` taxels conduct at some time and are sorted by patch; `ages` are the times
    from their scans to the assembly of the reading [s].
    """
    patches, starts = np.unique(skin.patch_index[live], return_index=True)
    rows = max(patch.rows for patch in skin.patches)
    columns = max(patch.columns for patch in skin.patches)
    taxel = np.full((len(patches), rows, columns), -1, dtype=np.int64)
    for index, patch in enumerate(patches):
        inside = np.flatnonzero(skin.patch_index == patch)
        taxel[index, skin.rows[inside], skin.columns[inside]] = inside
    return TaxelArrays(
        starts=np.append(starts, len(live)),
        patch=patches,
        row=skin.rows[live],
        column=skin.columns[live],
        age=ages[live],
        taxel=taxel,
        rows=np.array([skin.patches[patch].rows for patch in patches], dtype=np.int64),
        columns=np.array(
            [skin.patches[patch].columns for patch in patches], dtype=np.int64
        ),
    )


def compute_free_load(
    build: SensorBuild, stages: SensorStages
) -> Float[np.ndarray, "taxel"]:
    """Return the load of free taxels less activation, by half-scale pressure."""
    velostat = build.velostat
    bend = velostat.bend * stages.bending
    return (bend - velostat.activation * stages.threshold) / velostat.half_pressure


def build_sensor_layer(
    live: Int[np.ndarray, "live"],
    build: SensorBuild,
    session: SensorSession,
    stages: SensorStages,
    after: Float[np.ndarray, "touch taxel"],
) -> SensorLayer:
    """Build the laminate under the live taxels, with the stages that work."""
    velostat = build.velostat
    electronics = build.electronics
    gain = np.ones(len(live))
    if stages.gain:
        gain = (velostat.gain * session.gain)[live]
    if stages.drift:
        warmed = 1.0 + velostat.temperature_gain * session.temperature_offset
        gain = gain * max(warmed, MIN_WARMED_GAIN)
    plain = np.array([0.0]), np.array([1.0])
    play = (velostat.play_widths, velostat.play_weights) if stages.hysteresis else plain
    step = electronics.step
    return SensorLayer(
        load=compute_free_load(build, stages)[live],
        half_pressure=velostat.half_pressure,
        exponent=velostat.exponent[live] if stages.power else np.ones(len(live)),
        gain=gain,
        play_widths=play[0],
        play_weights=play[1],
        play_min_load=velostat.play_min_load,
        creep=velostat.creep[live] * stages.creep,
        creep_part=1.0 - np.exp(-step / velostat.creep_times),
        recovery_keep=np.exp(-step / velostat.recovery_times),
        recovery_share=velostat.recovery_share,
        after=after[:, live] * stages.drift,
        after_whole=electronics.after_whole,
        after_keep=np.exp(-step / electronics.after_time[live]),
    )


def build_readout(build: SensorBuild, stages: SensorStages) -> Readout:
    """Build the converter, with the stages that work."""
    electronics = build.electronics
    defects = build.defects
    full = electronics.full_scale
    stuck = np.where(np.isnan(defects.stuck), -1.0, np.round(full * defects.stuck))
    sensitivity = np.where(defects.dead & stages.faults, 0.0, 1.0)
    factor = np.ones(len(stuck))
    touched_noise = 0.0
    cut = 0
    if build.flaws:
        factor = build.flaws.noise_factor * np.sqrt(1.0 - build.flaws.line_noise)
        touched_noise = full * build.flaws.touched_noise
        cut = build.flaws.cut
    return Readout(
        full=float(full),
        base=(electronics.base * full).astype(np.float32),
        walk=electronics.walk * stages.drift,
        noise=(electronics.noise * stages.noise * factor).astype(np.float32),
        noise_relative=electronics.noise_relative * stages.noise,
        touched_noise=touched_noise * stages.noise,
        touched_level=compute_touched_level(build, stages),
        cut=cut,
        sensitivity=sensitivity.astype(np.float32),
        stuck=(stuck if stages.faults else np.full(len(stuck), -1.0)).astype(np.int32),
    )


TOUCHED_CONDUCTANCE = 0.005
"""Least conductance at which a taxel has the noise of a touched one."""

REST_MARGIN = 1.2
"""Factor on the conductance of a bent taxel from which it counts as touched."""


def compute_touched_level(
    build: SensorBuild, stages: SensorStages
) -> Float[np.ndarray, "taxel"]:
    """Return the level from which a taxel has the noise of a touched one."""
    velostat = build.velostat
    electronics = build.electronics
    load = np.maximum(compute_free_load(build, stages), 0.0)
    grown = 1.0 + velostat.creep.sum(axis=1)
    rest = velostat.gain * load**velostat.exponent * grown
    threshold = TOUCHED_CONDUCTANCE + REST_MARGIN * rest
    match electronics.curve:
        case "divider":
            level = threshold / (1.0 + threshold)
        case "logarithmic":
            level = np.log1p(electronics.span * threshold) / np.log1p(electronics.span)
        case _:
            level = threshold
    return level.astype(np.float32)


CURVE_NUMBERS: dict[Curve, int] = {
    "linear": IN_PROPORTION,
    "divider": DIVIDER,
    "logarithmic": LOGARITHMIC,
}


def build_converter(build: SensorBuild, stages: SensorStages) -> Converter:
    """Build the curve of the converter, in proportion without that stage."""
    electronics = build.electronics
    curve = CURVE_NUMBERS[electronics.curve] if stages.divider else IN_PROPORTION
    return Converter(curve, electronics.span)


def compute_taxel_ages(
    build: SensorBuild, skin: Skin, stages: SensorStages
) -> Float[np.ndarray, "taxel"]:
    """Return when taxels are scanned before their reading is assembled [s]."""
    if not stages.skew:
        return np.zeros(skin.count)
    rows = np.array([patch.rows for patch in skin.patches])[skin.patch_index]
    phase = build.electronics.phase
    scan = build.electronics.scan
    return phase[skin.patch_index] + scan * (1.0 - skin.rows / rows)


def build_layer_state(layer: SensorLayer) -> LayerState:
    """Build the state of an untouched laminate; bent taxels have crept already."""
    rest = np.maximum(layer.load, 0.0)
    live = len(rest)
    operators = len(layer.play_widths)
    processes = len(layer.creep_part)
    crept = np.repeat((rest > 0.0).astype(np.float64)[:, None], processes, axis=1)
    return LayerState(
        play_positions=np.zeros((live, operators)),
        creep=crept,
        slow_creep=np.zeros((live, processes)),
        max_load=np.maximum(rest, layer.play_min_load),
        play_output=np.full(live, -1.0),
        power=np.zeros(live),
        peak=np.zeros(live),
        baseline_shift=np.zeros(live),
        touches=np.zeros(live, dtype=np.int64),
        loaded=rest > 0.0,
        touched=np.zeros(live, dtype=bool),
    )
