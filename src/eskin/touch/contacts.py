"""Contacts: connected active taxels at one instant."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import ReadingError
from eskin.skin.mount import MountedSkin
from eskin.touch.adjacency import Adjacency
from eskin.touch.contact_kernels import activate, connect, place, summarise
from eskin.touch.poses import LivePoses
from eskin.touch.reading import Reading, check_order

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Contact:
    """Connected active taxels at one instant."""

    taxels: Int[np.ndarray, "active"]
    """Its taxels, ordered by patch, row and column."""

    force: float
    """Sum of pressure times area [N]."""

    area: float
    """Sum of the taxels' areas [m2]."""

    peak: float
    """Greatest pressure [kPa]."""

    p_world: Float[np.ndarray, "3"]
    """Centre, weighted by force [m]."""

    n_world: Float[np.ndarray, "3"]
    """Mean outward normal, weighted by force; unit, or zero where normals cancel."""

    p_link: Float[np.ndarray, "3"]
    """The centre in the frame of `link` [m]."""

    link: str
    """Link of the most loaded taxel."""

    patch: str
    """Patch of the most loaded taxel."""


@dataclass(frozen=True)
class ContactConfig:
    """When a taxel is active and when two active taxels belong together."""

    on: float = 0.7
    """Pressure from which a taxel becomes active [kPa]."""

    off: float = 0.5
    """Pressure from which an active taxel stays active [kPa]."""

    on_share: float = 0.15
    """Part of its recent peak that a released taxel must exceed to be active again."""

    off_share: float = 0.1
    """Part of its recent peak that an active taxel must exceed to stay active."""

    fade_seconds: float = 5.0
    """Time in which half of the recent peak is forgotten [s]."""

    hold_seconds: float = 0.1
    """How long a taxel not received is remembered as active [s]."""

    reach: float = 1.6
    """How far active taxels connect, in units of the local spacing."""

    least_reach: float = 0.018
    """How far they connect anyway [m]: over the seams between patches."""

    def raised_to(self, floor: float) -> "ContactConfig":
        """The same, its thresholds in proportion, `on` at least `floor` [kPa]."""
        factor = max(1.0, floor / self.on)
        return replace(self, on=self.on * factor, off=self.off * factor)


@final
class ContactFinder:
    """Finds the contacts of each reading; stateful, for the thresholds' hysteresis.

    Taxels connect by distance in space: on one link that never changes, between links
    it follows the pose. Contacts come in the order of their first taxel by patch, row
    and column, so that numbering the taxels otherwise changes nothing.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: ContactConfig | None = None,
        poses: LivePoses | None = None,
    ) -> None:
        """Start with no taxel active."""
        self.mounted = mounted
        self.config = config or ContactConfig()
        self.poses = poses or LivePoses(mounted)
        skin = mounted.skin
        self.adjacency = Adjacency.of(
            skin, self.config.reach, self.config.least_reach if skin.calibrated else 0.0
        )
        self.rank = np.empty(skin.count, np.int64)
        keys = (skin.columns, skin.rows, skin.patch_index)
        self.rank[np.lexsort(keys)] = np.arange(skin.count)
        self.links = mounted.skin_link_index.astype(np.int64)
        # When each taxel was active, for its peak; and the same until it is released.
        self.active_at = np.full(skin.count, -np.inf)
        self.held_at = np.full(skin.count, -np.inf)
        self.peak = np.zeros(skin.count)
        self.slot = np.full(skin.count, -1, np.int64)
        self.first: int | None = None
        self.last: int | None = None

    def find(self, reading: Reading) -> list[Contact]:
        """The contacts of the next reading."""
        if len(reading.pressure) != self.mounted.skin.count:
            raise ReadingError(
                f"reading has {len(reading.pressure)} taxels, skin "
                f"'{self.mounted.skin.name}' has {self.mounted.skin.count}; allowed is "
                "one pressure a taxel; load the skin that the data came from"
            )
        self.poses.check(reading.q)
        active = self.active(reading)
        if len(active) == 0:
            return []
        skin, adjacency = self.mounted.skin, self.adjacency
        T_world_link = self.poses.at(reading.q)
        p_world = place(active, skin.positions, self.links, T_world_link, 1.0)
        n_world = place(active, skin.normals, self.links, T_world_link, 0.0)
        labels = connect(
            active,
            p_world,
            adjacency.link_index,
            adjacency.reach,
            adjacency.starts,
            adjacency.neighbours,
            self.slot,
        )
        sums, loaded = summarise(
            active,
            labels,
            int(labels.max()) + 1,
            reading.pressure,
            skin.areas,
            p_world,
            n_world,
        )
        return [
            self.contact(active[labels == n], sums[n], int(taxel), reading)
            for n, taxel in enumerate(loaded)
        ]

    def active(self, reading: Reading) -> Int[np.ndarray, "active"]:
        """The active taxels of the next reading, ordered by patch, row and column."""
        check_order(self.last, reading.stamp)
        if self.first is None:
            self.first = reading.stamp
        now = (reading.stamp - self.first) / NANOSECONDS
        before = now if self.last is None else (self.last - self.first) / NANOSECONDS
        self.last = reading.stamp
        config = self.config
        candidates = np.flatnonzero(reading.pressure >= min(config.off, config.on))
        if len(candidates) == 0:
            self.held_at[reading.valid] = -np.inf
            return candidates
        active = activate(
            candidates,
            reading.pressure,
            reading.valid,
            now,
            min(before, now - config.hold_seconds),
            (
                config.on,
                config.off,
                config.on_share,
                config.off_share,
                config.fade_seconds,
            ),
            self.held_at,
            self.active_at,
            self.peak,
        )
        self.held_at[reading.valid] = -np.inf
        self.held_at[active] = now
        return active[np.argsort(self.rank[active], kind="stable")]

    def contact(
        self,
        taxels: Int[np.ndarray, "active"],
        sums: Float[np.ndarray, "9"],
        loaded: int,
        reading: Reading,
    ) -> Contact:
        """Put one contact together."""
        skin = self.mounted.skin
        patch = skin.patches[int(skin.patch_index[loaded])]
        return Contact(
            taxels=taxels,
            force=float(sums[0]),
            area=float(sums[1]),
            peak=float(sums[2]),
            p_world=sums[3:6],
            n_world=sums[6:9],
            p_link=self.poses.to_link(reading.q, patch.link, sums[3:6]),
            link=patch.link,
            patch=patch.id,
        )
