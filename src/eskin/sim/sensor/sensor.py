"""The sensor as a whole: pressures of touched taxels in, counts of all out."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.sensor.build import Build
from eskin.sim.sensor.noise import BLOCK
from eskin.sim.sensor.running import Sensor
from eskin.sim.sensor.session import Session
from eskin.sim.sensor.stages import Stages
from eskin.sim.sensor.working import load_of
from eskin.skin import Skin

__all__ = ["BLOCK", "Stages", "sense"]


def sense(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: Build,
    skin: Skin,
    rng: np.random.Generator,
    stages: Stages | None = None,
    session: Session | None = None,
    lead: int = 0,
) -> tuple[Int[np.ndarray, "reading taxel"], Bool[np.ndarray, "reading taxel"]]:
    """What the skin counts, and what of it arrives.

    The same numbers are drawn whatever the stages and the pressures, so two calls with
    generators in the same state can be compared.

    Args:
        pressure: of the active taxels after the film, at steps of `time.step` [kPa].
        taxels: the active ones, as indices of the skin, each once.
        build: the skin as built.
        skin: its taxels.
        rng: to draw from.
        stages: which stages work; all unless given.
        session: what has drifted since calibration; drawn unless given.
        lead: steps before the first reading, in which creep builds up.

    Raises:
        ValueError: pressures and taxels do not belong together.
    """
    check(pressure, taxels, lead)
    stages = stages or Stages()
    live = live_taxels(pressure, taxels, build, skin, stages)
    sensor = Sensor(build, skin, rng, stages, session, live)
    sensor.push(pressure, taxels)
    ratio = round(build.electronics.period / build.electronics.step)
    readings = (len(pressure) - lead) // ratio
    places = lead + ratio * np.arange(readings, dtype=np.float64)
    counts = np.zeros((readings, skin.count), np.int32)
    for start in range(0, readings, BLOCK):
        part = slice(start, start + BLOCK)
        counts[part] = sensor.read(places[part])
    received = ~sensor.losses.all(readings)[:, skin.patch_index]
    counts[~received] = 0
    return counts, received


def check(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    lead: int,
) -> None:
    """Refuse what does not belong together."""
    if pressure.ndim != 2 or pressure.shape[1] != len(taxels):
        raise ValueError(
            f"pressure has shape {pressure.shape} for {len(taxels)} taxels; allowed is "
            "one column a taxel; pass the taxels that it is of"
        )
    if not np.isfinite(pressure).all():
        raise ValueError(
            "pressure is not finite everywhere; allowed are finite numbers [kPa]; "
            "correct the contact that it comes from"
        )
    if len(np.unique(taxels)) != len(taxels):
        raise ValueError(
            "taxels name some taxel twice; allowed is once; add their pressures"
        )
    if not 0 <= lead <= len(pressure):
        raise ValueError(
            f"lead is {lead} for {len(pressure)} steps; allowed is from 0 to all of "
            "them; pass a longer series"
        )


def live_taxels(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: Build,
    skin: Skin,
    stages: Stages,
) -> Int[np.ndarray, "live"]:
    """Taxels that ever conduct, sorted by patch."""
    conducts = load_of(build, stages) > 0.0
    conducts[taxels[pressure.max(axis=0, initial=0.0) > 0.0]] = True
    live = np.flatnonzero(conducts)
    return live[np.argsort(skin.patch_index[live], kind="stable")]
