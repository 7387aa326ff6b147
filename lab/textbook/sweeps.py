"""Sweep one factor at a time, with the others drawn from the middle of their ranges.

Sweeps are even in the logarithm of the factor, and the middle half is that of the
logarithm: forces of 2.1 to 9.5 N of 1 to 20 N. Every touch is drawn independently of
the others.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import get_args

import numpy as np

from eskin.live import Model, load_model
from lab.textbook.clips import answer, build_clip
from lab.textbook.draws import TOUCHES, TouchSetting, draw_touch, name_true_class
from lab.textbook.skins import SurfaceName, build_site

WANTED = 0.9
"""Required accuracy in the middle half."""
EVERY = tuple(TOUCHES)
SURFACE = "surface"
SURFACES: tuple[SurfaceName, ...] = get_args(SurfaceName)
COMMON: tuple[SurfaceName, ...] = ("flat", "round")
"""Surfaces that are touched while another factor is swept."""


@dataclass(frozen=True)
class Factor:
    """Describes a factor of a setting, its range, and the touches that it affects."""

    name: str
    """Name of the field of `TouchSetting`."""
    low: float
    high: float
    scale: float
    """Unit of the range in units of the setting."""
    unit: str
    touches: tuple[str, ...]
    """Touches that are swept."""

    def values(self, count: int) -> list[float]:
        """Return values over the range, in its own unit."""
        return np.geomspace(self.low, self.high, count).tolist()

    @property
    def middle(self) -> tuple[float, float]:
        """Return the ends of the middle half of the range, in its own unit."""
        quarter = sqrt(sqrt(self.high / self.low))
        return self.low * quarter, self.high / quarter


WHERE_AREA = tuple(name for name in EVERY if name != "grab")
WHERE_RAMP = ("poke", "double_pat", "stroke", "grab", "one pat")
FACTORS = (
    Factor("force", 1.0, 20.0, 1.0, "N", EVERY),
    Factor("area", 0.5, 4.0, 1e-4, "cm2", WHERE_AREA),
    Factor("duration", 0.15, 0.8, 1.0, "s", ("poke",)),
    Factor("press", 1.0, 1.8, 1.0, "s", ("press",)),
    Factor("ramp", 20.0, 150.0, 1e-3, "ms", WHERE_RAMP),
    Factor("gap", 0.15, 0.45, 1.0, "s", ("double_pat",)),
    Factor("speed", 5.0, 40.0, 1e-2, "cm/s", ("stroke",)),
    Factor("pitch", 4.0, 12.0, 1e-3, "mm", EVERY),
    Factor("rate", 25.0, 200.0, 1.0, "Hz", EVERY),
)
"""All swept factors except the surface."""
SWEPT = (*(factor.name for factor in FACTORS), SURFACE)
"""Names of all swept factors."""
PITCHES = 5
"""Number of pitches in the middle half, so that skins are built only once."""


@dataclass(frozen=True)
class Point:
    """Holds the answers at one value of a sweep."""

    factor: str
    value: float | str
    """Value in the unit of the factor, or the name of a surface."""
    touch: str
    """Name of the touch, one of `TOUCHES`."""
    inside: bool
    """Whether the value lies in the middle half; every surface does."""
    forced: dict[str, int]
    """Number of forced choices of each class."""
    detected: dict[str, int]
    """Number of clips with each gesture as first live detection."""

    @property
    def count(self) -> int:
        """Return the number of clips."""
        return sum(self.forced.values())

    @property
    def right(self) -> int:
        """Return the number of correct forced choices."""
        return self.forced.get(name_true_class(self.touch), 0)

    @property
    def right_said(self) -> int:
        """Return the number of clips whose first live detection is right, or none."""
        return self.detected.get(name_true_class(self.touch), 0)


def run(
    model: Model | str | Path,
    draws: int = 16,
    values: int = 9,
    seed: int = 0,
    factors: Sequence[str] = (),
    middle_only: bool = False,
) -> Iterator[Point]:
    """Sweep factors, one after the other.

    Args:
        model: model, or its name or path.
        draws: number of touches of each name at each value.
        values: number of values of each factor.
        seed: random seed.
        factors: names of the factors to sweep; all if empty.
        middle_only: whether values outside the middle half are left out; those inside
            give the same points.

    Raises:
        ValueError: there is no such factor.
    """
    strange = sorted(set(factors) - set(SWEPT))
    if strange:
        raise ValueError(
            f"--factors names {', '.join(strange)}; allowed are {', '.join(SWEPT)}; "
            "correct the name"
        )
    loaded = model if isinstance(model, Model) else load_model(model)
    asked = factors or SWEPT
    for factor in FACTORS:
        if factor.name in asked:
            yield from sweep(loaded, factor, draws, values, seed, middle_only)
    if SURFACE in asked:
        for touch in EVERY:
            for number, surface in enumerate(SURFACES):
                if (surface, touch) != ("flat", "grab"):
                    key = seed, SWEPT.index(SURFACE), EVERY.index(touch), number
                    yield point(loaded, SURFACE, surface, touch, True, draws, key)


def sweep(
    model: Model,
    factor: Factor,
    draws: int,
    values: int,
    seed: int,
    middle_only: bool = False,
) -> Iterator[Point]:
    """Sweep one factor for every touch that it affects."""
    low, high = (factor.middle[0] * (1 - 1e-9), factor.middle[1] * (1 + 1e-9))
    for touch in factor.touches:
        for number, value in enumerate(factor.values(values)):
            inside = low <= value <= high
            if middle_only and not inside:
                continue
            key = seed, SWEPT.index(factor.name), EVERY.index(touch), number
            yield point(model, factor.name, value, touch, inside, draws, key)


def point(
    model: Model,
    factor: str,
    value: float | str,
    touch: str,
    inside: bool,
    draws: int,
    key: tuple[int, ...],
) -> Point:
    """Recognise touches at one value of a sweep.

    Args:
        model: model to test.
        factor: name of the swept factor.
        value: value in the unit of the factor, or the name of a surface.
        touch: name of the touch, one of `TOUCHES`.
        inside: whether the value lies in the middle half.
        draws: number of touches.
        key: random seed, together with the number of the draw.
    """
    forced, detected = Counter[str](), Counter[str]()
    for draw in range(draws):
        of_setting, of_touch, of_noise = np.random.default_rng((*key, draw)).spawn(3)
        setting = draw_setting(touch, of_setting, {factor: value})
        site = build_site(setting.surface, setting.pitch)
        made = draw_touch(touch, setting, site, of_touch)
        found = answer(model, build_clip(made, site, setting.rate, of_noise))
        forced[found.forced] += 1
        detected[found.detected] += 1
    return Point(factor, value, touch, inside, dict(forced), dict(detected))


def draw_setting(
    touch: str, rng: np.random.Generator, given: dict[str, float | str]
) -> TouchSetting:
    """Draw factors from the middle halves of their ranges.

    Args:
        touch: name of the touch; a grab is only made on a round surface.
        rng: random generator; the number of draws does not depend on `given`.
        given: factors that are not drawn, in their own units.
    """
    drawn: dict[str, float | str] = {}
    for factor in FACTORS:
        low, high = factor.middle
        part = rng.random()
        if factor.name == "pitch":
            part = int(part * PITCHES) / (PITCHES - 1)
        drawn[factor.name] = low * (high / low) ** part
    surface = COMMON[rng.integers(2)]
    drawn[SURFACE] = "round" if touch == "grab" else surface
    drawn |= given
    scaled = {one.name: float(drawn[one.name]) * one.scale for one in FACTORS}
    return TouchSetting(**scaled, surface=drawn[SURFACE])  # type: ignore[arg-type]
