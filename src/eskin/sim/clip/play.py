"""Playing a scene: contact, film and sensor, and the truth beside them."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.clip.outcome import Clip, TrueSeries
from eskin.sim.clip.plan import BuildOrigin, Origin
from eskin.sim.clip.scene import Part, Scene, add_up, parts_of
from eskin.sim.clip.witness import series_of
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.film import grid_neighbours, leak_share, spread
from eskin.sim.robot.world import World
from eskin.sim.sensor.build import Build, draw_build
from eskin.sim.sensor.sensor import Stages, sense
from eskin.sim.sensor.session import Session, draw_session
from eskin.skin import MountedSkin, Skin


@lru_cache(maxsize=16)
def build_of(origin: BuildOrigin, world: World) -> Build:
    """The build of an origin; the same one every time."""
    skin, constants = world.mounted.skin, world.constants
    return draw_build(origin.name, origin.kind, skin, constants, origin.rng())


@lru_cache(maxsize=16)
def session_of(origin: Origin, build: Build) -> Session:
    """The session of an origin; the same one every time."""
    return draw_session(build, origin.rng())


@lru_cache(maxsize=4)
def neighbours_of(skin: Skin) -> Int[np.ndarray, "taxel 4"]:
    """Taxels beside each one in its patch's grid, kept."""
    return grid_neighbours(skin)


def play(
    scene: Scene,
    lead: int,
    build: Build,
    session: Session,
    world: World,
    rng: np.random.Generator,
    stages: Stages | None = None,
) -> Clip:
    """What the sensor counts of a scene, and what truly happened in it.

    Args:
        scene: what happens, from `lead` steps before the clip on.
        lead: steps before the clip, in which contacts and creep build up.
        build: the skin as built.
        session: what has drifted since calibration.
        world: the robot in its skin.
        rng: to draw noise from.
        stages: which stages of the sensor work; all unless given.
    """
    skin = world.mounted.skin
    felt = felt_in(scene, world)
    pressure, taxels = pressure_of(felt, scene.steps, build, skin)
    counts, received = sense(pressure, taxels, build, skin, rng, stages, session, lead)
    every = readings_every(world)
    truths = truths_of(scene, felt, world.charts, world.mounted, lead, world)
    return Clip(
        counts=counts,
        received=received,
        q=scene.q[lead::every][: len(counts)],
        truths=truths,
        pose_group=0,
        drawn={},
    )


def pressure_of(
    felt: list[list[Part]], steps: int, build: Build, skin: Skin
) -> tuple[Float[np.ndarray, "time active"], Int[np.ndarray, "active"]]:
    """Pressure of all touches after the film [kPa], and the taxels it is on."""
    pressure, taxels = add_up([p for ps in felt for p in ps], steps, skin.count)
    beta = leak_share(build.film_sigma, skin.areas)
    return spread(pressure, taxels, neighbours_of(skin), beta)


def readings_every(world: World) -> int:
    """Steps between two readings of the sensor."""
    value = world.constants.value
    return round(value("sensor.period") / value("time.step"))


def truths_of(
    scene: Scene,
    felt: list[list[Part]],
    charts: tuple[Chart, ...],
    mounted: MountedSkin,
    lead: int,
    world: World,
) -> tuple[TrueSeries, ...]:
    """What truly happened, of every touch that presses.

    Args:
        scene: what happens.
        felt: what each of its touches does to the skin.
        charts: that the touches are on.
        mounted: the skin of these charts on its robot.
        lead: steps before the clip.
        world: says how time is cut.
    """
    every, step = readings_every(world), world.constants.value("time.step")
    return tuple(
        series_of(number, touch, parts, charts, mounted, scene.q, lead, every, step)
        for number, (touch, parts) in enumerate(zip(scene.touches, felt, strict=True))
        if touch.presses
    )


def felt_in(scene: Scene, world: World) -> list[list[Part]]:
    """What each touch of a scene does to the skin."""
    return [
        parts_of(touch, scene.steps, world.charts, world.constants)
        for touch in scene.touches
    ]
