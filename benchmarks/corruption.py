"""Corruptions."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal, final, get_args

import numpy as np

from eskin.learn.recording_transforms import (
    RecordingTransform,
    estimate_rest_counts,
    replace_counts,
)
from eskin.model import check_limits
from eskin.recording import Recording
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.transforms import exp_so3
from eskin.units import NS_PER_S

LOOKED_AT = 50
"""Scans whose median distance is taken for the period."""
NEAR = 0.02
"""How far a ratio of rates may be from a whole number, for clocks are not the same."""
HOLE = 1.5
"""Scans farther apart than so many periods are no neighbours."""


def resample_scans(recording: Recording, rate: float) -> Iterator[Scan]:
    """The scans at another rate, which is a multiple of theirs, or a whole part of it.

    Fewer are every so many-th of those that came. More are interpolate_scans linearly, in
    counts that are rounded to whole ones and in joint positions: nothing is known that
    was not known before. After the last scan before a hole its counts are held.

    Args:
        recording: to read.
        rate: wanted [Hz].

    Raises:
        ValueError: neither rate is a multiple of the other.
    """
    stamps = [scan.stamp for scan in islice(recording.scans(), LOOKED_AT)]
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else NS_PER_S
    ratio = rate * period / NS_PER_S
    times = max(ratio, 1 / ratio)
    if abs(times - round(times)) > NEAR * times:
        raise ValueError(
            f"rate is {rate:g} Hz of scans that came at {NS_PER_S / period:.1f} Hz; "
            "allowed are multiples and whole parts of that; take one of them"
        )
    if ratio < 1:
        return islice(recording.scans(), None, None, round(times))
    return interpolate_scans(recording.scans(), round(times), round(period))


def interpolate_scans(scans: Iterator[Scan], times: int, period: int) -> Iterator[Scan]:
    """So many times as many scans.

    Args:
        scans: that came.
        times: how many are wanted of each.
        period: of those that came [ns].
    """
    here: Scan | None = None
    for following in scans:
        if here is not None:
            near = following.stamp - here.stamp <= HOLE * period
            yield from filled(here, following if near else held(here, period), times)
        here = following
    if here is not None:
        yield from filled(here, held(here, period), times)


def held(scan: Scan, period: int) -> Scan:
    """The same a period [ns] later."""
    return replace(scan, stamp=scan.stamp + period)


def filled(one: Scan, other: Scan, times: int) -> Iterator[Scan]:
    """The first of two scans, and those on the way to the second."""
    yield one
    for step in range(1, times):
        share = step / times
        counts = (1 - share) * one.counts + share * other.counts
        shear = one.shear
        if one.shear is not None and other.shear is not None:
            shear = (1 - share) * one.shear + share * other.shear
            shear = np.rint(shear).astype(one.shear.dtype)
        yield Scan(
            stamp=one.stamp + (other.stamp - one.stamp) * step // times,
            counts=np.rint(counts).astype(one.counts.dtype),
            received=one.received & other.received,
            q=(1 - share) * one.q + share * other.q,
            shear=shear,
        )


Kind = Literal[
    "dead", "patches", "noise", "drift", "lost", "rate", "pose-mm", "pose-deg"
]
KINDS: tuple[Kind, ...] = get_args(Kind)
MOST: Mapping[Kind, float] = {
    "dead": 1.0,
    "noise": 1.0,
    "lost": 1.0,
    "pose-deg": 180.0,
}
"""Largest amounts, where there are any."""

DRIFT_START = 1.5
"""Time for which drift waits, so that taxels are tared before it begins [s]."""
TURN = 2.0
"""Time after which drift goes back, and forth again [s]."""
PAUSE = 0.5
"""No drift while nothing is heard for longer than this, as between clips [s]."""
MILLIMETRE = 1e-3


@final
@dataclass(frozen=True)
class Corruption(RecordingTransform):
    """One kind of harm; the same numbers harm a recording the same way for everyone.

    More of a kind is more of the same: who is dead at 5 % is dead at 10 %. Shear stays
    as it is, but that it comes at another rate.
    """

    kind: Kind
    """What is wrong; every amount of 0 is as recorded.

    `dead`: share of the taxels, drawn among all, that show their rest.
    `patches`: how many patches, drawn among all, touched or not, are never received.
    `noise`: deviation of white noise, as a share of full scale.
    `drift`: speed at which the rest of every taxel moves, up or down [kPa/s]; it goes
    back after `TURN`, and never jumps.
    `lost`: share of the scans, each drawn for itself, that do not come.
    `rate`: of the scans [Hz], left out or interpolate_scans.
    `pose-mm`: how far the taxels of each link are believed to be from where they are
    [mm], each link in a direction of its own.
    `pose-deg`: how far those of each link are believed to be turned about their middle
    [degrees], each link about an axis of its own.
    """

    amount: float
    """How much of it."""

    seed: int = 0
    """Decides all draws, with the start of the recording."""

    def __post_init__(self) -> None:
        """Refuse amounts that mean nothing."""
        check_limits(self, {"amount": (0.0, MOST.get(self.kind, np.inf))})
        if self.kind == "patches" and self.amount % 1:
            raise ValueError(
                f"amount of patches is {self.amount}; allowed are whole numbers; "
                "correct it"
            )

    @property
    def name(self) -> str:
        """Kind and amount."""
        return f"{self.kind} {self.amount:g}"

    @property
    def moves_taxels(self) -> bool:
        """Whether it is the places of taxels that are wrong, and no scan."""
        return self.kind in ("pose-mm", "pose-deg")

    def transform_scans(self, recording: Recording) -> Iterator[Scan]:
        """The scans that would have come."""
        if self.moves_taxels:
            return recording.scans()
        return CORRUPTIONS[self.kind](recording, self.amount, self.rng(recording.start))

    def transform_skin(self, skin: Skin, start: int) -> Skin:
        """Where the taxels are believed to be.

        Args:
            skin: where they are.
            start: stamp of the recording's first scan [ns since the epoch].
        """
        if not self.moves_taxels:
            return skin
        rng = self.rng(start)
        links = np.array(skin.link_names)[skin.patch_index]
        p, normals, tangents = map(
            np.copy, (skin.positions, skin.normals, skin.tangents)
        )
        for link in dict.fromkeys(skin.link_names):
            members = links == link
            way = rng.standard_normal(3)
            way *= self.amount / np.linalg.norm(way)
            if self.kind == "pose-mm":
                p[members] += MILLIMETRE * way
                continue
            rotation = exp_so3(np.radians(way))
            apart = p[members] - p[members].mean(axis=0)
            p[members] += apart @ (rotation - np.eye(3)).T
            normals[members] = normals[members] @ rotation.T
            tangents[members] = tangents[members] @ rotation.T
        return replace(skin, positions=p, normals=normals, tangents=tangents)

    def rng(self, start: int) -> np.random.Generator:
        """What decides the draws of a recording."""
        return np.random.default_rng([start, self.seed])


def with_dead(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Some taxels show their rest."""
    rest, taxels = np.rint(estimate_rest_counts(recording)), recording.skin.count
    dead = np.zeros(taxels, dtype=bool)
    dead[rng.permutation(taxels)[: round(share * taxels)]] = True
    for scan in recording.scans():
        counts = np.where(dead, rest, scan.counts)
        yield replace_counts(scan, counts, recording.calibration.full_scale)


def without_patches(
    recording: Recording, number: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Some patches are never received."""
    patches = len(recording.skin.patches)
    if number > patches:
        raise ValueError(
            f"{number:g} patches are to be missing of {patches}; allowed are as many "
            "as there are; take fewer"
        )
    gone = np.isin(recording.skin.patch_index, rng.permutation(patches)[: int(number)])
    for scan in recording.scans():
        yield replace(scan, received=scan.received & ~gone)


def with_noise(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """White noise on every count."""
    full_scale = recording.calibration.full_scale
    for scan in recording.scans():
        noise = share * full_scale * rng.standard_normal(len(scan.counts))
        yield replace_counts(scan, scan.counts + noise, full_scale)


def with_drift(
    recording: Recording, speed: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """The rest of every taxel goes up and down, or down and up."""
    calibration = recording.calibration
    way = rng.choice([-1.0, 1.0], recording.skin.count)
    heard, last = -DRIFT_START, recording.start
    for scan in recording.scans():
        gap = (scan.stamp - last) / NS_PER_S
        heard, last = heard + (gap if gap < PAUSE else 0.0), scan.stamp
        seconds = TURN - abs(max(heard, 0.0) % (2 * TURN) - TURN)
        moved = way * calibration.compute_counts(speed * seconds)
        yield replace_counts(scan, scan.counts + moved, calibration.full_scale)


def with_losses(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Some scans do not come."""
    chosen = rng.permutation(recording.count)[: round(share * recording.count)]
    lost = frozenset(chosen.tolist())
    return (scan for n, scan in enumerate(recording.scans()) if n not in lost)


def with_rate(
    recording: Recording, rate: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Scans at another rate; nothing is drawn."""
    return resample_scans(recording, rate) if rate else recording.scans()


CORRUPTIONS: Mapping[
    Kind, Callable[[Recording, float, np.random.Generator], Iterator[Scan]]
] = {
    "dead": with_dead,
    "patches": without_patches,
    "noise": with_noise,
    "drift": with_drift,
    "lost": with_losses,
    "rate": with_rate,
}
"""The kinds of harm that scans show."""
