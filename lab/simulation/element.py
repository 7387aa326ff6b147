"""Check one simulated element under the loads of the public velostat logs."""

from dataclasses import fields, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.sensor.build import SensorBuild, build_nominal_sensor, draw_build
from eskin.sim.sensor.model import SensorSession, SensorStages, draw_session
from eskin.sim.sensor.sensor import sense
from eskin.skin import Skin
from lab.simulation.check import BandCheck, at_most, within
from lab.simulation.physics import ur5

LOGS = "Lupasic, logs of velostat, c319860"
NONE = SensorStages(**{field.name: False for field in fields(SensorStages)})
ELEMENT = replace(NONE, power=True, creep=True, hysteresis=True, divider=True)
CROSSED = replace(ELEMENT, ghosting=True)
EXPONENT = 0.76
"""Exponent of the element that was pressed longest."""
TAXEL = 14
LOAD = 20.0  # [kPa]
PRESS = {0.1: -0.303, 0.2: -0.223, 0.4: -0.114, 1.2: 0.051}
"""ln of the ratio of the conductance to that after 0.8 s, by time [s]."""
HOLD = {0.5: 0.905, 1: 0.925, 2: 0.955, 10: 1.035, 20: 1.085, 40: 1.17, 60: 1.21}
"""Ratio of the conductance to that at 5 s of the log, which began after 1 s of load."""
REPEATS = 20
"""Number of builds or sessions that are drawn."""

Series = Float[np.ndarray, "time"]


def element_checks(
    constants: Constants, seed: int, repeats: int = REPEATS
) -> list[BandCheck]:
    """Check one element against the logs, with `repeats` random draws."""
    skin = ur5()[0].skin
    build = build_element(skin, constants)
    play = partial(conductance, build=build, skin=skin, constants=constants)
    return [
        *exponent_checks(skin, constants, seed, repeats),
        *creep_checks(play, constants),
        release_check(play, constants),
        repeat_check(skin, constants, seed, repeats),
        *loop_checks(play, constants),
        *noise_checks(skin, constants, seed, repeats),
        *ghost_checks(skin, constants, seed, repeats),
    ]


def build_element(skin: Skin, constants: Constants) -> SensorBuild:
    """Build a nominal sensor with the element's exponent and a fine converter."""
    build = build_nominal_sensor(skin, constants)
    exponent = np.full(skin.count, EXPONENT)
    return replace(
        build,
        velostat=replace(build.velostat, exponent=exponent),
        electronics=replace(build.electronics, bits=20),
    )


def conductance(
    series: Series, build: SensorBuild, skin: Skin, constants: Constants
) -> Float[np.ndarray, "reading"]:
    """Return the conductance of one taxel by its counts; 1 is half scale."""
    counts, _ = sense(
        series[:, None],
        np.array([TAXEL]),
        build,
        skin,
        np.random.default_rng(1),
        ELEMENT,
        SensorSession(np.ones(skin.count), 0.0),
    )
    share = counts[:, TAXEL] / build.electronics.full_scale
    return share / (1.0 - share)


def stepped(seconds: float, step: float, after: float = 0.0) -> Series:
    """Return the load that begins after 0.1 s and ends [kPa]."""
    lengths = [round(part / step) for part in (0.1, seconds, after)]
    return np.repeat([0.0, LOAD, 0.0], lengths)


def exponent_checks(
    skin: Skin, constants: Constants, seed: int, repeats: int
) -> list[BandCheck]:
    """Check the exponents of the element's plateaus and of the taxels of builds.

    The mean should lie within the logged deviation, 0.16, of the logged one, and the
    deviation between half of that and twice it.
    """
    rng = np.random.default_rng([seed, 64])
    exponents = np.concatenate(
        [
            draw_build("e", "fresh", skin, constants, rng).velostat.exponent
            for _ in range(repeats)
        ]
    )
    build = build_element(skin, constants)
    step = constants.value("time.step")
    loads = np.array([0.25, 0.5, 1.0, 2.0])
    plateaus = [
        conductance(share * stepped(1.0, step), build, skin, constants)[-1]
        for share in loads
    ]
    slope = np.polyfit(np.log(loads), np.log(plateaus), 1)[0]
    return [
        within("exponent, from plateaus of the element", slope, 0.72, 0.80, LOGS),
        within("exponent of fresh builds, mean", exponents.mean(), 0.6, 0.92, LOGS),
        within("exponent of fresh builds, SD", exponents.std(), 0.08, 0.32, LOGS),
    ]


def creep_checks(play: partial, constants: Constants) -> list[BandCheck]:
    """Check the creep of presses and of long holds."""
    step = constants.value("time.step")
    period = constants.value("sensor.period")
    short = play(stepped(1.5, step))
    long = play(stepped(62.0, step))
    onset = round(0.1 / period)

    def at(series: Float[np.ndarray, "reading"], seconds: float) -> float:
        return float(series[onset + round(seconds / period)])

    press = [
        within(
            f"press: ln conductance at {seconds:g} s by 0.8 s",
            np.log(at(short, seconds) / at(short, 0.8)), logged - 0.04, logged + 0.04,
            LOGS,
        )
        for seconds, logged in PRESS.items()
    ]  # fmt: skip
    hold = [
        within(
            f"hold: conductance at {seconds:g} s by 5 s of the log",
            at(long, seconds + 1) / at(long, 6), logged - 0.04, logged + 0.04, LOGS,
        )
        for seconds, logged in HOLD.items()
    ]  # fmt: skip
    return [*press, *hold]


def release_check(play: partial, constants: Constants) -> BandCheck:
    """Check the time from the end of the load to zero conductance."""
    step = constants.value("time.step")
    period = constants.value("sensor.period")
    read = play(stepped(1.0, step, after=0.3))
    released = 0.1 + 1.0
    last = np.flatnonzero(read > 0)[-1] * period
    late = 1e3 * max(last - released, 0.0)
    return at_most("release: conducts for, after the load", late, 20, LOGS, "ms")


def repeat_check(
    skin: Skin, constants: Constants, seed: int, repeats: int
) -> BandCheck:
    """Check the repeatability of presses between sessions."""
    rng = np.random.default_rng([seed, 65])
    build = draw_build("r", "fresh", skin, constants, rng)
    gains = [np.log(draw_session(build, rng).gain) for _ in range(repeats)]
    deviation = float(np.std(np.diff(gains, axis=0)))
    return within("press: SD of ln conductance, repeated", deviation, 0.03, 0.08, LOGS)


def loop_checks(play: partial, constants: Constants) -> list[BandCheck]:
    """Check the hysteresis of a ramp up and down."""
    step = constants.value("time.step")
    checks = []
    for seconds, low, high in ((0.5, 15, 35), (20.0, 7, 20)):
        up = np.linspace(0.0, 1.5 * LOAD, round(seconds / step) + 1)
        series = np.concatenate([up, up[-2::-1], [0.0]])
        read = play(series)
        pressure = series[::2]
        top = len(read) // 2
        falling = (pressure[top:][::-1], read[top:][::-1])
        back = np.interp(pressure[: top + 1], *falling)
        wide = 100 * float((back - read[: top + 1]).max() / read.max())
        name = f"loop of a ramp of {seconds:g} s, by full scale"
        checks.append(within(name, wide, low, high, LOGS, "%"))
    return checks


def noise_checks(
    skin: Skin, constants: Constants, seed: int, repeats: int
) -> list[BandCheck]:
    """Check the noise of idle taxels, scaled to an element that rests at half scale."""
    quiet = np.zeros((400, 0)), np.zeros(0, dtype=np.int64)
    stages = SensorStages(drift=False, faults=False)
    found = []
    for number in range(repeats):
        rng = np.random.default_rng([seed, 66, number])
        build = draw_build("n", "fresh", skin, constants, rng)
        same = SensorSession(np.ones(skin.count), 0.0)
        counts, _ = sense(*quiet, build, skin, rng, stages, same)
        # There a count is 4 / full scale of the resistance.
        found.append(400 * counts.std(axis=0).mean() / build.electronics.full_scale)
    return [within("noise, idle", float(np.mean(found)), 0.1, 0.25, LOGS, "%")]


def ghost_checks(
    skin: Skin, constants: Constants, seed: int, repeats: int
) -> list[BandCheck]:
    """Check the crosstalk of one pressed taxel to its row and column."""
    rows = (
        ("fresh", 4.0, "Castro et al. 2018"),
        ("shifted", 30.0, "Hidalgo-Lopez et al. 2018"),
    )
    return [
        at_most(
            f"one taxel pressed: largest other reading, {repeats} {kind} builds",
            100 * max(
                largest_ghost(kind, skin, constants, np.random.default_rng([seed, n]))
                for n in range(repeats)
            ), high, source, "%",
        )
        for kind, high, source in rows
    ]  # fmt: skip


def largest_ghost(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> float:
    """Return the ratio of the largest other reading to that of the pressed taxel."""
    law = "fresh" if kind == "fresh" else "shifted"
    drawn = draw_build("g", law, skin, constants, rng)
    plain = build_element(skin, constants)
    crossed = replace(
        plain.electronics, ghost=drawn.electronics.ghost, leak=drawn.electronics.leak
    )
    counts, _ = sense(
        stepped(1.0, constants.value("time.step"))[:, None],
        np.array([TAXEL]),
        replace(plain, electronics=crossed),
        skin,
        rng,
        CROSSED,
        SensorSession(np.ones(skin.count), 0.0),
    )
    last = counts[-1].astype(np.float64)
    return float(np.delete(last, TAXEL).max() / last[TAXEL])
