"""Labels of clips: what was really done, and what the paper's labeller would say."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.recording import Label, build_rough_ranges, label_automatically
from eskin.sim.clip.outcome import Clip, TrueSeries
from eskin.sim.clip.plan import ClipPlan
from eskin.sim.files.peak_kernels import largest_pressure
from eskin.touch import Calibration
from eskin.touch.calibration import build_pressure_curve
from eskin.units import NS_PER_S


def true_labels(plan: ClipPlan, clip: Clip, start: int) -> tuple[Label, ...]:
    """From first to last contact: of the touch a clip is made for, or of a stream's.

    Touches of a stream that overlap an earlier one have no label, since labels of one
    source follow each other; all are in `/eskin/truth`.
    """
    stream = plan.gesture is None
    if plan.pair is not None:
        return pair_labels(plan, clip, start)
    wanted = [truth for truth in clip.truths if stream or truth.number == 0]
    found: list[Label] = []
    for truth in sorted(wanted, key=lambda truth: (truth.onset, truth.number)):
        label = label_of(truth, plan, start)
        if label is not None and (not found or label.start >= found[-1].end):
            found.append(label)
    return tuple(found)


def pair_labels(plan: ClipPlan, clip: Clip, start: int) -> tuple[Label, ...]:
    """One label over all touches, so that either clip of a pair has it alike."""
    if not clip.truths:
        return ()
    first = min(clip.truths, key=lambda truth: truth.onset)
    whole = replace(first, end=max(truth.end for truth in clip.truths))
    label = label_of(whole, plan, start)
    return () if label is None else (label,)


def label_of(truth: TrueSeries, plan: ClipPlan, start: int) -> Label | None:
    """The label of a touch as far as its clip shows it; None where it does not."""
    onset, end = np.clip([truth.onset, truth.end], 0.0, plan.seconds)
    first, last = (start + round(float(t) * NS_PER_S) for t in (onset, end))
    return Label(first, last, truth.gesture, "true") if last > first else None


def ranges_of(plan: ClipPlan, truth: Iterable[Label], start: int) -> tuple[Label, ...]:
    """Where a person would say that something was done: the clip, or parts of a stream.

    Args:
        plan: of the clip.
        truth: its true labels.
        start: stamp of its first reading [ns since the epoch].
    """
    if plan.gesture is None:
        return build_rough_ranges(truth)
    end = start + round(plan.seconds * NS_PER_S)
    return (Label(start, end, plan.gesture, "range"),)


def rest_of(lead: Clip) -> Int[np.ndarray, "taxel"]:
    """Counts of each taxel at rest: the median of a clip without touch.

    A taxel that was never heard rests above anything it could count.
    """
    heard = np.where(lead.received, lead.counts, np.nan)
    heard[:, ~lead.received.any(axis=0)] = np.iinfo(np.int32).max
    return np.rint(np.nanmedian(heard, axis=0)).astype(np.int32)


def peaks_of(
    counts: Int[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
    rest: Int[np.ndarray, "taxel"],
    calibration: Calibration,
) -> Float[np.ndarray, "reading"]:
    """Largest pressure of each reading [kPa]."""
    bend = build_pressure_curve(calibration)
    peaks = np.zeros(len(counts))
    for gain in np.unique(calibration.gain):
        alike = calibration.gain == gain
        if alike.all():
            largest = largest_pressure(counts, received, rest, bend)
        else:
            part = counts[:, alike], received[:, alike], rest[alike]
            largest = largest_pressure(*part, bend)
        peaks = np.maximum(peaks, largest * gain)
    return peaks + np.minimum(peaks, calibration.unfelt)


def auto_labels(
    stamps: Sequence[Int[np.ndarray, "reading"]],
    peaks: Sequence[Float[np.ndarray, "reading"]],
    ranges: Iterable[Label],
) -> tuple[Label, ...]:
    """What the paper's labeller finds in a file, one threshold for all of it."""
    return label_automatically(np.concatenate(stamps), np.concatenate(peaks), ranges)
