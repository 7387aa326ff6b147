"""Run `eskin demo` in a process of its own that prints the state of its arm.

python -m lab.served_demo --seed 4
"""

import json
import subprocess
import sys
import time
from collections import deque
from dataclasses import asdict, dataclass
from threading import Condition, Thread
from typing import Any, final

import numpy as np
import tyro
from jaxtyping import Float

from eskin.drivers import Clock, HostClock
from eskin.page.viewer import ViewerConfig
from eskin.sim.demo import DemoConfig
from eskin.sim.demo.browser import SkinChoice, run_demo

TICK = 0.05
"""Interval between two printed states [s]."""
START = 120.0
"""Longest time until the page is served [s]."""
LAG = 0.3
"""Approximate delay of the browser behind the arm [s]."""


@dataclass(frozen=True)
class Command:
    """Serve the demonstration until its standard input ends."""

    seed: int = 0
    """Seed, as of `eskin demo`."""
    pace: float = 1.0
    """Seconds of simulated time per second of real time."""


@final
class SlowClock(Clock):
    """Slows down the clock of this computer, from its construction on."""

    def __init__(self, pace: float) -> None:
        """Set the pace as a share of real time."""
        self.host = HostClock()
        self.pace = pace
        self.begin = self.host.now()

    def now(self) -> int:
        """Return the slowed-down time [ns since the epoch]."""
        return self.begin + round(self.pace * (self.host.now() - self.begin))

    def sleep(self, seconds: float) -> None:
        """Sleep for a simulated time [s]."""
        self.host.sleep(seconds / self.pace)


def main() -> None:
    """Serve the demonstration and print the state of the arm periodically."""
    command = tyro.cli(Command)
    config = DemoConfig(seed=command.seed, build_kind="flawless")
    clock = SlowClock(command.pace)
    page = ViewerConfig(0, touchable=True)
    with run_demo(config, page, SkinChoice(), clock) as demo:
        print(demo.link, flush=True)
        while not demo.stream.wait(TICK):
            state = asdict(demo.arm.state())
            print(json.dumps(state | {"q": state["q"].tolist()}), flush=True)


@final
class ServedDemo:
    """Runs the demonstration in a process, and stores the states that it prints."""

    def __init__(self, seed: int = 0, pace: float = 1.0) -> None:
        """Start the process.

        Args:
            seed: seed, as of `eskin demo`.
            pace: seconds of simulated time per second of real time.
        """
        self.pace = pace
        options = ["--seed", str(seed), "--pace", str(pace)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "lab.served_demo", *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.changed = Condition()
        self.link = ""
        self.states: deque[dict[str, Any]] = deque(maxlen=100)
        self.reader = Thread(target=self.read, daemon=True)
        self.reader.start()

    def __enter__(self) -> "ServedDemo":
        """Wait until the page is served."""
        with self.changed:
            self.changed.wait_for(lambda: self.states or self.ended, START)
            assert self.states, "the demonstration is not served"
        return self

    def __exit__(self, *error: object) -> None:
        """End the process."""
        self.process.terminate()
        self.process.wait()
        self.reader.join()

    @property
    def ended(self) -> bool:
        """Return whether the process has ended."""
        return self.process.poll() is not None

    def read(self) -> None:
        """Read what the process prints, until it ends."""
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                with self.changed:
                    if not self.link:
                        self.link = line.strip()
                    else:
                        self.states.append(json.loads(line))
                    self.changed.notify_all()

    @property
    def state(self) -> dict[str, Any]:
        """Current state of the arm, with the fields of `ArmState`."""
        return self.states[-1]

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return self.state["stamp"] / 1e9

    @property
    def q_shown(self) -> Float[np.ndarray, "joint"]:
        """Approximate joint positions that a browser shows now [rad]."""
        late = self.states[-1]["stamp"] - LAG * self.pace * 1e9
        with self.changed:
            shown = [state for state in self.states if state["stamp"] <= late]
            return np.array((shown or self.states)[-1]["q"])

    def rest(self, seconds: float) -> None:
        """Wait for a simulated time [s]."""
        end = self.seconds + seconds
        while self.seconds < end:
            self.wait(TICK)

    def wait(self, seconds: float) -> None:
        """Wait while the process runs."""
        assert not self.ended, "the demonstration has ended"
        time.sleep(seconds)


if __name__ == "__main__":
    main()
