"""Draw streams of people on builds that release slowly, and on builds that creep."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from eskin.recording import find_recordings
from eskin.sim.constants import Constant, Constants, Distribution, load_constants
from eskin.sim.contact.press import TrueTouch
from eskin.sim.dataset import GenerationSettings, generate
from eskin.sim.dataset.clip import SimulatedClip, get_build, get_session
from eskin.sim.dataset.clip_generator import ClipGenerator, Simulator
from eskin.sim.dataset.plan import BuildOrigin, ClipPlan, build_rng
from eskin.sim.dataset.staging import ClipSetup, draw_stream, set_up_clip
from eskin.sim.scene.environment import load_environment
from eskin.sim.scene.scene import (
    TouchScene,
    compute_scene_pressure,
    compute_touch_presses,
    compute_true_series,
    find_contact_steps,
    find_reading_edges,
)
from eskin.sim.sensor import Sensor, SensorBuild, SensorSession, draw_build
from eskin.sim.sensor.flaws import RISE_SPAN
from eskin.sim.sensor.noise import NOISE_BLOCK
from eskin.skin import Skin
from eskin.touch import Calibration

SLOW = (0.3, 0.8)
"""Range of the time in which the signal of slow builds falls from 90 to 10 % [s]."""
FAST = (0.03, 0.03)
"""The same of the builds of a control, with the touches of the slow ones: a typical
time."""
SLOWER = (RISE_SPAN * 0.3, RISE_SPAN * 0.8)
"""The same of builds whose time constants are 0.3 to 0.8 s."""
SHORT_PAUSE = (0.6, 0.8)
"""Range of the time between two touches where they follow fast on each other [s]."""
CREEP = (0.05, 0.15)
"""Range of the part of the peak of its signal that a taxel keeps after a touch."""
CREEP_TIME = (1.0, 3.0)
"""Range of the time constants with which that decays [s]."""
CREEP_REACH = 0.008
"""Distance over which the taxels around share the creep [m]."""
LEAST_CREEP = 1e-4
"""Conductance below which creep is left out; less than any converter resolves."""
CREEP_SEED = 74
BUILDS_NAME = "builds.json"


@dataclass(frozen=True)
class Draw:
    """A draw says what streams a set has."""

    set_name: str
    """Published set that it is otherwise like."""
    streams: int
    """Number of streams, 90 s long on average."""
    fall: tuple[float, float] | None = None
    """Range of the time in which the signal of builds of families falls from 90 to
    10 % [s]; None for that of the published set."""
    has_short_pauses: bool = False
    """Whether pauses between touches are in `SHORT_PAUSE`."""
    creeps: bool | None = None
    """Whether builds creep by `CREEP`; False draws the same streams without, None
    streams of the published set."""


DRAWS = {
    "slow": Draw("streams-families", 16, fall=SLOW, has_short_pauses=True),
    "slow-control": Draw("streams-families", 16, fall=FAST, has_short_pauses=True),
    "slower": Draw("streams-families", 16, fall=SLOWER, has_short_pauses=True),
    "fresh": Draw("streams-fresh", 40),
    "fresh-short": Draw("streams-fresh", 16, has_short_pauses=True),
    "families": Draw("streams-families", 40),
    "creep": Draw("streams-fresh", 16, creeps=True),
    "no-creep": Draw("streams-fresh", 16, creeps=False),
}
"""Draws by name."""


def change_constants(draw: Draw) -> Constants:
    """Return the constants of the simulation of a draw."""
    changed: dict[str, Constant] = {}
    if draw.fall is not None:
        low, high = draw.fall
        changed["flaw.fall"] = build_uniform(low, high)
    if draw.has_short_pauses:
        low, high = SHORT_PAUSE
        changed["stream.pause"] = build_uniform(low, high)
    constants = load_constants()
    return replace(constants, entries=constants.entries | changed)


def build_uniform(low: float, high: float) -> Constant:
    """Build a constant that is drawn between two times [s]."""
    spread = Distribution(law="uniform", low=low, high=high)
    return Constant(spread=spread, unit="s", source="design")


@dataclass(frozen=True)
class DrawFactory:
    """This factory builds the generator of a draw, in any process."""

    draw: Draw
    """What it generates."""

    def __call__(self, skin: str) -> ClipGenerator:
        """Build the generator for a skin."""
        simulator = Simulator(skin, change_constants(self.draw))
        if self.draw.creeps is None:
            return simulator
        return CreepSimulator(simulator, self.draw.creeps)


@final
class CreepSimulator(ClipGenerator):
    """This generator simulates streams whose touches leave a part of their signal."""

    def __init__(self, simulator: Simulator, creeps: bool) -> None:
        """Take the simulator of people and skin; `creeps` is False for a control."""
        self.simulator = simulator
        self.creeps = creeps
        self.mounted = simulator.mounted
        self.robot_name = simulator.robot_name
        self.urdf = simulator.urdf

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""
        return self.simulator.calibration(build)

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the stream of a plan; its lead-in is as of any stream."""
        if plan.gesture is not None:
            return self.simulator.make(plan)
        env = self.simulator.env
        setup = set_up_clip(plan, plan.kind or "", env, plan.rng())
        touches = draw_stream(setup)
        build = get_build(plan.build, env)
        session = get_session(plan.session, build)
        return self.simulate(setup, touches, build, session)

    def simulate(
        self,
        setup: ClipSetup,
        touches: tuple[TrueTouch, ...],
        build: SensorBuild,
        session: SensorSession,
    ) -> SimulatedClip:
        """Simulate touches with what they leave, as `simulate_clip` does without."""
        env = setup.env
        skin = env.mounted.skin
        scene = TouchScene(setup.q, touches)
        presses = compute_touch_presses(scene, env)
        pressure, taxels = compute_scene_pressure(
            presses, scene.steps, build.film_sigma, skin
        )
        every = np.argsort(skin.patch_index, kind="stable")
        sensor = Sensor(build, skin, setup.rng, session=session, live=every)
        sensor.simulate_steps(pressure, taxels)
        if self.creeps:
            leave_creep(sensor, skin, *draw_creep(setup, touches))
        electronics = build.electronics
        ratio = electronics.period / electronics.step
        readings = int((len(pressure) - setup.lead) / ratio + 1e-9)
        counts, received = read_all(sensor, skin, setup.lead, ratio, readings)
        edges = find_reading_edges(setup.lead, readings, ratio)
        truths = compute_true_series(
            scene,
            presses,
            env.charts,
            env.mounted,
            setup.lead,
            edges,
            electronics.step,
        )
        q = scene.q[edges[:-1]]
        return SimulatedClip(counts, received, q, truths, 0, {})


def read_all(
    sensor: Sensor, skin: Skin, lead: int, ratio: float, readings: int
) -> tuple[Int[np.ndarray, "reading taxel"], Bool[np.ndarray, "reading taxel"]]:
    """Read a sensor every `ratio` steps, from step `lead` on."""
    places = lead + ratio * np.arange(readings, dtype=np.float64)
    counts = np.zeros((readings, skin.count), np.int32)
    for start in range(0, readings, NOISE_BLOCK):
        part = slice(start, start + NOISE_BLOCK)
        counts[part] = sensor.read(places[part])
    lost = sensor.losses.draw_all(readings).take(skin.patch_index, axis=1)
    counts[lost] = 0
    return counts, ~lost


def draw_creep(
    setup: ClipSetup, touches: Sequence[TrueTouch]
) -> tuple[Float[np.ndarray, "time"], Float[np.ndarray, "time"]]:
    """Draw how much each touch leaves, and how fast it decays.

    Returns:
        The part of the signal that is left and the number of time constants that have
        passed, at each step of the scene. Both change where a touch begins.
    """
    rng = build_rng((*setup.plan.seed, CREEP_SEED))
    step = setup.env.constants.value("time.step")
    share = np.full(len(setup.q), rng.uniform(*CREEP))
    seconds = np.full(len(setup.q), rng.uniform(*CREEP_TIME))
    for onset in sorted(find_contact_steps(touch)[0] for touch in touches):
        share[onset:] = rng.uniform(*CREEP)
        seconds[onset:] = rng.uniform(*CREEP_TIME)
    return share, np.cumsum(step / seconds)


def leave_creep(
    sensor: Sensor,
    skin: Skin,
    share: Float[np.ndarray, "time"],
    passed: Float[np.ndarray, "time"],
) -> None:
    """Let the signal of a sensor fall to no less than what its touches have left.

    A taxel keeps a part of the greatest signal, its own or that of one around by a
    Gaussian weight of their distance; that decays exponentially.
    """
    signal = sensor.conductance
    for patch in np.unique(skin.patch_index):
        own = np.flatnonzero(skin.patch_index[sensor.live] == patch)
        pressed = own[(signal[:, own] > 0.0).any(axis=0)]
        if not len(pressed):
            continue
        positions = skin.positions[sensor.live]
        distance = cdist(positions[own], positions[pressed])
        weight = np.exp(-0.5 * (distance / CREEP_REACH) ** 2)
        source = signal[:, pressed].astype(np.float64) * share[:, None]
        for taxel, weights in zip(own, weight, strict=True):
            if weights.max() < 0.01:
                continue
            most = (source * weights).max(axis=1)
            left = decay(most, passed)
            shown = np.maximum(signal[:, taxel], left)
            signal[:, taxel] = np.where(left > LEAST_CREEP, shown, signal[:, taxel])


def decay(
    most: Float[np.ndarray, "time"], passed: Float[np.ndarray, "time"]
) -> Float[np.ndarray, "time"]:
    """Return the largest of earlier values, each decayed by what has passed since.

    `passed` counts time constants.
    """
    tiny = 1e-12
    ln = np.log(np.maximum(most, tiny)) + passed
    return np.exp(np.maximum.accumulate(ln) - passed)


def find_folder(folder: Path, name: str, seed: int) -> Path:
    """Return the folder of a draw by a seed."""
    return folder / f"{name}-seed{seed}"


def make(folder: Path, name: str, seed: int, streams: int | None, workers: int) -> Path:
    """Generate the streams of a draw, unless they exist; return their folder."""
    draw = DRAWS[name]
    settings = GenerationSettings(
        draw.set_name, seed=seed, clips=streams or draw.streams
    )
    made = find_folder(folder, name, seed)
    made.mkdir(parents=True, exist_ok=True)
    builds = made / BUILDS_NAME
    facts = {"draw": repr(draw), "builds": dict(describe_builds(draw, settings))}
    if builds.exists() and json.loads(builds.read_text("utf-8")) != facts:
        raise ValueError(
            f"{made} was made by another draw; allowed is the one named '{name}'; give "
            "a new folder"
        )
    builds.write_text(json.dumps(facts, indent=1) + "\n", "utf-8")
    generate(made, settings, workers, DrawFactory(draw))
    return made


def describe_builds(
    draw: Draw, settings: GenerationSettings
) -> Iterator[tuple[str, dict[str, float | str]]]:
    """Yield the file of each stream, and the facts of its build."""
    skin = load_environment(settings.skin).mounted.skin
    constants = change_constants(draw)
    for session in settings.sessions:
        origin = session.build
        rng = origin.rng()
        build = draw_build(origin.name, origin.kind, skin, constants, rng)
        fall = build.flaws.fall if build.flaws else 0.0
        yield session.file, {"kind": build.kind, "time constant": fall}


def read_builds(folder: Path) -> dict[str, dict[str, float | str]]:
    """Return the facts of the build of each stream, by its file."""
    return json.loads((folder / BUILDS_NAME).read_text("utf-8"))["builds"]


def find_streams(folder: Path) -> list[Path]:
    """Return the recordings of a draw, in order."""
    return sorted(find_recordings([folder]))
