"""A matrix on a serial line, and the hand of a person who touches it.

Contact, film and sensor are those of the simulator. The electronics are those of a
small board: 25 scans a second of 8 bits, each a JSON object with its time, and a row
that is dead. What a taxel reads adds 2 % of it to every other taxel of its row, and 2 %
to every other one of its column: a crosstalk of 4 % in all.
"""

import json
import time
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import final

import numpy as np

from eskin.progress import Closing
from eskin.sim.constants import load_constants
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.interactive.hand import InteractiveHand, LinkPoint
from eskin.sim.sensor import SensorBuild, draw_flawed_build
from eskin.sim.virtual import PtyPort
from eskin.skin import Skin, load_skin
from eskin.units import NS_PER_S

PERIOD = 0.04
"""Time between two scans [s]."""
BITS = 8
"""Resolution of the converter."""
LEAK = 0.02
"""Part of each other taxel of its row, and of its column, that a taxel reads."""
DEAD_ROW = 4
"""Row that reads zero, from 0."""
SEED = 77
"""Seed of the sensor, the person and the touches."""
REACTION = 0.7
"""Time from a request until the hand touches [s]."""
GESTURES = ("knock", "circle", "none")
"""Gestures that the hand can make; `none` leans the heel of the hand on the skin."""


def build_sensor(skin: Skin) -> SensorBuild:
    """Build the sensor: a divider of 8 bits that reads what its data sheet says."""
    constants = load_constants()
    rng = np.random.default_rng(SEED)
    build = draw_flawed_build("engineer", "divider", {}, skin, constants, rng)
    electronics = build.electronics
    coarser = 2.0 ** (BITS - electronics.bits)
    noise = coarser * electronics.noise
    return replace(
        build,
        electronics=replace(
            electronics, bits=BITS, noise=noise, leak=LEAK, period=PERIOD
        ),
    )


@final
class Matrix(Closing):
    """A matrix sends lines of its scans to a pseudo-terminal until it is closed.

    Attributes:
        skin: the skin that the matrix is.
        hand: hand that touches it.
        path: path of the terminal, which opens as a serial port does.
    """

    def __init__(self, folder: Path, robot: Path) -> None:
        """Start to send.

        Args:
            folder: folder of the skin.
            robot: URDF of the robot that wears it.
        """
        self.skin = load_skin(folder)
        self.simulated = InteractiveSkin(
            str(folder),
            SEED,
            loses=False,
            build=build_sensor(self.skin),
            robot=str(robot),
        )
        self.hand = Hand(self.simulated.hand, self.skin)
        self.q = np.zeros(len(self.simulated.mounted.robot.joint_names))
        self.dead = self.skin.rows == DEAD_ROW
        self.port = PtyPort()
        self.path = self.port.path
        self.is_closed = Event()
        self.thread = Thread(target=self.send_lines, daemon=True)
        # The first scan compiles what a touch needs.
        self.read_line(0)
        self.thread.start()

    def send_lines(self) -> None:
        """Send a line each period; those that nobody reads are lost."""
        start = time.monotonic()
        number = 0
        while not self.is_closed.wait(start + number * PERIOD - time.monotonic()):
            number += 1
            self.port.send([self.read_line(number)])

    def read_line(self, number: int) -> bytes:
        """Return the line of the next scan."""
        scan = self.simulated.scan(round(number * PERIOD * NS_PER_S), self.q)
        counts = np.where(self.dead, 0, scan.counts)
        line = {"t": round(number * PERIOD, 3), "v": counts.tolist()}
        return json.dumps(line).encode() + b"\n"

    def close(self) -> None:
        """Stop to send, and close the terminal."""
        self.is_closed.set()
        self.thread.join()
        self.port.close()


@final
class Hand:
    """A hand makes the gestures of a person who has been asked for them."""

    def __init__(self, hand: InteractiveHand, skin: Skin) -> None:
        """Prepare a hand for a skin of one patch."""
        self.hand = hand
        self.skin = skin
        self.rng = np.random.default_rng(SEED)

    def find_point(self, row: float, column: float) -> LinkPoint:
        """Return the point of the taxel nearest to a row and a column."""
        offsets = np.hypot(self.skin.rows - row, self.skin.columns - column)
        taxel = int(np.argmin(offsets))
        link = self.skin.patches[int(self.skin.patch_index[taxel])].link
        return LinkPoint(link, self.skin.positions[taxel])

    def draw_middle(self) -> tuple[float, float]:
        """Draw the row and column of the middle of a touch, away from the edges."""
        patch = self.skin.patches[0]
        rows = self.rng.uniform(0.35, 0.65) * (patch.rows - 1)
        return rows, self.rng.uniform(0.35, 0.65) * (patch.columns - 1)

    def press(self, row: int, column: int, newtons: float) -> None:
        """Press with a fingertip for a second."""
        time.sleep(REACTION)
        self.hand.poke(self.find_point(row, column), newtons, 1.0)
        self.wait_lifted()

    def make(self, gesture: str) -> None:
        """Make one of `GESTURES`."""
        time.sleep(REACTION)
        row, column = self.draw_middle()
        newtons = float(self.rng.normal(5.0, 0.6))
        if gesture == "knock":
            for _ in range(3):
                self.hand.poke(self.find_point(row, column), newtons, 0.15)
                self.wait_lifted()
                time.sleep(0.1)
        elif gesture == "circle":
            self.circle(row, column, newtons)
        else:
            touch = self.hand.begin(self.find_point(row, column), 4 * newtons, "heel")
            time.sleep(float(self.rng.uniform(0.8, 1.3)))
            self.hand.end(touch)
            self.wait_lifted()

    def circle(self, row: float, column: float, newtons: float) -> None:
        """Go round once with a fingertip, 2.5 taxels from the middle."""
        angles = self.rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, 25)
        places = zip(
            row + 2.5 * np.sin(angles), column + 2.5 * np.cos(angles), strict=True
        )
        points = [self.find_point(*place) for place in places]
        touch = self.hand.begin(points[0], newtons, "one_tip")
        for point in points:
            self.hand.move(touch, point)
            time.sleep(0.06)
        self.hand.end(touch)
        self.wait_lifted()

    def wait_lifted(self) -> None:
        """Wait until nothing touches the skin."""
        while self.hand.touching:
            time.sleep(0.01)
