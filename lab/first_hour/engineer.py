"""Walk as an engineer with her own robot and matrix does, and count what fails.

She lays a matrix of 12 x 10 on an arm of seven joints, calibrates it, records gestures
of her own, trains and runs. A hand that waits for what is printed replaces hers, and
`Matrix` replaces the electronics; the commands are those that a person types.
"""

import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import final

from lab.first_hour.matrix import BITS, GESTURES, Hand, Matrix
from lab.first_hour.page import find_detections

LINK = """\
  <link name="{name}">
    <collision>
      <origin xyz="0 0 {middle}"/>
      <geometry><cylinder radius="{radius}" length="{length}"/></geometry>
    </collision>
  </link>
"""
JOINT = """\
  <joint name="joint{number}" type="revolute">
    <origin xyz="0 0 {offset}" rpy="{roll} 0 0"/>
    <parent link="{parent}"/>
    <child link="{child}"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2.4" upper="2.4" effort="60" velocity="2"/>
  </joint>
"""
LENGTHS = (0.20, 0.30, 0.10, 0.30, 0.10, 0.12, 0.08, 0.05)
"""Lengths of the links, from the base on [m]."""
FOREARM = 3
"""Link that wears the matrix, counted from the base."""
PRESS_NEWTONS = 5.0
"""Force of the presses of the calibration [N]."""
LIVE_GAP = 3.0
"""Time for an answer after a touch [s]."""
NO_ANSWER = 8.0
"""Time after which a touch that nothing was said of is repeated [s]."""
LONGEST = 600.0
"""Longest time of a command [s]."""
PRESS = re.compile(r"press .*row (?P<row>\d+)\b.*column (?P<column>\d+)\b")
REQUEST = re.compile(r"(?P<gesture>[\w-]+) \((?P<number>\d+) of \d+\): touch now")
TAKEN = re.compile(r"  [\d.]+ s, ")


@dataclass(frozen=True)
class Plan:
    """A plan says how much the engineer does, and what must succeed."""

    gestures: tuple[str, ...] = GESTURES
    """Gestures that she records."""
    presses: int = 5
    """Presses of the calibration."""
    times: int = 10
    """Recorded touches of each gesture."""
    epochs: int = 3
    """Epochs of the training."""
    live: int = 14
    """Touches that are recognised live."""
    least_taken: int = 28
    """Recorded touches that must be taken at the first time."""
    least_right: int = 12
    """Live touches that must be answered rightly."""


FULL = Plan()
SHORT = Plan(
    gestures=GESTURES[:2],
    presses=1,
    times=2,
    epochs=1,
    live=2,
    least_taken=4,
    least_right=2,
)


def write_arm(path: Path) -> None:
    """Write the URDF of an arm of seven joints, whose links stand one on the other."""
    names = [f"link{number}" for number in range(len(LENGTHS))]
    parts = ['<robot name="arm7">\n']
    for number, (name, length) in enumerate(zip(names, LENGTHS, strict=True)):
        radius = 0.06 - 0.004 * number
        middle = length / 2
        parts.append(
            LINK.format(name=name, middle=middle, radius=radius, length=length)
        )
        if number > 0:
            parts.append(
                JOINT.format(
                    number=number,
                    offset=LENGTHS[number - 1],
                    roll=(0.0, 0.5)[number % 2],
                    parent=names[number - 1],
                    child=name,
                )
            )
    path.write_text("".join([*parts, "</robot>\n"]), encoding="utf-8")


@final
class Program:
    """A program is a command of `eskin` that runs, whose lines are read as they come.

    Attributes:
        lines: all lines so far.
    """

    def __init__(self, folder: Path, words: str, show: bool) -> None:
        """Start `eskin` with some words in a folder."""
        self.words = words
        self.show = show
        self.lines: list[str] = []
        self.queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self.until = time.monotonic() + LONGEST
        self.process = subprocess.Popen(
            [sys.executable, "-m", "eskin", *words.split()],
            cwd=folder,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        Thread(target=self.read_lines, daemon=True).start()

    def read_lines(self) -> None:
        """Put what the program prints into the queue, and None at its end."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.queue.put(line.rstrip("\n"))
        self.queue.put(None)

    def read(self, timeout: float = LONGEST) -> str | None:
        """Return the next line; an empty one where none comes in time, None at the end.

        Raises:
            RuntimeError: the program takes too long.
        """
        if time.monotonic() > self.until:
            self.process.kill()
            raise RuntimeError(f"eskin {self.words} takes over {LONGEST:g} s")
        try:
            line = self.queue.get(timeout=timeout)
        except queue.Empty:
            return ""
        if line is not None:
            self.lines.append(line)
            print(f"    {line}\n" * self.show, end="", flush=True)
        return line

    def collect(self, seconds: float) -> list[str]:
        """Return the lines of a time [s]."""
        until = time.monotonic() + seconds
        first = len(self.lines)
        while (left := until - time.monotonic()) > 0:
            if self.read(left) is None:
                break
        return self.lines[first:]

    def read_all(self) -> None:
        """Read all lines up to the end."""
        while self.read() is not None:
            pass

    def finish(self) -> None:
        """Wait for the end; all lines must have been read.

        Raises:
            RuntimeError: the program failed.
        """
        if self.process.wait() != 0:
            raise RuntimeError("\n".join([f"eskin {self.words} failed:", *self.lines]))


@dataclass
class Walk:
    """A walk runs the commands in their order, and counts."""

    folder: Path
    """Folder that the engineer works in."""
    plan: Plan
    """What she does."""
    show: bool
    """Whether what the commands print is printed too."""
    commands: int = 0
    """Number of commands so far."""
    tries: dict[str, list[bool]] = field(default_factory=dict)
    """For each touch that was asked for, whether each try was taken."""
    made: list[str] = field(default_factory=list)
    """Gestures made live."""
    answered: list[list[str]] = field(default_factory=list)
    """Answers to each of them."""

    def start(self, words: str) -> Program:
        """Start a command."""
        self.commands += 1
        return Program(self.folder, words, self.show)

    def run(self, words: str) -> None:
        """Run a command to its end, and print how long it took."""
        began = time.monotonic()
        program = self.start(words)
        program.read_all()
        program.finish()
        self.tell(began, words)

    def tell(self, began: float, words: str) -> None:
        """Print how long a command took that began at a time."""
        print(f"{time.monotonic() - began:6.1f} s  eskin {words}", flush=True)

    def calibrate(self, words: str, hand: Hand) -> None:
        """Calibrate: hands off, then a press wherever one is asked for."""
        began = time.monotonic()
        program = self.start(words)
        while (line := program.read()) is not None:
            if found := PRESS.match(line):
                hand.press(int(found["row"]), int(found["column"]), PRESS_NEWTONS)
        program.finish()
        self.tell(began, words)

    def record(self, words: str, hand: Hand) -> None:
        """Record: make the gesture that is asked for until it is taken."""
        began = time.monotonic()
        program = self.start(words)
        asked = ""
        while (line := program.read(NO_ANSWER if asked else LONGEST)) is not None:
            if TAKEN.match(line) and asked:
                self.tries[asked][-1] = True
                asked = ""
            elif found := REQUEST.match(line):
                asked = f"{found['gesture']} {found['number']}"
                self.try_touch(asked, hand)
            elif line == "" and asked:
                self.try_touch(asked, hand)
        program.finish()
        self.tell(began, words)

    def try_touch(self, asked: str, hand: Hand) -> None:
        """Make a touch that was asked for, once more or for the first time."""
        self.tries.setdefault(asked, []).append(False)
        hand.make(asked.split()[0])

    def live(self, words: str, hand: Hand) -> None:
        """Make gestures while the recogniser runs, and note its answers."""
        began = time.monotonic()
        program = self.start(words)
        while (line := program.read()) is not None and "what" not in line:
            pass
        program.collect(4.0)
        for number in range(self.plan.live):
            gesture = self.plan.gestures[number % len(self.plan.gestures)]
            first = len(program.lines)
            hand.make(gesture)
            program.collect(LIVE_GAP)
            self.made.append(gesture)
            self.answered.append(find_detections("\n".join(program.lines[first:])))
        program.process.send_signal(signal.SIGINT)
        program.read_all()
        program.finish()
        self.tell(began, words)

    @property
    def taken(self) -> int:
        """Number of touches that were taken at the first time."""
        return sum(tries[0] for tries in self.tries.values())

    @property
    def right(self) -> int:
        """Number of live touches with the right answer, and no other."""
        pairs = zip(self.made, self.answered, strict=True)
        return sum(answers == [gesture] for gesture, answers in pairs)


def walk(is_short: bool, show: bool) -> int:
    """Make the walk, and print its minutes, commands and touches.

    Args:
        is_short: whether few touches are made.
        show: whether what the commands print is printed too.

    Returns:
        Exit code: 0 where enough touches were taken and answered rightly, else 1.
    """
    plan = SHORT if is_short else FULL
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        steps = Walk(folder, plan, show)
        write_arm(folder / "arm7.urdf")
        steps.run(
            f"skin place arm7.urdf --link link{FOREARM} --rows 12 --columns 10 "
            "--pitch-mm 8 --out pad"
        )
        steps.run("skin check pad")
        with Matrix(folder / "pad", folder / "arm7.urdf") as matrix:
            source = f"csv:{matrix.path}"
            steps.calibrate(
                f"calibrate {source} --skin pad --bits {BITS} --presses "
                f"{plan.presses} --force {PRESS_NEWTONS:g} --out pad/calibration.json",
                matrix.hand,
            )
            steps.record(
                f"record {source} --skin pad --gestures {' '.join(plan.gestures)} "
                f"--times {plan.times} --person me --out mine.mcap",
                matrix.hand,
            )
            steps.run(
                f"train mine.mcap --start ur5 --train.epochs {plan.epochs} "
                "--out mine.safetensors"
            )
            steps.live(
                f"run --source {source} --skin pad --model mine.safetensors",
                matrix.hand,
            )
    minutes = (time.monotonic() - began) / 60
    print(f"{minutes:.1f} minutes, {steps.commands} commands")
    print(f"taken at the first time: {steps.taken} of {len(steps.tries)}")
    print(f"live right: {steps.right} of {len(steps.made)}")
    for asked, tries in steps.tries.items():
        if not tries[0]:
            print(f"  {asked}: taken at try {len(tries)}")
    for gesture, answers in zip(steps.made, steps.answered, strict=True):
        if answers != [gesture]:
            print(f"  {gesture}: answered {', '.join(answers) or 'nothing'}")
    enough = steps.taken >= plan.least_taken and steps.right >= plan.least_right
    return int(not enough)
