"""Corrupt recordings as a damaged skin, wiring or robot would."""

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
from eskin.live import check_limits
from eskin.recording import Recording
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.transforms import exp_so3
from eskin.units import NS_PER_S

PERIOD_SCANS = 50
"""Number of first scans whose median interval is the period."""
RATIO_TOLERANCE = 0.02
"""Greatest deviation of a ratio of rates from a whole number, as clocks differ."""
MAX_GAP = 1.5
"""Longest interval between neighbouring scans, in periods."""


def resample_scans(recording: Recording, rate: float) -> Iterator[Scan]:
    """Return the scans at a multiple or a whole fraction of their rate.

    A lower rate keeps every n-th scan. A higher rate interpolates joint positions and
    rounded counts linearly, which adds no information. Before a gap the counts of the
    last scan are repeated.

    Args:
        recording: recording to read.
        rate: rate of the scans [Hz].

    Raises:
        ValueError: if neither rate is a multiple of the other.
    """
    stamps = [scan.stamp for scan in islice(recording.scans(), PERIOD_SCANS)]
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else NS_PER_S
    ratio = rate * period / NS_PER_S
    times = max(ratio, 1 / ratio)
    if abs(times - round(times)) > RATIO_TOLERANCE * times:
        raise ValueError(
            f"rate is {rate:g} Hz of scans that came at {NS_PER_S / period:.1f} Hz; "
            "allowed are multiples and whole parts of that; take one of them"
        )
    if ratio < 1:
        return islice(recording.scans(), None, None, round(times))
    return interpolate_scans(recording.scans(), round(times), round(period))


def interpolate_scans(scans: Iterator[Scan], times: int, period: int) -> Iterator[Scan]:
    """Yield a multiple of the scans.

    Args:
        scans: scans of the recording.
        times: number of scans per original scan.
        period: period of the original scans [ns].
    """
    here: Scan | None = None
    for following in scans:
        if here is not None:
            near = following.stamp - here.stamp <= MAX_GAP * period
            yield from fill_gap(
                here, following if near else delay_scan(here, period), times
            )
        here = following
    if here is not None:
        yield from fill_gap(here, delay_scan(here, period), times)


def delay_scan(scan: Scan, period: int) -> Scan:
    """Return the same scan, a period later [ns]."""
    return replace(scan, stamp=scan.stamp + period)


def fill_gap(one: Scan, other: Scan, times: int) -> Iterator[Scan]:
    """Yield the first of two scans, and interpolated scans up to the second."""
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
MAX_AMOUNTS: Mapping[Kind, float] = {
    "dead": 1.0,
    "noise": 1.0,
    "lost": 1.0,
    "pose-deg": 180.0,
}
"""Greatest amounts of the kinds that have a limit."""

DRIFT_START = 1.5
"""Time before drift begins, for taring [s]."""
DRIFT_SECONDS = 2.0
"""Time after which drift reverses [s]."""
PAUSE = 0.5
"""Gap between scans above which drift pauses, as between clips [s]."""
MILLIMETRE = 1e-3


@final
@dataclass(frozen=True)
class Corruption(RecordingTransform):
    """Corrupts recordings in one way, reproducibly.

    A larger amount includes a smaller one: taxels dead at 5 % are dead at 10 %. Shear
    changes only with the rate.
    """

    kind: Kind
    """Kind of corruption; an amount of 0 leaves the recording unchanged.

    `dead`: share of the taxels, drawn among all, that stay at rest.
    `patches`: number of patches, drawn among all, that are never received.
    `noise`: standard deviation of white noise, as a share of full scale.
    `drift`: speed at which the rest level of every taxel moves, up or down [kPa/s]; it
    reverses after `DRIFT_SECONDS`, and never jumps.
    `lost`: share of the scans that are lost, drawn independently.
    `rate`: rate of the scans, by omission or interpolation [Hz].
    `pose-mm`: error of the assumed position of the taxels of each link, in a random
    direction per link [mm].
    `pose-deg`: error of their assumed rotation about their centre, about a random axis
    per link [degrees].
    """

    amount: float
    """Amount of the corruption."""

    seed: int = 0
    """Random seed, together with the start of the recording."""

    def __post_init__(self) -> None:
        """Reject amounts outside their limits."""
        check_limits(self, {"amount": (0.0, MAX_AMOUNTS.get(self.kind, np.inf))})
        if self.kind == "patches" and self.amount % 1:
            raise ValueError(
                f"amount of patches is {self.amount}; allowed are whole numbers; "
                "correct it"
            )

    @property
    def name(self) -> str:
        """Return kind and amount."""
        return f"{self.kind} {self.amount:g}"

    @property
    def moves_taxels(self) -> bool:
        """Return whether the assumed places of taxels change, and scans do not."""
        return self.kind in ("pose-mm", "pose-deg")

    def transform_scans(self, recording: Recording) -> Iterator[Scan]:
        """Return the corrupted scans."""
        if self.moves_taxels:
            return recording.scans()
        return CORRUPTIONS[self.kind](
            recording, self.amount, self.build_rng(recording.start)
        )

    def transform_skin(self, skin: Skin, start: int) -> Skin:
        """Return the skin with its taxels at the assumed places.

        Args:
            skin: true skin.
            start: stamp of the recording's first scan [ns since the epoch].
        """
        if not self.moves_taxels:
            return skin
        rng = self.build_rng(start)
        links = np.array(skin.link_names)[skin.patch_index]
        p, normals, tangents = map(
            np.copy, (skin.positions, skin.normals, skin.tangents)
        )
        for link in dict.fromkeys(skin.link_names):
            members = links == link
            direction = rng.standard_normal(3)
            direction *= self.amount / np.linalg.norm(direction)
            if self.kind == "pose-mm":
                p[members] += MILLIMETRE * direction
                continue
            rotation = exp_so3(np.radians(direction))
            apart = p[members] - p[members].mean(axis=0)
            p[members] += apart @ (rotation - np.eye(3)).T
            normals[members] = normals[members] @ rotation.T
            tangents[members] = tangents[members] @ rotation.T
        return replace(skin, positions=p, normals=normals, tangents=tangents)

    def build_rng(self, start: int) -> np.random.Generator:
        """Return the random generator for a recording."""
        return np.random.default_rng([start, self.seed])


def add_dead_taxels(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Yield scans in which some taxels stay at rest."""
    rest, taxels = np.rint(estimate_rest_counts(recording)), recording.skin.count
    dead = np.zeros(taxels, dtype=bool)
    dead[rng.permutation(taxels)[: round(share * taxels)]] = True
    for scan in recording.scans():
        counts = np.where(dead, rest, scan.counts)
        yield replace_counts(scan, counts, recording.calibration.full_scale)


def drop_patches(
    recording: Recording, number: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Yield scans in which some patches are never received."""
    patches = len(recording.skin.patches)
    if number > patches:
        raise ValueError(
            f"{number:g} patches are to be missing of {patches}; allowed are as many "
            "as there are; take fewer"
        )
    gone = np.isin(recording.skin.patch_index, rng.permutation(patches)[: int(number)])
    for scan in recording.scans():
        yield replace(scan, received=scan.received & ~gone)


def add_noise(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Yield scans with white noise on every count."""
    full_scale = recording.calibration.full_scale
    for scan in recording.scans():
        noise = share * full_scale * rng.standard_normal(len(scan.counts))
        yield replace_counts(scan, scan.counts + noise, full_scale)


def add_drift(
    recording: Recording, speed: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Yield scans in which the rest level of every taxel drifts back and forth."""
    calibration = recording.calibration
    sign = rng.choice([-1.0, 1.0], recording.skin.count)
    drifted, last = -DRIFT_START, recording.start
    for scan in recording.scans():
        gap = (scan.stamp - last) / NS_PER_S
        drifted, last = drifted + (gap if gap < PAUSE else 0.0), scan.stamp
        seconds = DRIFT_SECONDS - abs(
            max(drifted, 0.0) % (2 * DRIFT_SECONDS) - DRIFT_SECONDS
        )
        moved = sign * calibration.compute_counts(speed * seconds)
        yield replace_counts(scan, scan.counts + moved, calibration.full_scale)


def drop_scans(
    recording: Recording, share: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Return the scans without some of them."""
    chosen = rng.permutation(recording.count)[: round(share * recording.count)]
    lost = frozenset(chosen.tolist())
    return (scan for n, scan in enumerate(recording.scans()) if n not in lost)


def change_rate(
    recording: Recording, rate: float, rng: np.random.Generator
) -> Iterator[Scan]:
    """Return the scans at another rate, without random draws."""
    return resample_scans(recording, rate) if rate else recording.scans()


CORRUPTIONS: Mapping[
    Kind, Callable[[Recording, float, np.random.Generator], Iterator[Scan]]
] = {
    "dead": add_dead_taxels,
    "patches": drop_patches,
    "noise": add_noise,
    "drift": add_drift,
    "lost": drop_scans,
    "rate": change_rate,
}
"""Functions of the kinds that change scans."""
