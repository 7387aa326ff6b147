"""Recognise the touches of a simulated person, one reading at a time.

    python examples/02_simulated_touches.py

The person is in no training set, and touches a UR5 in its skin for a simulated minute.
With hardware, replace `sim:ur5` by `serial:/dev/ttyACM0` and name the skin.
"""

import math
from dataclasses import dataclass

import tyro

import eskin


@dataclass(frozen=True)
class Example:
    """Recognise the touches of a simulated person."""

    seconds: float = 60.0
    """Simulated time [s]."""

    seed: int = 1
    """Seed of the person."""


def main(example: Example) -> None:
    """Print each gesture as it is recognised."""
    # Without a pace, a simulation runs in real time.
    config = eskin.SourceConfig(pace=math.inf, seed=example.seed)
    with eskin.open_source("sim:ur5", config=config) as source:
        skin = source.info.skin
        robot = source.info.robot_name
        calibration = source.info.calibration
        recognizer = eskin.Recognizer.load("ur5", skin, robot, calibration)
        start = None
        for _ in range(round(example.seconds * source.info.rate)):
            scan = source.read()
            if scan is None:
                break
            start = scan.stamp if start is None else start
            for found in recognizer.push(scan):
                x, y, z = found.p_world
                print(
                    f"{(found.stamp - start) * 1e-9:5.1f} s  {found.gesture:10} "
                    f"{found.confidence:4.0%}  {found.link} at "
                    f"({x:.2f}, {y:.2f}, {z:.2f}) m, {found.peak_force:.1f} N"
                )


if __name__ == "__main__":
    main(tyro.cli(Example))
