"""Measure the cost of the browser view, and its effect on recognition.

    python -m lab.viewer

The ur5 skin at 50 Hz with a simulated person; the arm moves. Shares of a core of this
process and of the page's, and the age of a reading when it has been processed: without
a viewer, with one headless browser, and with three of which one is stalled. Browsers
draw by software here, which takes all that a core has: they are kept to one core and
told to give way.
"""

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import tyro

import eskin
from eskin.drivers import PlayedSource, SourceInfo
from eskin.live import warm_up
from eskin.page.viewer import Viewer, ViewerConfig
from eskin.sim.dataset import Simulator
from eskin.sim.interactive import TouchPlayer
from eskin.stream import Recognition, Stream
from eskin.touch import Scan
from lab.browser import CHROMIUM, FLAGS

WINDOW = ("--headless=new", "--window-size=1280,800")
LAST_CORE = str(max(os.sched_getaffinity(0)))
TICKS = os.sysconf("SC_CLK_TCK")
SETTLE = 8.0
"""Time for browsers to load before the measurement [s]."""


@dataclass(frozen=True)
class Command:
    """Measure the viewer."""

    seconds: float = 30.0
    """Duration of each measurement [s]."""


@dataclass(frozen=True)
class Cost:
    """Holds the measurement of one arrangement of browsers."""

    main: float
    """Share of a core of this process."""
    page: float
    """Share of a core of the page's process."""
    updates: float
    """Rate of updates shown [1/s]."""
    age_p50: float
    """Median age of a reading when it has been processed [s]."""
    age_p99: float
    """99th percentile of that age [s]."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    player = TouchPlayer(Simulator("ur5"), 0)
    generator = player.generator
    info = SourceInfo(
        "sim:ur5",
        generator.robot_name,
        generator.mounted.robot.joint_names,
        generator.mounted.skin,
        generator.calibration(player.build),
        player.rate,
    )
    count = round((command.seconds + 3 * SETTLE) * player.rate)
    scans = [
        replace(scan, q=scan.q + 0.2 * np.sin(number / 50))
        for number, scan in enumerate(islice(player.scans(), count))
    ]
    print(f"{'browsers':24} {'main':>6} {'page':>6} {'1/s':>5} {'p50':>8} {'p99':>8}")
    base = None
    for name, browsers, stalled in (
        ("no viewer", None, 0),
        ("none", 0, 0),
        ("one", 1, 0),
        ("three, one stalled", 3, 1),
    ):
        cost = measure(info, scans, command.seconds, browsers, stalled)
        base = base or cost
        print(
            f"{name:24} {cost.main:6.1%} {cost.page:6.1%} {cost.updates:5.1f} "
            f"{1e3 * cost.age_p50:5.2f} ms {1e3 * cost.age_p99:5.2f} ms   "
            f"viewer in total {cost.main + cost.page - base.main:.1%} of a core",
            flush=True,
        )


def measure(
    info: SourceInfo,
    scans: list[Scan],
    seconds: float,
    browsers: int | None,
    stalled: int,
) -> Cost:
    """Stream with some browsers open; without the page where their number is None."""
    mounted = eskin.MountedSkin(info.skin, eskin.load_robot(info.robot_name))
    model = eskin.load_model("ur5")
    recognizer = eskin.Recognizer(model, mounted, info.calibration)
    warm_up(recognizer)
    recognition = Recognition(recognizer)
    viewer = Viewer(recognition, ViewerConfig(0))
    listeners = [recognition] if browsers is None else [recognition, viewer]
    with Stream(PlayedSource(info, scans, restamp=True), listeners) as stream:
        page = viewer.page
        link = page.wait_ready(60.0) if page else ""
        with opened(link, browsers or 0, stalled):
            stream.wait(SETTLE)
            recognition.age = type(recognition.age)()
            spent, shown = time.process_time(), page.shown if page else 0
            page_spent = used_by(page.process.pid) if page else 0.0
            stream.wait(seconds)
            main = (time.process_time() - spent) / seconds
            if page:
                page_spent = (used_by(page.process.pid) - page_spent) / seconds
            updates = ((page.shown if page else 0) - shown) / seconds
        age = recognition.age
        return Cost(main, page_spent, updates, age.quantile(0.5), age.quantile(0.99))


@contextmanager
def opened(link: str, count: int, stalled: int) -> Iterator[None]:
    """Open browsers on a page, and stall the last ones of them."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        running = [
            subprocess.Popen(
                [
                    *("nice", "-n", "19", "taskset", "-c", LAST_CORE, CHROMIUM),
                    *(*FLAGS, *WINDOW),
                    f"--user-data-dir={Path(folder) / str(number)}",
                    "--remote-debugging-port=0",
                    link,
                ],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            for number in range(count)
        ]
        try:
            time.sleep(SETTLE / 2 if stalled else 0)
            for browser in running[len(running) - stalled :]:
                os.killpg(browser.pid, signal.SIGSTOP)
            yield
        finally:
            for browser in running:
                os.killpg(browser.pid, signal.SIGKILL)
                browser.wait()


def used_by(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


if __name__ == "__main__":
    main()
