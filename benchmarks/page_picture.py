"""A picture of the demonstration's page, from the real thing.

    python -m benchmarks.page_picture --out docs/pictures/demo.png

Serves `eskin demo`, opens it in headless Chromium, clicks on the arm, and takes a
screenshot of 1280 x 800.
"""

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import tyro
from playwright.sync_api import Page, sync_playwright

from benchmarks.viewer import CHROMIUM, FLAGS
from eskin.page.port import free_port

SETTLE = 20.0
"""Until everything is drawn, by software [s]."""
PLACES = ((505, 420),)
"""On the upper arm, which the page shows in the middle [px]."""
SHOWN = 3.5
"""After the last click: software draws a second or more late [s]."""


@dataclass(frozen=True)
class Command:
    """Take the picture."""

    out: Path
    """Where it goes."""


def main() -> None:
    """Serve, touch and take the picture."""
    command, port = tyro.cli(Command), free_port(0)
    served = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "eskin.cli.main",
            "demo",
            "--seed",
            "4",
            "--port",
            str(port),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert served.stdout is not None
        print(served.stdout.readline().strip())
        with sync_playwright() as browsers:
            browser = browsers.chromium.launch(
                executable_path=CHROMIUM, args=list(FLAGS)
            )
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(f"http://127.0.0.1:{port}")
            take(page, command.out)
            browser.close()
    finally:
        served.terminate()
        served.wait()


def take(page: Page, out: Path) -> None:
    """Touch the arm in the page, and take its picture."""
    time.sleep(SETTLE)
    hint = page.get_by_text("Software WebGL rendering detected")
    if hint.count():
        page.locator("button.mantine-Notification-closeButton").first.click()
    for x, y in PLACES:
        time.sleep(2.5)
        page.mouse.click(x, y)
    time.sleep(SHOWN)
    page.screenshot(path=str(out))


if __name__ == "__main__":
    main()
