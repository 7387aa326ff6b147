"""`eskin skin paint` lets a person paint where skin is to lie, in the browser."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, final

import numpy as np
import tyro

from eskin.cli.checks import Range, check_folder, check_writable
from eskin.design.commands.design import check_packages
from eskin.design.commands.place import save_matrix
from eskin.errors import DeviceError, EskinError
from eskin.page import PaintOrder
from eskin.page.process import DEFAULT_PORT, describe_link
from eskin.robot import Robot, load_robot
from eskin.skin import Skin
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.design.paint_viewer import PaintViewer
    from eskin.design.spec import SpecFile

WAIT = 60.0
"""Longest time until the page is served [s]."""


@dataclass(frozen=True)
class PaintCommand:
    """Paint where skin is to lie on a robot, and where none is, in the browser.

    The page shows the robot. Drag over it to paint with a round brush, or click; undo
    and save by the buttons. What is painted on a link is one region of the
    specification that `eskin skin design --spec` reads. A click places a ready-made
    matrix, as `eskin skin place` does, where that is chosen; a link has one.
    """

    robot: tyro.conf.Positional[str]
    """Robot to paint on: a .urdf file, or the name of one that comes with eskin."""

    spec: Path
    """YAML file to write. What it holds already is kept, below what is painted; its
    comments are not."""

    skin: Path | None = None
    """Folder of the skin of matrices; by default SPEC_skin beside the specification."""

    links: tuple[str, ...] = ()
    """Links to paint on; all that have a shape where none are given."""

    density: Annotated[float | None, Range(0, 1e4, is_open=True)] = None
    """Density of the painted regions [1/cm2]; by default as of `eskin skin design`.
    """

    port: int = DEFAULT_PORT
    """TCP port of the page on this computer; 0 takes any free one."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run(command: PaintCommand) -> dict[str, object]:
    """Serve the page until it is closed; return what was saved."""
    check_packages()
    from eskin.design.spec import SpecFile, read_spec_file

    check_writable(command.spec)
    original = read_spec_file(command.spec) if command.spec.exists() else SpecFile()
    skin = command.skin or command.spec.with_name(f"{command.spec.stem}_skin")
    check_folder(skin)
    robot = load_robot(command.robot, mimics=not command.no_mimics)
    draft = SpecDraft(command.spec, original, command.density, robot, skin)
    page = open_page(command, draft)
    try:
        print(describe_link(page.page.wait_ready(WAIT)), flush=True)
        with suppress(KeyboardInterrupt):
            page.wait_closed()
        if page.page.failure is not None:
            raise DeviceError(page.page.failure)
    finally:
        page.close()
    written = draft.written
    is_saved = draft.written is not original
    if is_saved:
        print(
            f"{command.spec}: {format_count(len(written.regions), 'region')}, "
            f"{format_count(len(written.keep_out), 'keep-out zone')}"
        )
    if draft.taxels:
        print(f"{skin}: {format_count(draft.taxels, 'taxel')}")
    elif not is_saved:
        print("nothing was saved")
    return {
        "skin": str(skin) if draft.taxels else None,
        "spec": str(command.spec),
        "saved": is_saved or bool(draft.taxels),
        "regions": len(written.regions),
        "keep_out": len(written.keep_out),
        "balls": len(page.balls),
    }


def open_page(command: PaintCommand, draft: "SpecDraft") -> "PaintViewer":
    """Serve the surface of the robot, with what the specification holds already."""
    from eskin.design.paint_viewer import PaintViewer
    from eskin.design.painting import find_points, sample_surfaces
    from eskin.design.spec import MAX_BALLS, PER_CM2
    from eskin.page.process import free_port
    from eskin.page.viewer import ViewerConfig
    from eskin.skin import MountedSkin

    config = ViewerConfig(free_port(command.port))
    points = sample_surfaces(draft.robot, command.links)
    original = draft.original
    regions, keep_outs = original.build(PER_CM2)
    zones = [region.zone for region in regions], keep_outs
    existing = np.stack([find_points(points, each) for each in zones])
    used = sum(
        len(zone.balls_mm or ()) for zone in (*original.regions, *original.keep_out)
    )
    mounted = MountedSkin(points, draft.robot)
    room = MAX_BALLS - used
    return PaintViewer(mounted, draft.save, existing, room, draft.place, config)


@final
class SpecDraft:
    """A draft is a specification to which painted balls are added when they are saved.

    Attributes:
        original: specification before anything was painted.
        written: specification as it was saved last; `original` until then.
        taxels: number of taxels of the skin of matrices, once one was saved.
    """

    def __init__(
        self,
        path: Path,
        original: "SpecFile",
        density: float | None,
        robot: Robot,
        skin: Path,
    ) -> None:
        """Start with nothing painted.

        Args:
            path: file that is written.
            original: what it holds already.
            density: density of the painted regions [1/cm2]; None for that of the
                command that designs the skin.
            robot: robot that is painted on.
            skin: folder of the skin of matrices.
        """
        self.path = path
        self.density = density
        self.robot = robot
        self.skin = skin
        self.taxels = 0
        self.placed: dict[PaintOrder, Skin] = {}
        self.original = self.written = original

    def place(self, order: PaintOrder) -> Skin:
        """Return the matrix of an order as a skin of one patch.

        Raises:
            EskinError: it has no room there.
        """
        from eskin.design.placing import MatrixSpec, place_matrix

        if order not in self.placed:
            assert order.matrix is not None
            spec = MatrixSpec(order.link, *order.matrix, order.link, order.p_link)
            self.placed[order] = place_matrix(self.robot, spec)[0]
        return self.placed[order]

    def save(self, orders: tuple[PaintOrder, ...]) -> str:
        """Write what was painted and placed; return a line that says if it could be."""
        from eskin.design.painting import PaintedBall, add_painted
        from eskin.design.spec import PER_CM2, write_spec_file

        balls = [
            PaintedBall(order.link, order.p_link, order.radius, order.keeps_out)
            for order in orders
            if order.matrix is None
        ]
        matrices = [order for order in orders if order.matrix is not None]
        density = None if self.density is None else PER_CM2 * self.density
        entries = add_painted(self.original, balls, density)
        saved = []
        try:
            for order in matrices:
                placed = self.place(order)
                self.taxels = save_matrix(placed, self.skin, self.robot).count
                saved = [str(self.skin)]
            if balls or not matrices:
                write_spec_file(self.path, entries)
                self.written = entries
                saved.append(str(self.path))
        except (OSError, EskinError) as error:
            why = getattr(error, "strerror", None) or error
            return f"not saved: {why}; give another with --spec or --skin"
        return f"saved: {', '.join(saved)}"
