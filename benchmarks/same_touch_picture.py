"""A picture of the same counts in two poses, and what two recognisers say of them.

    python -m benchmarks.same_touch_picture --out docs/pictures/same_touch.png

Plays a touch as `eskin demo --same-touch` does, and shows the page with the largest
pressure of each taxel in either pose, in headless Chromium. Beside both stands the
panel, with what is said in the end.
"""

import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from PIL import Image
from playwright.sync_api import Page, ViewportSize, sync_playwright

from benchmarks.viewer import CHROMIUM, FLAGS
from eskin.demo.comparison import ComparisonListener
from eskin.demo.same_touch import SameTouch, draw_touches, load_both_models
from eskin.live import Recognizer
from eskin.page import SceneDescription, ViewUpdate
from eskin.stream import RecognitionState
from eskin.viewer.appearance import describe_scene
from eskin.viewer.process import PageProcess
from eskin.viewer.viewer import FrameEncoder

SETTLE = 20.0
"""Until everything is drawn, by software [s]."""
SIZE = ViewportSize(width=1300, height=900)
SCENE = (150, 200, 770, 700)
"""What is shown of the scene: left, top, right and bottom [px]."""
ANSWERS = (900, 55, 1300, 445)
"""What is shown of the panel."""


@dataclass(frozen=True)
class Command:
    """Take the picture."""

    out: Path
    """Where it goes."""

    model: str = "ur5"
    """Weights that come with eskin, or a model file."""

    seed: int = 0
    """Decides the touch."""


def main() -> None:
    """Play, show and take the picture."""
    command = tyro.cli(Command)
    [touch] = draw_touches(1, seed=command.seed)
    setup, pictures = pictures_of(touch, command.model)
    process = PageProcess(setup, 0, None)
    try:
        port = process.wait_ready(60.0)
        with sync_playwright() as browsers:
            browser = browsers.chromium.launch(
                executable_path=CHROMIUM, args=list(FLAGS)
            )
            page = browser.new_page(viewport=SIZE)
            page.goto(f"http://127.0.0.1:{port}")
            shots = [shot(page, process, picture) for picture in pictures]
            browser.close()
    finally:
        process.close()
    joined(shots).save(command.out)


def pictures_of(
    touch: SameTouch, model: str
) -> tuple[SceneDescription, list[ViewUpdate]]:
    """What the page is told once, and the height of the touch in either pose."""
    models = load_both_models(model)
    comparison = ComparisonListener([touch], models)
    setup = describe_scene(touch.mounted, models[0].card.vocabulary, compares=True)
    encoder, begin, highest = FrameEncoder(touch.mounted, 0), touch.period, []
    for side in (0, 1):
        recognizer = Recognizer(models[0], touch.mounted, touch.calibration)
        shown: list[ViewUpdate] = []
        for scan in touch.scans(side, begin, None):
            comparison.on_message(scan)
            recognizer.push(scan)
            assert recognizer.state is not None
            moment = RecognitionState(recognizer.state, recognizer.probabilities, ())
            shown.append(encoder.build_update(moment, 50.0, 0.0, 0.0, None))
        begin += touch.period * len(touch.counts)
        highest.append(most(shown))
    comparison.close()
    board = comparison.build_board()
    return setup, [
        replace(picture, board=replace(board, playing=side))
        for side, picture in enumerate(highest)
    ]


def most(pictures: Sequence[ViewUpdate]) -> ViewUpdate:
    """The largest pressure of each taxel in one picture, at the greatest force."""
    top = max(pictures, key=lambda picture: picture.force)
    marks = max(pictures, key=lambda picture: len(picture.contacts)).contacts
    pressure = np.max([picture.pressure for picture in pictures], axis=0)
    return replace(top, pressure=pressure, contacts=marks)


def shot(page: Page, process: PageProcess, picture: ViewUpdate) -> Image.Image:
    """The page once it shows a picture."""
    process.give(picture)
    time.sleep(SETTLE)
    hint = page.get_by_text("Software WebGL rendering detected")
    if hint.count():
        page.locator("button.mantine-Notification-closeButton").first.click()
        time.sleep(1.0)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def joined(shots: Sequence[Image.Image]) -> Image.Image:
    """Both scenes beside each other, then the panel."""
    parts = [*(each.crop(SCENE) for each in shots), shots[-1].crop(ANSWERS)]
    widths = [part.width for part in parts]
    whole = Image.new("RGB", (sum(widths), parts[0].height), "white")
    for number, part in enumerate(parts):
        whole.paste(part, (sum(widths[:number]), 0))
    return whole


if __name__ == "__main__":
    main()
