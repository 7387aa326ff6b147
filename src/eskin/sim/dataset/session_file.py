"""This module writes the recording of one session: scans, labels and ground truth."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import GenerationError
from eskin.labelling import label_automatically
from eskin.recording import Label, Metadata, RecordingWriter, build_rough_ranges
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.index import ClipRow, build_row
from eskin.sim.dataset.plan import ClipPlan, SessionPlan
from eskin.sim.dataset.settings import GenerationSettings
from eskin.sim.scene.scene import TrueTouchSeries
from eskin.sim.sensor import FAMILIES
from eskin.touch import Calibration
from eskin.touch.pressure_kernels import linearise_counts
from eskin.units import NS_PER_S


def build_true_labels(
    plan: ClipPlan, clip: SimulatedClip, start: int
) -> tuple[Label, ...]:
    """Build labels, from first to last contact, of the main touch or all of a stream.

    Touches of a stream that overlap an earlier one have no label, since labels of one
    source must not overlap; all are in `/eskin/truth`. One label of a pair covers all
    touches, so that both of its clips agree in time.
    """
    stream = plan.gesture is None
    wanted = [truth for truth in clip.truths if stream or truth.number == 0]
    if plan.pair is not None and clip.truths:
        first = min(clip.truths, key=lambda truth: truth.onset)
        wanted = [replace(first, end=max(truth.end for truth in clip.truths))]
    found: list[Label] = []
    for truth in sorted(wanted, key=lambda truth: (truth.onset, truth.number)):
        label = build_label(truth, plan, start)
        if label is not None and (not found or label.start >= found[-1].end):
            found.append(label)
    return tuple(found)


def build_label(truth: TrueTouchSeries, plan: ClipPlan, start: int) -> Label | None:
    """Build the label of a touch, cut to its clip; None if nothing is left."""
    onset, end = np.clip([truth.onset, truth.end], 0.0, plan.seconds)
    first, last = (start + round(float(t) * NS_PER_S) for t in (onset, end))
    return Label(first, last, truth.gesture, "true") if last > first else None


def build_ranges(
    plan: ClipPlan, truth: Iterable[Label], start: int
) -> tuple[Label, ...]:
    """Build the ranges that a person would label: a clip, or parts of a stream."""
    if plan.gesture is None:
        return build_rough_ranges(truth)
    end = start + round(plan.seconds * NS_PER_S)
    return (Label(start, end, plan.gesture, "range"),)


def compute_rest_counts(lead: SimulatedClip) -> Int[np.ndarray, "taxel"]:
    """Return the median counts of each taxel in a clip without touch.

    A taxel that was never received gets the largest int32, so it shows no pressure.
    """
    received_counts = np.where(lead.received, lead.counts, np.nan)
    received_counts[:, ~lead.received.any(axis=0)] = np.iinfo(np.int32).max
    return np.rint(np.nanmedian(received_counts, axis=0)).astype(np.int32)


def compute_peak_pressures(
    counts: Int[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
    rest: Int[np.ndarray, "taxel"],
    calibration: Calibration,
) -> Float[np.ndarray, "reading"]:
    """Return the largest pressure of each reading [kPa].

    Pressure rises with the counts above rest, so only the largest of each gain are
    converted.
    """
    curve = calibration.pressure_curve
    peaks = np.zeros(len(counts))
    for gain in np.unique(calibration.gain):
        alike = np.flatnonzero(calibration.gain == gain)
        above = np.where(received[:, alike], counts[:, alike] - rest[alike], 0)
        largest = above.max(axis=1, initial=0).tolist()
        linear = [linearise_counts(float(each), curve) for each in largest]
        peaks = np.maximum(peaks, gain * np.array(linear))
    return peaks + np.minimum(peaks, calibration.unfelt)


GESTURE_SET = "paper"


def write_session(
    folder: Path,
    settings: GenerationSettings,
    session_plan: SessionPlan,
    generator: ClipGenerator,
    check_stopped: Callable[[], None] = lambda: None,
) -> tuple[ClipRow, ...]:
    """Generate the clips of a session and write its file; return their rows.

    `check_stopped` is called before each clip and raises to stop.

    Raises:
        GenerationError: a clip cannot be made; then no file is left.
    """
    path = folder / session_plan.file
    path.parent.mkdir(exist_ok=True)
    calibration = generator.calibration(session_plan.build)
    writer = RecordingWriter(
        path,
        generator.robot_name,
        generator.mounted.skin,
        calibration,
        build_metadata(settings, session_plan),
        generator.mounted.robot.joint_names,
        generator.urdf,
    )
    try:
        with writer:
            session = SessionWriter(writer, calibration, session_plan, settings)
            for number, plan in enumerate(settings.plan_clips(session_plan), -1):
                check_stopped()
                clip = generate_clip(generator, plan, number, session_plan)
                session.write_clip(number, plan, clip)
            session.finish()
    except BaseException:
        writer.part.unlink(missing_ok=True)
        raise
    return tuple(session.rows)


def build_metadata(settings: GenerationSettings, session_plan: SessionPlan) -> Metadata:
    """Build the metadata of a recording."""
    kind = session_plan.build.kind
    family = {"family": kind} if kind in FAMILIES else {}
    notes = {
        "build": session_plan.build.name,
        "build_kind": kind,
        "difficulty": f"{settings.level:g}",
        "seed": str(settings.seed),
        "simulated": "true",
        **family,
    }
    return Metadata(
        dataset=settings.set_name,
        subject=session_plan.person.name,
        session=session_plan.session.name,
        gesture_set=GESTURE_SET,
        notes=notes,
    )


def generate_clip(
    generator: ClipGenerator, plan: ClipPlan, number: int, session_plan: SessionPlan
) -> SimulatedClip:
    """Generate the clip of a plan, or raise an error that names it."""
    where = "the lead-in" if number < 0 else f"clip {number}"
    try:
        clip = generator.make(plan)
    except Exception as error:
        raise GenerationError(
            f"{where} of {session_plan.file} ({plan.gesture}) cannot be made: "
            f"{type(error).__name__}: {error}"
        ) from error
    lengths = {len(clip.counts), len(clip.received), len(clip.q)}
    lengths |= {len(truth.force) for truth in clip.truths}
    if len(lengths) != 1:
        raise GenerationError(
            f"{where} of {session_plan.file} ({plan.gesture}) has {sorted(lengths)} "
            "readings; allowed is one number"
        )
    return clip


class SessionWriter:
    """A session writer writes clips and keeps what the automatic labels need."""

    def __init__(
        self,
        writer: RecordingWriter,
        calibration: Calibration,
        session_plan: SessionPlan,
        settings: GenerationSettings,
    ) -> None:
        """Start with no clips."""
        self.writer = writer
        self.calibration = calibration
        self.session_plan = session_plan
        self.period = settings.constants.value("sensor.period")
        self.rows: list[ClipRow] = []
        self.touches = 0
        self.ranges: list[Label] = []
        self.stamps: list[np.ndarray] = []
        self.peaks: list[np.ndarray] = []
        self.rest = np.empty(0, dtype=np.int32)

    def write_clip(self, number: int, plan: ClipPlan, clip: SimulatedClip) -> None:
        """Write a clip; the first one, number -1, is the lead-in."""
        start = self.session_plan.start + round(plan.at * NS_PER_S)
        times = self.period * np.arange(len(clip.counts))
        period = self.period
        if clip.times is not None:
            times = clip.times
            period = float(np.median(np.diff(clip.times)))
        stamps = start + np.rint(times * NS_PER_S).astype(np.int64)
        self.write_scans(stamps, clip, period)
        if number < 0:
            self.rest = compute_rest_counts(clip)
            return
        truth = build_true_labels(plan, clip, start)
        for label in truth:
            self.writer.write_label(label)
        self.ranges += build_ranges(plan, truth, start)
        self.stamps.append(stamps)
        peaks = compute_peak_pressures(
            clip.counts, clip.received, self.rest, self.calibration
        )
        self.peaks.append(peaks)
        file = self.session_plan.file
        skin = self.writer.skin.name
        self.rows.append(
            build_row(file, number, start, skin, self.touches, period, plan, clip)
        )
        self.touches += len(clip.truths)

    def write_scans(
        self, stamps: Int[np.ndarray, "reading"], clip: SimulatedClip, period: float
    ) -> None:
        """Write the scans of a clip and its true touches, one second at a time."""
        readings = round(1 / period)
        for first in range(0, len(stamps), readings):
            part = slice(first, first + readings)
            self.writer.write_block(
                stamps[part], clip.counts[part], clip.received[part], clip.q[part]
            )
            for touch, truth in enumerate(clip.truths, self.touches):
                for reading in (first + np.flatnonzero(truth.force[part] > 0)).tolist():
                    record = truth.to_record(touch, reading, int(stamps[reading]))
                    self.writer.write_truth(record)

    def finish(self) -> None:
        """Write the labels of the paper's labeller, with one threshold for the file."""
        stamps = np.concatenate(self.stamps)
        peaks = np.concatenate(self.peaks)
        for label in label_automatically(stamps, peaks, self.ranges):
            self.writer.write_label(label)
