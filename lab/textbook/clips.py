"""Convert a touch to scans of an ideal sensor, and recognise it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.live import UNKNOWN, Model, Recognizer
from eskin.recording import NONE
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.textbook.draws import CLIP
from lab.textbook.skins import GAIN, NOISE, REST, Site
from lab.textbook.touches import TextbookTouch

BEFORE, AFTER = 2.0, 0.5
"""Rest before the clip, for taring, and time after it until touches have closed [s]."""
START = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class ClipAnswer:
    """Holds the answers of a recogniser to one clip."""

    forced: str
    """Most probable class of the touch of largest impulse at the last reading of the
    clip; `none` without a touch."""
    detected: str
    """First gesture that was detected live; `none` without one."""


@dataclass(frozen=True, eq=False)
class TextbookClip:
    """Holds the scans before, in and after the two seconds of a clip."""

    times: Float[np.ndarray, "scan"]
    """Times from the start of the two seconds [s]."""
    counts: Int[np.ndarray, "scan taxel"]
    """Counts of an ideal sensor."""
    site: Site
    """Site of the touch."""

    def scan(self, index: int) -> Scan:
        """Return one of the scans."""
        stamp = START + round(self.times[index] * NS_PER_S)
        received = np.ones(self.counts.shape[1], bool)
        return Scan(stamp, self.counts[index], received, self.site.q)


def build_clip(
    touch: TextbookTouch, site: Site, rate: float, rng: np.random.Generator
) -> TextbookClip:
    """Build the scans of a touch.

    Args:
        touch: touch, with times from the start of the clip.
        site: site of the touch.
        rate: rate of the scans [Hz].
        rng: random generator of the noise and of the phase of the scans.
    """
    first = -BEFORE + rng.random() / rate
    times = np.arange(first, CLIP + AFTER, 1.0 / rate)
    pressure = np.zeros((len(times), site.mounted.skin.count), np.float32)
    on = touch.share(times) > 0
    if on.any():
        pressure[on] = site.pressure(touch, times[on])
    pressure += NOISE * rng.standard_normal(pressure.shape, np.float32)
    counts = np.rint(REST + pressure / GAIN).astype(np.int32)
    return TextbookClip(times, counts, site)


def answer(model: Model, clip: TextbookClip) -> ClipAnswer:
    """Recognise a clip scan by scan, as live."""
    site = clip.site
    recognizer = Recognizer(model, site.mounted, site.calibration)
    ends = int(np.searchsorted(clip.times, CLIP))
    classes: dict[int, tuple[float, str]] = {}
    detected = []
    for index in range(len(clip.times)):
        detected += recognizer.push(clip.scan(index))
        if index < ends:
            classes |= classify_open_touches(recognizer)
    detected += recognizer.finish()
    gestures = [d.gesture for d in detected if d.gesture not in (NONE, UNKNOWN)]
    return ClipAnswer(
        forced=max(classes.values(), default=(0.0, NONE))[1],
        detected=next(iter(gestures), NONE),
    )


def classify_open_touches(recognizer: Recognizer) -> dict[int, tuple[float, str]]:
    """Return impulse [N s] and most probable class of confirmed open touches, by id."""
    state = recognizer.state
    if state is None or not state.open:
        return {}
    vocabulary = recognizer.model.card.vocabulary
    return {
        row.id: (row.impulse, vocabulary[recognizer.probabilities[row.id].argmax()])
        for row in state.rows
        if row.confirmed and not row.closed
    }
