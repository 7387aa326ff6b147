"""Draw the same counts in two poses, with the answers of two recognisers.

    python -m lab.same_touch_picture --out docs/pictures/same_touch.png

A touch is played as by `eskin demo --same-touch`. Headless Chromium shows the page with
the greatest pressure of each taxel in either pose; the panel with the final answers
stands beside both.
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

from eskin.live import Recognizer
from eskin.page import SceneDescription, ViewUpdate
from eskin.page.appearance import describe_scene
from eskin.page.process import PageProcess
from eskin.page.viewer import FrameEncoder
from eskin.stream import RecognitionState
from lab.same_touch.board import ComparisonListener
from lab.same_touch.touches import SameTouch, draw_touches, load_both_models
from lab.viewer import CHROMIUM, FLAGS

SETTLE = 20.0
"""Time until everything is drawn in software [s]."""
SIZE = ViewportSize(width=1300, height=900)
SCENE = (150, 200, 770, 700)
"""Part of the scene that is shown: left, top, right and bottom [px]."""
ANSWERS = (900, 55, 1300, 445)
"""Part of the panel that is shown: left, top, right and bottom [px]."""


@dataclass(frozen=True)
class Command:
    """Take the picture."""

    out: Path
    """Path of the picture."""
    model: str = "ur5"
    """Weights that come with eskin, or a model file."""
    seed: int = 0
    """Seed of the touch."""


def main() -> None:
    """Play the touch, show the page and save the picture."""
    command = tyro.cli(Command)
    [touch] = draw_touches(1, seed=command.seed)
    setup, pictures = build_updates(touch, command.model)
    process = PageProcess(setup, 0, None)
    try:
        link = process.wait_ready(60.0)
        with sync_playwright() as browsers:
            browser = browsers.chromium.launch(
                executable_path=CHROMIUM, args=list(FLAGS)
            )
            page = browser.new_page(viewport=SIZE)
            page.goto(link)
            shots = [shot(page, process, picture) for picture in pictures]
            browser.close()
    finally:
        process.close()
    join_pictures(shots).save(command.out)


def build_updates(
    touch: SameTouch, model: str
) -> tuple[SceneDescription, list[ViewUpdate]]:
    """Build the scene description, and an update at the peak force in either pose."""
    models = load_both_models(model)
    comparison = ComparisonListener([touch], models)
    gestures = models[0].card.vocabulary
    setup = replace(describe_scene(touch.mounted, gestures), compares=True)
    encoder, begin, highest = FrameEncoder(touch.mounted, 0), touch.period, []
    for side in (0, 1):
        recognizer = Recognizer(models[0], touch.mounted, touch.calibration)
        shown: list[ViewUpdate] = []
        for scan in touch.scans(side, begin, None):
            comparison.on_message(scan)
            recognizer.push(scan)
            assert recognizer.state is not None
            state = RecognitionState(recognizer.state, recognizer.probabilities, ())
            shown.append(encoder.build_update(state, 50.0, 0.0, 0.0, None))
        begin += touch.period * len(touch.counts)
        highest.append(merge_peaks(shown))
    comparison.close()
    board = comparison.build_board()
    return setup, [
        replace(picture, board=replace(board, playing=side))
        for side, picture in enumerate(highest)
    ]


def merge_peaks(pictures: Sequence[ViewUpdate]) -> ViewUpdate:
    """Combine updates: that of greatest force, with the peak pressure of each taxel."""
    top = max(pictures, key=lambda picture: picture.force)
    marks = max(pictures, key=lambda picture: len(picture.contacts)).contacts
    pressure = np.max([picture.pressure for picture in pictures], axis=0)
    return replace(top, pressure=pressure, contacts=marks)


def shot(page: Page, process: PageProcess, picture: ViewUpdate) -> Image.Image:
    """Show an update and take a screenshot."""
    process.give(picture)
    time.sleep(SETTLE)
    hint = page.get_by_text("Software WebGL rendering detected")
    if hint.count():
        page.locator("button.mantine-Notification-closeButton").first.click()
        time.sleep(1.0)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def join_pictures(shots: Sequence[Image.Image]) -> Image.Image:
    """Join both scenes and the panel side by side."""
    parts = [*(each.crop(SCENE) for each in shots), shots[-1].crop(ANSWERS)]
    widths = [part.width for part in parts]
    whole = Image.new("RGB", (sum(widths), parts[0].height), "white")
    for number, part in enumerate(parts):
        whole.paste(part, (sum(widths[:number]), 0))
    return whole


if __name__ == "__main__":
    main()
