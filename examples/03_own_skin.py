"""Lay a skin on a robot of your own, check it, and let it be touched.

    python examples/03_own_skin.py

The robot is a post of 8 cm radius, the skin a sleeve of 320 taxels round it. Weights
that were trained on a UR5 recognise touches on it, since they know forces and metres.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import eskin
from eskin.skin import Patch, TaxelGrid, Tube, build_skin, check_skin, save_skin

URDF = """
<robot name="post">
  <link name="post">
    <collision><geometry><cylinder radius="0.08" length="0.6"/></geometry></collision>
  </link>
</robot>
"""


@dataclass(frozen=True)
class Example:
    """Lay a skin on a robot of your own."""

    out: Path = Path("post")
    """Folder for the robot and its skin."""

    seconds: float = 30.0
    """Simulated time for which a person touches it [s]."""


def main(example: Example) -> None:
    """Write robot and skin, check them, and recognise simulated touches."""
    example.out.mkdir(parents=True, exist_ok=True)
    urdf = example.out / "post.urdf"
    folder = example.out / "skin"
    urdf.write_text(URDF)
    grid = TaxelGrid(rows=16, columns=20, row_pitch=0.025, column_pitch=0.025)
    patch = Patch("sleeve", link="post", address=1, rows=16, columns=20)
    skin = build_skin("post", [(patch, grid, Tube(0.08, np.eye(4)))])
    problems = check_skin(skin, eskin.load_robot(urdf))
    print(f"{skin.count} taxels, problems: {problems or 'none'}")
    save_skin(skin, folder)

    config = eskin.SourceConfig(robot=urdf, pace=math.inf)
    with eskin.open_source(f"sim:{folder}", config=config) as source:
        recognizer = eskin.Recognizer.load("ur5", skin, urdf, source.info.calibration)
        for _ in range(round(example.seconds * source.info.rate)):
            for found in recognizer.push(source.read()):
                print(f"{found.gesture:10} {found.confidence:4.0%} on {found.patch}")


if __name__ == "__main__":
    main(tyro.cli(Example))
