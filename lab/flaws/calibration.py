"""Measure what a calibration from rest and five presses gains.

    python -m lab.flaws calibration
    python -m lab.flaws calibration --kinds divider linear --builds 9 --json FILE

Builds of each kind are drawn. Each is calibrated as by `eskin calibrate`, from rest and
presses of a fingertip at the places that are asked for, whose forces vary as people's
do; once without knowing them, once with a gauge that reads them within 5 %. Then other
presses, with other forces and places, and clips of gestures are read with the nominal
calibration (what a data sheet says), both measured ones and the exact one. It prints,
with intervals over builds:

- the error of the scale of force, as the mean over patches of |m|, where m is the
  median over presses of ln(measured / expected force); expected is what a fingertip of
  the true force shows on taxels of this calibration;
- the accuracy of the shipped weights on the clips;
- the share of patches whose true scale of force lies in the 95 % interval of the
  calibration.
"""

import json
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from eskin.calibration import (
    CalibrationGuide,
    FingertipPress,
    GainPrior,
    GuideConfig,
    estimate_gains,
)
from eskin.calibration.fingertip import (
    FORCES,
    PA_PER_KPA,
    FingertipResponse,
    TaxelConstants,
)
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import evaluate
from eskin.learn.metrics import bootstrap_mean
from eskin.live import load_model
from eskin.sim.dataset import GenerationSettings, Simulator
from eskin.sim.dataset.plan import BuildOrigin, build_seed
from eskin.sim.dataset.session_file import write_session
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.interactive.hand import LinkPoint
from eskin.sim.sensor.build import BuildKind, SensorBuild, compute_nominal_half
from eskin.sim.sensor.flaws import FAMILIES
from eskin.sim.sensor.velostat import count_steps_from_edge
from eskin.skin import Skin
from eskin.touch import Calibration, Scan, TouchPipeline
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

NOMINAL, PRESSES, GAUGE, EXACT = "nominal", "presses", "gauge", "exact"
CALIBRATIONS = (NOMINAL, PRESSES, GAUGE, EXACT)
MAX_MISSED = 3
"""Number of presses in a row that are not felt before a patch is left out."""
LONGEST_REST = 30.0
"""Longest time in which rest is looked for [s]; then nothing is calibrated."""
REST_SECONDS, PRESS_SECONDS, PAUSE_SECONDS = 6.0, 1.0, 0.7
NEARBY = 0.004
"""Standard deviation of the place of a press from where it was asked for [m]."""
NEAR = 0.02
"""Distance from a press within which taxels measure its force [m]."""
TEST_SPREAD = 0.5
"""Standard deviation of ln force of the presses that are tested."""
WITHIN = 1.96
"""Half width of a 95 % interval, in standard deviations."""


@dataclass(frozen=True)
class Command:
    """Compare calibrations of simulated builds."""

    kinds: tuple[BuildKind, ...] = FAMILIES
    """Laws that builds are drawn from."""
    builds: int = 20
    """Number of builds of each kind."""
    clips: int = 40
    """Number of clips on each build; 0 leaves accuracy out."""
    tests: int = 6
    """Number of presses of each patch that are tested."""
    skin: str = "ur5"
    """Preset skin."""
    model: str = "ur5"
    """Weights."""
    seed: int = 0
    """Seed of the first build."""
    json: Path | None = None
    """Path of a file to which the figures of each build are appended."""


@dataclass(frozen=True)
class GainResult:
    """A result holds the figures of one build, by calibration."""

    kind: str
    seed: int
    error: dict[str, float]
    """Mean over patches of |median of ln(measured / expected force)|."""
    accuracy: dict[str, float]
    """Accuracy on the clips; empty without clips."""
    inside: dict[str, list[bool]]
    """Of each patch, whether its scale of force lies in the 95 % interval."""
    used: float
    """Presses that were used, by those that were asked for."""
    deviation: dict[str, float]
    """Mean standard deviation of ln gain that the calibration states."""


class PressedSkin:
    """A simulated skin that is pressed on request, scan after scan."""

    def __init__(self, command: Command, kind: BuildKind, seed: int) -> None:
        """Draw the build and the person."""
        self.device = InteractiveSkin(command.skin, seed, kind)  # type: ignore[arg-type]
        self.skin: Skin = self.device.mounted.skin
        self.rng = np.random.default_rng(seed)
        self.q = np.zeros(len(self.device.mounted.robot.joint_names))
        self.stamp = NS_PER_S
        self.force = 0.0
        """Greatest true force since the last press began [N]."""

    def scans(self, seconds: float) -> Iterator[Scan]:
        """Yield the scans of some time."""
        for _ in range(round(seconds / self.device.period)):
            self.stamp += round(self.device.period * NS_PER_S)
            scan = self.device.scan(self.stamp, self.q)
            truths = self.device.hand.truths()
            self.force = max(self.force, sum(truth.force for truth in truths))
            yield scan

    def press(self, taxel: int, force: float) -> Iterator[Scan]:
        """Press near a taxel with a force [N], and yield the scans."""
        away = NEARBY * self.rng.standard_normal(3)
        link = self.skin.patches[self.skin.patch_index[taxel]].link
        point = LinkPoint(link, self.skin.positions[taxel] + away)
        self.force = 0.0
        self.device.hand.poke(point, force, PRESS_SECONDS)
        yield from self.scans(PRESS_SECONDS + PAUSE_SECONDS)


def get_nominal(build: SensorBuild, skin: Skin, pressed: PressedSkin) -> Calibration:
    """Return what a data sheet says of a build."""
    calibration = build.calibration(skin)
    if build.kind not in ("fresh", "shifted"):
        return calibration
    constants = pressed.device.env.constants
    law = constants.get_constant("sensor.half_pressure.fresh").spread
    assert law is not None and law.median is not None
    half = compute_nominal_half(law.median, constants)
    return replace(calibration, gain=np.full(skin.count, half / calibration.full_scale))


def calibrate(
    pressed: PressedSkin, nominal: Calibration
) -> tuple[dict[str, Calibration], float]:
    """Calibrate without and with a gauge; return also the share of presses used."""
    skin, prior, rng = pressed.skin, GainPrior(), pressed.rng
    guide = CalibrationGuide(pressed.device.mounted, nominal, GuideConfig())
    usual = prior.force * np.exp(prior.person * rng.standard_normal())
    forces: list[float] = []
    missed = 0
    for scan in pressed.scans(LONGEST_REST):
        guide.push(scan)
        if guide.phase != "rest":
            break
    while (request := guide.request) is not None and guide.phase == "press":
        force = float(usual * np.exp(prior.press * rng.standard_normal()))
        before = len(guide.presses)
        for scan in pressed.press(request.taxel, min(max(force, 0.7), 25.0)):
            guide.push(scan)
        forces += [pressed.force] * (len(guide.presses) - before)
        missed = missed + 1 if len(guide.presses) == before else 0
        if missed == MAX_MISSED:
            guide.skip()
            missed = 0
    if guide.rest is None:
        return dict.fromkeys((NOMINAL, PRESSES, GAUGE), nominal), 0.0
    result = guide.finish()
    read = np.array(forces) * np.exp(prior.known * rng.standard_normal(len(forces)))
    gauged: tuple[FingertipPress, ...] = tuple(
        replace(press, force=float(force))
        for press, force in zip(result.presses, read, strict=True)
    )
    gains = estimate_gains(skin, nominal, gauged)
    found = {
        NOMINAL: nominal,
        PRESSES: result.calibration,
        GAUGE: gains.apply(result.calibration, skin),
    }
    asked = len(skin.patches) * guide.config.presses
    return found, len(result.presses) / asked


def press_for_test(
    pressed: PressedSkin, calibrations: Mapping[str, Calibration], count: int
) -> dict[str, np.ndarray]:
    """Press every patch, and return (press, 3): patch, ln true and ln shown force."""
    mounted, skin = pressed.device.mounted, pressed.skin
    pipelines = {n: TouchPipeline(mounted, c) for n, c in calibrations.items()}
    rows: dict[str, list[tuple[float, float, float]]] = {n: [] for n in pipelines}
    for scan in pressed.scans(REST_SECONDS / 2):
        for pipeline in pipelines.values():
            pipeline.push(scan)
    for patch in np.repeat(np.arange(len(skin.patches)), count):
        inner = (skin.patch_index == patch) & (count_steps_from_edge(skin) >= 1)
        taxel = int(pressed.rng.choice(np.flatnonzero(inner)))
        force = 4.0 * np.exp(TEST_SPREAD * pressed.rng.standard_normal())
        place = skin.positions[taxel]
        near = np.linalg.norm(skin.positions - place, axis=1) <= NEAR
        near &= skin.patch_index == patch
        areas = np.where(near, PA_PER_KPA * skin.areas, 0.0)
        series: dict[str, list[float]] = {name: [] for name in pipelines}
        for scan in pressed.press(taxel, float(np.clip(force, 0.7, 20.0))):
            for name, pipeline in pipelines.items():
                pressure = pipeline.push(scan).reading.pressure
                series[name].append(float(areas @ pressure))
        # What drift shows before the press is none of its force.
        shown = {name: max(values) - values[0] for name, values in series.items()}
        for name, value in shown.items():
            if value > 0.0 and pressed.force > 0.0:
                row = (float(patch), float(np.log(pressed.force)), float(np.log(value)))
                rows[name].append(row)
    return {name: np.array(found).reshape(-1, 3) for name, found in rows.items()}


def compare_with_expected(
    rows: np.ndarray, calibration: Calibration, skin: Skin
) -> np.ndarray:
    """Return ln shown force over what is expected at the true force, of each press."""
    errors = np.empty(len(rows))
    constants = TaxelConstants(0.0, calibration.exponent, calibration.unfelt)
    for n, (patch, true, shown) in enumerate(rows):
        members = skin.patch_index == int(patch)
        response = FingertipResponse(
            float(skin.areas[members].mean()),
            calibration,
            float(np.exp(np.log(calibration.gain[members]).mean())),
            0.0,
        )
        mean, _ = response.compute(constants)
        errors[n] = shown - np.interp(true, np.log(FORCES), mean)
    return errors


def average_patches(rows: np.ndarray, errors: np.ndarray) -> float:
    """Return the mean over patches of their absolute median error."""
    if not len(rows):
        return np.nan
    medians = [np.median(errors[rows[:, 0] == n]) for n in np.unique(rows[:, 0])]
    return float(np.mean(np.abs(medians)))


def find_inside(
    rows: np.ndarray, errors: np.ndarray, calibration: Calibration
) -> list[bool]:
    """Tell of each patch whether its mean error agrees with the deviation stated."""
    found = []
    if calibration.gain_deviation is None or len(rows) < 2:
        return found
    within = [
        errors[rows[:, 0] == n] - np.median(errors[rows[:, 0] == n])
        for n in np.unique(rows[:, 0])
    ]
    # Robust, since some presses hit dead taxels.
    scatter = 1.4826 * float(np.median(np.abs(np.concatenate(within))))
    for patch in np.unique(rows[:, 0]).astype(int):
        own = errors[rows[:, 0] == patch]
        # The median is less certain than a mean by 1.25.
        spread = np.hypot(
            calibration.gain_deviation[patch], 1.25 * scatter / np.sqrt(len(own))
        )
        found.append(bool(np.abs(np.median(own)) <= WITHIN * spread))
    return found


def measure_accuracy(
    command: Command,
    kind: BuildKind,
    seed: int,
    calibrations: Mapping[str, Calibration],
) -> dict[str, float]:
    """Return the accuracy of the weights on clips of the build, by calibration."""
    if not command.clips:
        return {}
    settings = GenerationSettings("test-s", command.skin, seed, command.clips, 1)
    plan = settings.sessions[0]
    # The build of `InteractiveSkin`.
    name, drawn = f"demo-b{seed}", build_seed(f"build demo {kind}", 0, 0, seed)
    origin = BuildOrigin(name, drawn, kind)  # type: ignore[arg-type]
    plan = replace(plan, build=origin)
    model = load_model(command.model)
    network = to_network(model)
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        write_session(Path(folder), settings, plan, Simulator(command.skin))
        for name, calibration in calibrations.items():
            dataset = prepare(
                [Path(folder) / plan.file],
                model.card.pipeline,
                model.card.graph_used,
                calibration=calibration,
            )
            found[name] = evaluate(network, model.card, dataset).segments.accuracy
    return found


def run_build(command: Command, kind: BuildKind, seed: int) -> GainResult:
    """Calibrate one build in all ways, and test them."""
    pressed = PressedSkin(command, kind, seed)
    build, skin = pressed.device.build, pressed.skin
    calibrations, used = calibrate(pressed, get_nominal(build, skin, pressed))
    calibrations[EXACT] = build.exact_calibration(skin)
    rows = press_for_test(pressed, calibrations, command.tests)
    errors = {
        name: compare_with_expected(rows[name], calibration, skin)
        for name, calibration in calibrations.items()
    }
    return GainResult(
        kind=kind,
        seed=seed,
        error={n: average_patches(rows[n], e) for n, e in errors.items()},
        accuracy=measure_accuracy(command, kind, seed, calibrations),
        inside={
            n: find_inside(rows[n], errors[n], calibrations[n])
            for n in (PRESSES, GAUGE)
        },
        used=used,
        deviation={
            n: float(np.mean(deviation))
            for n, c in calibrations.items()
            if (deviation := c.gain_deviation) is not None
        },
    )


def format_mean(values: list[float]) -> str:
    """Format a mean with its interval over builds, without those that felt nothing."""
    values = [value for value in values if np.isfinite(value)]
    if not values:
        return ""
    low, high = bootstrap_mean(np.array(values), np.arange(len(values)), seed=0)
    return f"{np.mean(values):.3f} ({low:.3f} to {high:.3f})"


def print_table(results: list[GainResult]) -> None:
    """Print one row for each kind and calibration."""
    names = (
        "builds",
        "calibration",
        "presses used",
        "error of ln scale",
        "accuracy",
        "in 95 %",
    )
    print(format_head(names))
    for kind in dict.fromkeys(result.kind for result in results):
        own = [result for result in results if result.kind == kind]
        for name in CALIBRATIONS:
            inside = [flag for result in own for flag in result.inside.get(name, [])]
            accuracy = [r.accuracy[name] for r in own if name in r.accuracy]
            cells = (
                f"{len(own)} {kind}",
                name,
                f"{np.mean([result.used for result in own]):.0%}",
                format_mean([result.error[name] for result in own]),
                format_mean(accuracy) if accuracy else "",
                f"{np.mean(inside):.0%} of {len(inside)}" if inside else "",
            )
            print(format_row(cells))


def main(args: list[str] | None = None) -> None:
    """Measure all builds, then print the table."""
    command = tyro.cli(Command, args=args)
    started = time.monotonic()
    results = []
    for number in range(command.builds):
        for kind in command.kinds:
            result = run_build(command, kind, command.seed + number)
            results.append(result)
            if command.json is not None:
                with command.json.open("a") as file:
                    file.write(json.dumps(asdict(result)) + "\n")
    print_table(results)
    print(f"\n{time.monotonic() - started:.0f} s")
