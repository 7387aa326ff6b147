"""This module builds readings of a moving ur5 arm that is touched, in memory."""

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Int

from eskin.skin import MountedSkin, Patch, Plane, Skin, TaxelGrid, build_skin, load_skin
from eskin.touch import Reading
from eskin.units import NS_PER_S

PANEL = (32, 64)
PITCH = 0.008
"""Pitch of the panels' taxels [m], as on the ur5."""

TOUCHED_S = 1.5
LIFTED_S = 0.6
"""Duration of contact, then of no contact, so that each touch is closed [s]."""

NOISE_KPA = 0.1
"""Standard deviation of untouched taxels [kPa], well below the contact threshold."""

PATTERN_COUNT = 75
"""Number of different patterns of pressure."""


def large_skin(taxels: int) -> Skin:
    """Build the ur5 skin with more taxels on panels on the wall behind it.

    The panels have 32 x 64 taxels, the last one fewer, and lie two metres from the arm,
    so that a touch of the arm is the same on all of these skins.

    Raises:
        ValueError: if there are fewer taxels than the ur5 alone has.
    """
    arm = load_skin("ur5")
    more = taxels - arm.count
    if more < 0:
        raise ValueError(
            f"--taxels is {taxels}; allowed are {arm.count}, which is the ur5 skin, "
            "and above"
        )
    if not more:
        return arm
    rows, columns = PANEL
    laid = []
    for number, start in enumerate(range(0, more, rows * columns)):
        present = np.arange(rows * columns) < more - start
        grid = TaxelGrid(rows, columns, PITCH, PITCH, present=present.reshape(PANEL))
        T = np.eye(4)
        T[:3, 3] = -2.0, 0.6 * (number % 16), 0.3 * (number // 16)
        address = len(arm.patches) + number + 1
        patch = Patch(f"panel_{number + 1}", "base_link", address, rows, columns)
        laid.append((patch, grid, Plane(T)))
    return concatenate_skins(arm, build_skin("panels", laid))


def concatenate_skins(one: Skin, other: Skin) -> Skin:
    """Concatenate the patches of two skins."""
    names = ("rows", "columns", "positions", "normals", "areas", "tangents")
    both: dict[str, Any] = {
        n: np.concatenate([getattr(one, n), getattr(other, n)]) for n in names
    }
    patch_index = [one.patch_index, other.patch_index + len(one.patches)]
    return Skin(
        name=f"{one.name} and {other.name}",
        patches=one.patches + other.patches,
        patch_index=np.concatenate(patch_index),
        **both,
    )


def find_forearm_taxels(skin: Skin, active: int) -> Int[np.ndarray, "active"]:
    """Find the taxels nearest to the middle of the ur5's front forearm."""
    return find_central_taxels(skin, "forearm_front", active)


def find_central_taxels(
    skin: Skin, patch: str, active: int
) -> Int[np.ndarray, "active"]:
    """Find the taxels of a patch that are nearest to its middle."""
    taxels = skin.find_taxels(patch)
    if not 1 <= active <= len(taxels):
        raise ValueError(
            f"--active is {active}; allowed are 1 to {len(taxels)}, the taxels of "
            f"{patch}"
        )
    apart = skin.positions[taxels] - skin.positions[taxels].mean(axis=0)
    return taxels[np.argsort(np.linalg.norm(apart, axis=1), kind="stable")[:active]]


def find_forearm_band(skin: Skin, active: int) -> Int[np.ndarray, "active"]:
    """Find a band of taxels around the ur5's forearm, as a grabbing hand covers."""
    taxels = np.concatenate(
        [skin.find_taxels(f"forearm_{s}") for s in ("front", "back")]
    )
    height = skin.positions[taxels, 2]
    return taxels[np.argsort(np.abs(height - height.mean()), kind="stable")[:active]]


@dataclass(frozen=True, eq=False)
class SceneReading:
    """Holds a reading of a scene and whether the scene is touched."""

    reading: Reading
    """Calibrated reading."""
    touched: bool
    """Whether the scene's taxels are pressed; False for an idle scene."""


@final
class BenchScene:
    """Yields readings of touches that begin and end while all joints move."""

    def __init__(
        self,
        mounted: MountedSkin,
        active: Int[np.ndarray, "active"],
        rate: float = 50.0,
        seed: int = 0,
    ) -> None:
        """Start with the first touch.

        No `active` taxels make an idle skin; `rate` is that of the readings [1/s].
        """
        rng = np.random.default_rng(seed)
        self.active = active
        self.rate = rate
        self.touched = round(TOUCHED_S * rate)
        self.lifted = round(LIFTED_S * rate)
        self.joints = len(mounted.robot.joint_names)
        self.valid = np.ones(mounted.skin.count, dtype=bool)
        noise = rng.normal(0.0, NOISE_KPA, (PATTERN_COUNT, mounted.skin.count))
        self.idle = np.clip(noise, 0.0, 3 * NOISE_KPA).astype(np.float32)
        shape = rng.uniform(10.0, 30.0, len(active))
        swell = 1.0 + 0.3 * np.sin(np.linspace(0.0, 2 * np.pi, PATTERN_COUNT))
        self.pressed = self.idle.copy()
        self.pressed[:, active] = swell[:, None] * shape
        self.number = 0

    def next_readings(self, count: int) -> list[SceneReading]:
        """Return the next readings."""
        return [self.next_reading() for _ in range(count)]

    def next_reading(self) -> SceneReading:
        """Return the next reading."""
        seconds = self.number / self.rate
        phase = self.number % (self.touched + self.lifted)
        touched = bool(len(self.active)) and phase < self.touched
        pressure = self.pressed if touched else self.idle
        self.number += 1
        reading = Reading(
            round(seconds * NS_PER_S) + NS_PER_S,
            pressure[phase % PATTERN_COUNT],
            self.valid,
            0.3 * np.sin(seconds * (0.5 + 0.1 * np.arange(self.joints))),
        )
        return SceneReading(reading, touched)
