"""`eskin demo` in a process of its own, which also tells what its arm does.

python -m benchmarks.served_demo --seed 4
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

from eskin.demo import DemoConfig
from eskin.demo.browser import SkinChoice, run_demo
from eskin.drivers import Clock, HostClock

TICK = 0.05
"""Between two states [s]."""
START = 120.0
"""How long it may take to be served [s]."""
LAG = 0.3
"""How long after the arm a browser shows it, about [s]."""


@dataclass(frozen=True)
class Command:
    """Serve the demonstration until its standard input ends."""

    seed: int = 0
    """As of `eskin demo`."""

    pace: float = 1.0
    """Seconds of the arm and its skin in one of this computer."""


@final
class SlowClock(Clock):
    """This computer's, slowed down from when it was made."""

    def __init__(self, pace: float) -> None:
        """Go at a pace, as a share."""
        self.host, self.pace = HostClock(), pace
        self.begin = self.host.now()

    def now(self) -> int:
        """The time [ns since the epoch]."""
        return self.begin + round(self.pace * (self.host.now() - self.begin))

    def sleep(self, seconds: float) -> None:
        """Let some time pass [s]."""
        self.host.sleep(seconds / self.pace)


def main() -> None:
    """Serve, and print the arm's state again and again."""
    command = tyro.cli(Command)
    config, clock = DemoConfig(seed=command.seed), SlowClock(command.pace)
    with run_demo(config, 0, SkinChoice(), clock) as demo:
        print(demo.port, flush=True)
        while not demo.stream.wait(TICK):
            state = asdict(demo.arm.state())
            print(json.dumps(state | {"q": state["q"].tolist()}), flush=True)


@final
class ServedDemo:
    """The process, and what it has told; use with `with`."""

    def __init__(self, seed: int = 0, pace: float = 1.0) -> None:
        """Start it.

        Args:
            seed: as of `eskin demo`.
            pace: seconds of the arm and its skin in one of this computer.
        """
        self.pace = pace
        options = ["--seed", str(seed), "--pace", str(pace)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.served_demo", *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.told = Condition()
        self.port = 0
        self.states: deque[dict[str, Any]] = deque(maxlen=100)
        self.reader = Thread(target=self.read, daemon=True)
        self.reader.start()

    def __enter__(self) -> "ServedDemo":
        """Wait until it is served."""
        with self.told:
            self.told.wait_for(lambda: self.states or self.ended, START)
            assert self.states, "the demonstration is not served"
        return self

    def __exit__(self, *error: object) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        self.reader.join()

    @property
    def ended(self) -> bool:
        """Whether the process has."""
        return self.process.poll() is not None

    def read(self) -> None:
        """Read what it prints, until it ends."""
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                with self.told:
                    if not self.port:
                        self.port = int(line)
                    else:
                        self.states.append(json.loads(line))
                    self.told.notify_all()

    @property
    def state(self) -> dict[str, Any]:
        """Of the arm, now; as `ArmState` has it."""
        return self.states[-1]

    @property
    def q_shown(self) -> Float[np.ndarray, "joint"]:
        """Where a browser shows the joints now, about [rad]."""
        late = self.states[-1]["stamp"] - LAG * self.pace * 1e9
        with self.told:
            shown = [state for state in self.states if state["stamp"] <= late]
            return np.array((shown or self.states)[-1]["q"])

    def wait(self, seconds: float) -> None:
        """Let time pass while it runs."""
        assert not self.ended, "the demonstration has ended"
        time.sleep(seconds)


if __name__ == "__main__":
    main()
