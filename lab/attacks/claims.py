"""Give calibrations and models that claim absurd or plausible constants to a skin.

    python -m lab.attacks claims [--count 300] [--only TEXT]

Each absurd claim must be refused with one line, or hold the arm, or leave a skin that
feels a fingertip of 20 N. Each plausible one must be accepted, without a hold before
that fingertip, and feel it. The skin is a grid on a table; its sensor is drawn from one
of the families of the simulation, and the arm is at work.
"""

import copy
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from eskin.command import Policy, PolicyConfig, load_commands
from eskin.drivers import ManualClock, SourceInfo
from eskin.errors import EskinError
from eskin.live import Model, Recognizer, load_model
from eskin.live.model_config import read_limits
from eskin.live.model_file import CARD_ADAPTER
from eskin.recording.records import NONE
from eskin.robot import load_robot
from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import BuildKind, SensorBuild, draw_build
from eskin.skin import MountedSkin, build_grid_skin
from eskin.stream import Context, Message, Recognition
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.attacks.played_line import START, HeldArm
from lab.tables import format_head, format_row

MOUNTED = MountedSkin(build_grid_skin(10, 10, calibrated=True), load_robot("table"))
RATE = 50.0
"""Scans a second."""
FORCE = 20.0
"""Force of the fingertip [N]."""
WIDTH = 0.005
"""Standard deviation of its pressure over the skin [m]."""
ONSET = 2.5
POKE_SECONDS = 0.5
END = 3.5
"""Begin and length of the poke, and the end of a try [s]."""
BASE = 0.05
"""Counts of a free taxel, as a share of full scale."""
KINDS: tuple[BuildKind, ...] = tuple(get_args(BuildKind))
FULL_SCALES = (255, 1023, 4095, 16383, 65535)
FACTORS = (1e-300, 1e-30, 1e-9, 1e-6, 1e-3, 1e-2, 1e2, 1e3, 1e6, 1e9, 1e30, 1e300)
OTHERS = (
    0,
    -1,
    -1e300,
    float("nan"),
    float("inf"),
    2**63,
    10**300,
    "x",
    "nan",
    None,
    [],
    {},
    True,
    [None],
    ["x"],
    [[1.0]],
)
"""Values of other types, or that are no sensible number."""


@dataclass(frozen=True)
class Command:
    """Claim absurd and plausible constants in calibrations and models."""

    count: int = 300
    """Number of claims of each row, drawn from all."""
    seed: int = 0
    """Seed of the draw, the sensors and their noise."""
    only: str = ""
    """Part of the names of the claims to try; by default all."""


@dataclass(frozen=True)
class Claim:
    """A claim is a file whose constants are used on a sensor."""

    name: str
    """What it claims."""
    kind: BuildKind
    """Kind of the sensor."""
    load: Callable[[], tuple[Calibration, Model]]
    """Reads the file."""
    full_scale: int | None = None
    """Full scale of the converter, where the sensor's build has another."""


@dataclass(frozen=True)
class Outcome:
    """An outcome tells what became of a claim."""

    word: str
    """`refused`, `held`, `felt`, `blind`, or the name of an unexpected error."""
    why: str = ""
    """Message of the error, or reason of the hold."""
    held_early: bool = False
    """Whether the arm was held before anything touched the skin."""


def build_pressure(
    middle: Float[np.ndarray, "3"], seconds: float
) -> Float[np.ndarray, "taxel"]:
    """Return the pressure of the fingertip on each taxel at a time [kPa]."""
    phase = (seconds - ONSET) / POKE_SECONDS
    if not 0.0 < phase < 1.0:
        return np.zeros(MOUNTED.skin.count)
    force = FORCE * min(np.sin(np.pi * phase) * 1.5, 1.0)
    squared = np.sum((MOUNTED.skin.positions - middle) ** 2, axis=1)
    peak = force / (2.0 * np.pi * WIDTH**2) / 1000.0
    return peak * np.exp(-squared / (2.0 * WIDTH**2))


def scale_calibration(calibration: Calibration, full_scale: int) -> Calibration:
    """Return the calibration of the same sensor with another converter."""
    factor = calibration.full_scale / full_scale
    return replace(calibration, gain=factor * calibration.gain, full_scale=full_scale)


def judge(claim: Claim, build: SensorBuild, seed: int) -> Outcome:
    """Use a claim on a sensor, poke it, and tell what became of it."""
    try:
        return poke(*claim.load(), draw_truth(claim, build), seed)
    except (EskinError, ValueError) as error:
        lines = str(error).splitlines()
        return Outcome("refused" if len(lines) == 1 else "not one line", str(error))
    except Exception as error:
        return Outcome(type(error).__name__, str(error))


def draw_truth(claim: Claim, build: SensorBuild) -> Calibration:
    """Return the true constants of the sensor that a claim is about."""
    truth = build.exact_calibration(MOUNTED.skin)
    return scale_calibration(truth, claim.full_scale or truth.full_scale)


def poke(
    calibration: Calibration, model: Model, truth: Calibration, seed: int
) -> Outcome:
    """Poke the sensor of a working arm once."""
    rng = np.random.default_rng((seed, 58))
    clock = ManualClock(START)
    skin = MOUNTED.skin
    vocabulary = model.card.vocabulary
    recognizer = Recognizer(model, MOUNTED, calibration)
    arm = HeldArm(clock)
    commands = load_commands(None, vocabulary, skin)
    policy = Policy(arm, commands, vocabulary, PolicyConfig(check_period=None))
    recognition = Recognition(recognizer)
    info = SourceInfo("claim:", MOUNTED, calibration, RATE)

    def publish(message: Message) -> None:
        if isinstance(message, policy.message_types):
            policy.on_message(message)

    for listener in (recognition, policy):
        listener.start(Context(info, clock, publish))
    middle = skin.positions[rng.integers(skin.count)]
    noise = max(0.001 * truth.full_scale, 0.3)
    felt = False
    early = False
    for number in range(round(END * RATE)):
        seconds = number / RATE
        clock.time = START + round(seconds * NS_PER_S)
        counts = truth.compute_counts(build_pressure(middle, seconds))
        counts += BASE * truth.full_scale + noise * rng.standard_normal(skin.count)
        counts = np.clip(np.round(counts), 0, truth.full_scale).astype(np.int32)
        received = np.ones(skin.count, bool)
        recognition.on_message(Scan(clock.time, counts, received, np.empty(0)))
        state = recognizer.state
        assert state is not None
        felt |= seconds > ONSET and any(row.confirmed for row in state.rows)
        for probabilities in recognizer.probabilities.values():
            if not np.isfinite(probabilities).all() and arm.held_at is None:
                return Outcome("not held", "a probability is not finite", early)
        early |= arm.held_at is not None and seconds < ONSET
    if felt:
        return Outcome("felt", held_early=early)
    if arm.reason is None:
        return Outcome("blind", held_early=early)
    return Outcome("held", str(arm.reason), early)


def read_changed(content: dict[str, Any], model: Model) -> tuple[Calibration, Model]:
    """Read a calibration from changed content, with an intact model."""
    return Calibration.from_bytes(json.dumps(content).encode()), model


def list_calibrations(
    kind: BuildKind, build: SensorBuild, model: Model
) -> Iterator[Claim]:
    """List absurd calibrations of a sensor, with one field changed in each."""
    exact = build.exact_calibration(MOUNTED.skin)
    count = MOUNTED.skin.count
    full = exact.full_scale
    true = replace(
        exact,
        source="presses",
        noise=np.full(count, 0.001 * full),
        rest=np.full(count, BASE * full),
        gain_deviation=np.array([0.1]),
        exponent_deviation=0.1,
        unfelt_deviation=0.1,
    )
    content = json.loads(true.to_bytes()) | {"span": true.span}
    for key in sorted(content):
        changes: dict[str, object] = {repr(other): other for other in OTHERS}
        value = content[key]
        size = content[key] or 1.0
        if isinstance(value, list):
            numbers = np.array(value)
            for factor in FACTORS:
                changes[f"x {factor:g}"] = list(factor * numbers)
                for name, part in (("some", 2), ("first", 1)):
                    changed = numbers.copy()
                    changed[: len(value) // part : part] *= factor
                    changes[f"{name} x {factor:g}"] = list(changed)
        elif not isinstance(value, str):
            changes |= {f"x {factor:g}": factor * size for factor in FACTORS}
            if key == "floor":
                changes |= {f"{kpa:g} kPa": kpa for kpa in (20.0, 500.0, 5e3, 1e12)}
        for what, changed in changes.items():
            load = partial(read_changed, content | {key: changed}, model)
            yield Claim(f"calibration, {kind}, {key} {what}", kind, load)


def list_numbers(settings: object, path: tuple[str, ...] = ()) -> Iterator[tuple]:
    """List the path, limits and value of every number in nested settings."""
    limits = read_limits(type(settings))
    for name, value in vars(settings).items():
        if hasattr(value, "__dataclass_fields__"):
            yield from list_numbers(value, (*path, name))
        elif isinstance(value, float | int | bool):
            yield (*path, name), limits.get(name, ()), value


def read_model_claim(
    model: Model, card: dict[str, Any], calibration: Calibration
) -> tuple[Calibration, Model]:
    """Write a model with a changed card, and read it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "claim.safetensors"
        model.save(path)
        data = path.read_bytes()
        length = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + length])
        header["__metadata__"]["eskin"] = json.dumps(card)
        text = json.dumps(header).encode()
        path.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + length :])
        return calibration, load_model(path)


def read_weights(
    model: Model, name: str, factor: float, kind: type, calibration: Calibration
) -> tuple[Calibration, Model]:
    """Write a model with one parameter, or all, multiplied, and read it."""
    with np.errstate(over="ignore"):
        weights = {
            key: (weight.astype(np.float64) * factor).astype(kind)
            if name in ("all", key)
            else weight
            for key, weight in model.weights.items()
        }
    with TemporaryDirectory() as folder:
        path = Path(folder) / "claim.safetensors"
        replace(model, weights=weights).save(path)
        return calibration, load_model(path)


def list_models(kind: BuildKind, build: SensorBuild, model: Model) -> Iterator[Claim]:
    """List absurd models, with one setting or parameter changed in each."""
    calibration = build.calibration(MOUNTED.skin)
    card = json.loads(CARD_ADAPTER.dump_json(model.card, by_alias=True))
    aliases = json.loads(CARD_ADAPTER.dump_json(model.card, by_alias=False))
    for path, limits, value in list_numbers(model.card):
        changes: dict[str, object] = {repr(other): other for other in OTHERS}
        changes |= {f"{factor:g}": factor for factor in FACTORS}
        changes |= {f"x {factor:g}": factor * value for factor in FACTORS}
        for limit in limits:
            if np.isfinite(limit):
                changes |= {f"{limit:g}, its limit": limit}
        for what, changed in changes.items():
            new = copy.deepcopy(card)
            place = new
            plain = aliases
            for name in path[:-1]:
                place = place[name]
                plain = plain[name]
            place[list(place)[list(plain).index(path[-1])]] = changed
            load = partial(read_model_claim, model, new, calibration)
            yield Claim(f"model, {kind}, {'.'.join(path)} {what}", kind, load)
    for name in ("all", *model.weights):
        for factor in (0.0, *FACTORS):
            for dtype in (np.float32, np.float64):
                arguments = (model, name, factor, dtype, calibration)
                load = partial(read_weights, *arguments)
                what = f"{name} x {factor:g} in {dtype.__name__}"
                yield Claim(f"model, {kind}, {what}", kind, load)


def list_plausible(
    kind: BuildKind, build: SensorBuild, model: Model
) -> Iterator[Claim]:
    """List plausible calibrations of a sensor, by data sheet and as measured."""
    skin = MOUNTED.skin
    for full_scale in FULL_SCALES:
        nominal, exact = (
            scale_calibration(one, full_scale)
            for one in (build.calibration(skin), build.exact_calibration(skin))
        )
        rest = np.full(skin.count, BASE * full_scale)
        noise = np.full(skin.count, max(0.001 * full_scale, 0.42))
        measured = replace(nominal, source="rest", rest=rest, noise=noise)
        claims = {
            "nominal": nominal,
            "rest measured": measured,
            "under a sleeve": replace(nominal, floor=0.05 * 60.0),
            "exact": replace(exact, rest=rest, noise=noise),
        }
        for name, calibration in claims.items():
            content = json.loads(calibration.to_bytes())
            load = partial(read_changed, content, model)
            what = f"plausible, {kind}, {name}, {full_scale} counts"
            yield Claim(what, kind, load, full_scale)


LISTS = {
    "absurd calibrations": list_calibrations,
    "absurd models": list_models,
    "plausible calibrations": list_plausible,
}
"""Rows of the table, and what lists the claims of each for one sensor."""
BUILDS = {"plausible calibrations": 8}
"""Number of sensors of each kind; one unless given."""


def is_good(row: str, outcome: Outcome) -> bool:
    """Return whether a claim had an outcome that is right for its row."""
    if row == "plausible calibrations":
        return outcome.word == "felt" and not outcome.held_early
    return outcome.word in ("refused", "held", "felt")


def main(command: Command) -> None:
    """Try the claims, print a table, and exit with 1 where an outcome is wrong."""
    model = load_model("ur5")
    constants = load_constants()
    wrong = 0
    assert NONE in model.card.vocabulary
    np.seterr(all="raise", under="ignore")
    print(format_head(["claims", "tried", "outcomes", "wrong"]))
    for row, list_claims in LISTS.items():
        rng = np.random.default_rng((command.seed, 59))
        tries = []
        for kind in KINDS:
            for number in range(BUILDS.get(row, 1)):
                seed = np.random.default_rng((command.seed, number, 60))
                build = draw_build(row, kind, MOUNTED.skin, constants, seed)
                for claim in list_claims(kind, build, model):
                    if command.only in claim.name:
                        tries.append((claim, build))
        chosen = rng.permutation(len(tries))[: command.count]
        found = [(tries[n][0], judge(*tries[n], seed=int(n))) for n in sorted(chosen)]
        bad = [(claim, out) for claim, out in found if not is_good(row, out)]
        counts = Counter(outcome.word for _, outcome in found)
        said = ", ".join(f"{word} {count}" for word, count in counts.most_common())
        print(format_row([row, str(len(found)), said, str(len(bad))]), flush=True)
        for claim, outcome in bad:
            print(f"<!-- {claim.name}: {outcome.word} {outcome.why:.200} -->")
        wrong += len(bad)
    sys.exit(bool(wrong))
