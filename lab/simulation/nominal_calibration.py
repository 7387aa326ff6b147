"""Write the nominal calibration of the preset skins, from the simulator's constants.

    python -m lab.simulation.nominal_calibration

Devices without a calibration file use it. Its one gain is that of every taxel.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

import eskin.skin
from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import build_nominal_sensor
from eskin.skin import build_grid_skin


@dataclass(frozen=True)
class Command:
    """Write the file."""

    out: Path = Path(eskin.skin.__file__).parent / "nominal_calibration.json"
    """Path of the file."""


def nominal_bytes() -> bytes:
    """Return the nominal calibration of a skin of one taxel, as text."""
    skin = build_grid_skin(1, 1)
    build = build_nominal_sensor(skin, load_constants())
    return build.calibration(skin).to_bytes() + b"\n"


def main() -> None:
    """Write the file."""
    tyro.cli(Command).out.write_bytes(nominal_bytes())


if __name__ == "__main__":
    main()
