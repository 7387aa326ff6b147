"""Measure `eskin skin check` and `skin design` on meshes of the largest size.

    python -m lab.large_meshes

The mesh is a ball of 641,600 triangles in a binary STL of 32 MB, once in metres and
once in millimetres. Each command runs in a process of its own that may address 8 GB.
"""

import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from time import monotonic

import numpy as np

from eskin.robot import Sphere, build_shape_mesh
from eskin.skin import Dome, Patch, TaxelGrid, build_skin, save_skin
from lab.program import run_program
from lab.tables import format_head, format_row

RADIUS, SEGMENTS = 0.1, 802
"""Radius of the ball [m], and number of corners around it."""
SIDE, PITCH = 20, 0.003
"""Rows and columns of the patch that is checked, and their distance [m]."""
MEMORY = 8_000_000_000
"""Largest address space of a process [bytes]."""
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


@dataclass(frozen=True)
class LargeMeshesCommand:
    """Measure time, memory and message of the commands that use meshes."""

    density: float = 1.0
    """Density of the skin that is designed [1/cm2]."""


def write_ball(folder: Path, scale: float) -> Path:
    """Write the URDF of a ball with its mesh, and return its path."""
    mesh = build_shape_mesh(Sphere(scale * RADIUS), SEGMENTS)
    data = np.zeros(len(mesh.faces), STL)
    data["corners"] = mesh.vertices[mesh.faces]
    head = bytes(80) + len(data).to_bytes(4, "little")
    (folder / "ball.stl").write_bytes(head + data.tobytes())
    path = folder / "ball.urdf"
    path.write_text(
        '<robot name="ball"><link name="ball"><collision><geometry>'
        '<mesh filename="ball.stl"/></geometry></collision></link></robot>'
    )
    return path


def write_skin(folder: Path) -> None:
    """Write a skin of one patch on the top of the ball in metres."""
    patch = Patch("top", "ball", 1, SIDE, SIDE)
    grid = TaxelGrid(SIDE, SIDE, PITCH, PITCH)
    save_skin(build_skin("top", [(patch, grid, Dome(RADIUS, np.eye(4)))]), folder)


def measure(*words: str) -> tuple[float, float, int, str]:
    """Run a command of eskin; return seconds, MB, exit code and its last line."""
    with TemporaryFile() as output:
        start = monotonic()
        child = subprocess.Popen(
            [sys.executable, "-m", "eskin", *words],
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        resource.prlimit(child.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = monotonic() - start
        output.seek(0)
        lines = output.read().decode().splitlines()
    return seconds, usage.ru_maxrss * 1024 / 1e6, child.returncode, lines[-1]


def run(command: LargeMeshesCommand) -> dict[str, object]:
    """Print a row for each mesh and command."""
    rows = []
    names = ["mesh", "command", "s", "MB", "exit code", "last line"]
    print(format_head(names))
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_skin(folder / "top")
        for unit, scale in (("metres", 1.0), ("millimetres", 1e3)):
            urdf = str(write_ball(folder, scale))
            density = f"{command.density:g}"
            for words in (
                ("check", str(folder / "top"), "--robot", urdf),
                ("design", urdf, "--out", str(folder / unit), "--density", density),
            ):
                seconds, memory, code, line = measure("skin", *words)
                line = line.replace(f"{folder}/", "")
                cells = [f"{seconds:.1f}", f"{memory:.0f}", str(code), line]
                rows.append(dict(zip(names, [unit, words[0], *cells], strict=True)))
                print(format_row([unit, f"skin {words[0]}", *cells]), flush=True)
    return {"rows": rows}


if __name__ == "__main__":
    sys.exit(run_program(run))
