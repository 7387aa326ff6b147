"""`eskin skin paint` lets a person paint where skin is to lie, in the browser."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from eskin.cli.checks import check_writable
from eskin.cli.design import check_packages
from eskin.cli.run import DEFAULT_PORT
from eskin.errors import DeviceError, SkinError
from eskin.robot import load_robot
from eskin.units import format_count

WAIT = 60.0
"""Longest time until the page is served [s]."""


@dataclass(frozen=True)
class PaintCommand:
    """Paint where skin is to lie on a robot, and where none is, in the browser.

    The page shows the robot. Drag over it to paint with a round brush, or click; undo
    and save by the buttons. What is painted on a link is one region of the
    specification that `eskin skin design --spec` reads.
    """

    robot: tyro.conf.Positional[str]
    """Robot to paint on: a .urdf file, or the name of one that comes with eskin."""

    spec: Path
    """YAML file to write. What it holds already is kept, below what is painted; its
    comments are not."""

    links: tuple[str, ...] = ()
    """Links to paint on; all that have a shape where none are given."""

    density: float | None = None
    """Density of the painted regions [1/cm2]; that of `eskin skin design` by default.
    """

    port: int = DEFAULT_PORT
    """TCP port of the page on this computer; 0 takes any free one."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run(command: PaintCommand) -> dict[str, object]:
    """Serve the page until it is closed; return what was saved."""
    check_packages()
    from eskin.design.painting import (
        PaintedBall,
        add_painted,
        find_points,
        sample_surfaces,
    )
    from eskin.design.spec import (
        MAX_BALLS,
        PER_CM2,
        SpecFile,
        read_spec_file,
        write_spec_file,
    )
    from eskin.page import PaintOrder
    from eskin.page.link import free_port
    from eskin.skin import MountedSkin
    from eskin.viewer import PaintViewer, ViewerConfig

    if command.density is not None and not 0 < command.density <= 1e4:
        raise SkinError(
            f"--density is {command.density:g}; allowed are numbers above 0 up to 1e4"
        )
    check_writable(command.spec)
    config = ViewerConfig(free_port(command.port))
    robot = load_robot(command.robot, mimics=not command.no_mimics)
    before = read_spec_file(command.spec) if command.spec.exists() else SpecFile()
    density = None if command.density is None else PER_CM2 * command.density
    points = sample_surfaces(robot, command.links)
    regions, keep_outs = before.build(PER_CM2)
    earlier = np.stack(
        [
            find_points(points, [region.zone for region in regions]),
            find_points(points, keep_outs),
        ]
    )
    written = before

    def save(balls: tuple[PaintOrder, ...]) -> str:
        nonlocal written
        painted = [
            PaintedBall(ball.link, ball.p_link, ball.radius, ball.keeps_out)
            for ball in balls
        ]
        entries = add_painted(before, painted, density)
        try:
            write_spec_file(command.spec, entries)
        except OSError as error:
            return f"not saved: {error.strerror}; give another file with --spec"
        written = entries
        return f"saved: {command.spec}"

    used = sum(len(zone.balls_mm or ()) for zone in (*before.regions, *before.keep_out))
    page = PaintViewer(
        MountedSkin(points, robot), save, earlier, MAX_BALLS - used, config
    )
    try:
        print(f"paint at {page.page.wait_ready(WAIT)}", flush=True)
        with suppress(KeyboardInterrupt):
            page.wait_closed()
        if page.page.failure is not None:
            raise DeviceError(page.page.failure)
    finally:
        page.close()
    is_saved = written is not before
    print(
        f"{command.spec}: {format_count(len(written.regions), 'region')}, "
        f"{format_count(len(written.keep_out), 'keep-out zone')}"
        if is_saved
        else "nothing was saved"
    )
    return {
        "spec": str(command.spec),
        "saved": is_saved,
        "regions": len(written.regions),
        "keep_out": len(written.keep_out),
        "balls": len(page.balls),
    }
