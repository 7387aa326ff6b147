"""Rows of the tables: what is wrong with the sensor, build by build."""

from collections.abc import Mapping
from typing import get_args

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.sensor import (
    FAMILIES,
    FLAWS,
    SensorBuild,
    draw_build,
    draw_flawed_build,
)
from eskin.sim.sensor.build import BuildKind
from eskin.sim.sensor.flaws import Family, FlawLevel
from eskin.skin import Skin

INTACT, ALL = "none", "all typical"
LEVELS: tuple[FlawLevel, ...] = get_args(FlawLevel)
FLAWED: dict[str, Mapping[str, FlawLevel]] = {
    INTACT: {},
    ALL: dict.fromkeys(FLAWS, "typical"),
    **{f"{flaw} {level}": {flaw: level} for flaw in FLAWS for level in LEVELS},
}
"""Flaws of the builds of a row; their families take turns."""
KINDS: tuple[BuildKind, ...] = ("fresh", "shifted", *FAMILIES)
"""Rows whose builds have all flaws, drawn from the laws of a kind."""
ROWS = (*FLAWED, *KINDS)
"""Names of all rows."""
REFERENCES = {
    **dict.fromkeys(FLAWED, INTACT),
    **dict.fromkeys(KINDS, INTACT),
    "fresh": "fresh",
    "shifted": "fresh",
}
"""Row that each row is compared to."""


def find_family(number: int) -> Family:
    """Return the family of a build of a row whose families take turns."""
    return FAMILIES[number % len(FAMILIES)]


def draw_row_build(
    row: str, number: int, skin: Skin, constants: Constants, seed: int
) -> SensorBuild:
    """Draw a build of a row.

    Args:
        row: one of `ROWS`.
        number: number of the build, by which families take turns.
        skin: skin of the taxels.
        constants: constants of the simulation.
        seed: seed of the build.
    """
    rng = np.random.default_rng((seed, 25))
    name = f"flaws-b{number}"
    if row in FLAWED:
        family = find_family(number)
        return draw_flawed_build(name, family, FLAWED[row], skin, constants, rng)
    kind = KINDS[KINDS.index(row)]
    return draw_build(name, kind, skin, constants, rng)
