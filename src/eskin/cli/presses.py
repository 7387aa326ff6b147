"""Asking for presses on a live skin, spot by spot."""

from eskin.drivers import Source
from eskin.robot import Robot
from eskin.skin import MountedSkin, Skin
from eskin.skin.wiring import PressResponse, PressTarget, choose_press_targets
from eskin.touch import PressDetector, TouchPipeline
from eskin.units import NS_PER_S

TARE = 3.0
"""Without touch at first [s]."""


def answers_of(source: Source, robot: Robot, wait: float) -> list[PressResponse]:
    """Ask for a press on every spot of the skin, and note who answers.

    Args:
        source: of the skin.
        robot: that the skin is on.
        wait: how long each press is awaited [s].
    """
    info = source.info
    pipeline = TouchPipeline(MountedSkin(info.skin, robot), info.calibration)
    print(f"hands off for {TARE:g} s", flush=True)
    tare(source, pipeline)
    answers = []
    for spot in choose_press_targets(info.skin):
        print(f"press {words_of(info.skin, spot.taxel)} ...", end=" ", flush=True)
        taxel = next_press(source, pipeline, wait)
        answers.append(PressResponse(spot, taxel))
        print(verdict(info.skin, spot, taxel), flush=True)
    return answers


def tare(source: Source, pipeline: TouchPipeline) -> None:
    """Let the skin come to rest, whoever touches it meanwhile."""
    until = None
    for scan in source:
        until = scan.stamp + TARE * NS_PER_S if until is None else until
        pipeline.push(scan)
        if scan.stamp >= until:
            return


def next_press(source: Source, pipeline: TouchPipeline, wait: float) -> int | None:
    """The taxel of the next press; None where none comes in time [s]."""
    finder, begun = PressDetector(), None
    for scan in source:
        begun = scan.stamp if begun is None else begun
        taxel = finder.push(pipeline.push(scan))
        if taxel is not None or scan.stamp - begun > wait * NS_PER_S:
            return taxel
    return None


def words_of(skin: Skin, taxel: int) -> str:
    """Where a taxel is, as people find it."""
    patch = skin.patches[int(skin.patch_index[taxel])]
    return (
        f"patch '{patch.id}' on {patch.link}, row {skin.rows[taxel]} of {patch.rows}, "
        f"column {skin.columns[taxel]} of {patch.columns}"
    )


def verdict(skin: Skin, spot: PressTarget, taxel: int | None) -> str:
    """What a press told."""
    if taxel is None:
        return "nothing felt"
    same = skin.patches[int(skin.patch_index[taxel])].id == spot.patch
    place = f"row {skin.rows[taxel]}, column {skin.columns[taxel]}"
    return f"felt at {place}" if same else f"felt on {words_of(skin, taxel)}"
