"""Build wheel and sdist, and try each where nothing else is installed.

python -m lab.build [--only core parquet ...]: builds into dist/, then makes an
environment for the core and one for each extra, installs the wheel there from the
package index with the versions of constraints.txt, and runs the commands of SMOKE in an
empty folder. Prints the size of each environment.

The commands of the core are tried first. What they compile goes into the wheel, so that
a first start with the same Python, numba and level of processor compiles nothing
(`eskin.compiled`).
"""

import base64
import hashlib
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

from eskin.errors import EskinError
from lab.program import run_program
from lab.tables import format_head, format_row

ROOT = Path(__file__).parents[1]
RECORDING = ROOT / "tests" / "data" / "before" / "recording.mcap"
SMOKE = {
    "core": (
        "python -c 'import eskin; eskin.load_skin(\"ur5\")'",
        "eskin doctor",
        "eskin replay {recording}",
        "eskin report {recording} --out report.html",
        "eskin demo --headless --seconds 5",
    ),
    "train": ("eskin skin show ur5 --out ur5.png", "eskin evaluate ur5 {recording}"),
    "sim": ("eskin demo --headless --seconds 2 --dynamics",),
    "models": ("python -c 'import trimesh, collada'",),
    "design": (
        "eskin skin place {urdf} --link link --rows 4 --columns 4 --pitch-mm 8 -o skin",
    ),
    "ur": ("python -c 'import rtde_control, rtde_receive, eskin.arms.ur_arm'",),
    "ros2": ("eskin run --source replay:{recording} --pace inf --ros2",),
    "foxglove": (
        "eskin run --source replay:{recording} --pace inf --foxglove --foxglove-port 0",
    ),
    "export": ("eskin export ur5 --onnx ur5.onnx",),
    "parquet": (
        "eskin export {recording} --parquet tables",
        "eskin export {recording} --lerobot lerobot",
    ),
    "scale": ("python -c 'import ray, eskin.sim.dataset.cluster'",),
}
"""Commands of the core, and one or two of each extra."""
LEFT_OUT = ("dev",)
"""Extras that are for clones."""
URDF = """<robot name="box"><link name="link"><collision><geometry>
<box size="0.1 0.1 0.1"/></geometry></collision></link></robot>"""


@dataclass(frozen=True)
class Command:
    """Build wheel and sdist, and try core and extras each in an environment."""

    only: tuple[str, ...] = ()
    """Parts that are tried: core, or extras; all unless given."""

    out: Path = ROOT / "dist"
    """Folder of wheel and sdist."""


def run(command: Command) -> dict[str, object]:
    """Build and try; raise where a command fails."""
    names = command.only or tuple(SMOKE)
    if unknown := set(names) - set(SMOKE):
        raise EskinError(
            f"--only is {' '.join(sorted(unknown))}; allowed are {', '.join(SMOKE)}"
        )
    wheel = build(command.out)
    with tempfile.TemporaryDirectory() as folder:
        try_extra("core", wheel, Path(folder))
        [package] = Path(folder).glob("env/lib/python*/site-packages/eskin")
        carry_code(wheel, package)
    print(f"with compiled code {wheel.stat().st_size / 1e6:.1f} MB")
    sizes: dict[str, object] = {"wheel": wheel.stat().st_size / 1e6}
    print(format_head(("environment", "MB", "commands", "seconds")))
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            size, seconds = try_extra(name, wheel, Path(folder))
        sizes[name] = size
        cells = name, f"{size:.0f}", f"{len(SMOKE[name])}", f"{seconds:.0f}"
        print(format_row(cells), flush=True)
    return sizes


def build(out: Path) -> Path:
    """Build sdist and, from that, the wheel; return the wheel."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    code = f"import setuptools.build_meta as b; print(b.build_sdist({str(out)!r}))"
    name = call([sys.executable, "-c", code], ROOT).splitlines()[-1]
    words = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out)]
    call([sys.executable, *words, str(out / name)], out)
    [wheel] = out.glob("*.whl")
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, and {name}")
    return wheel


def carry_code(wheel: Path, package: Path) -> None:
    """Add the compiled code of an installed package to the wheel, and to its record."""
    with ZipFile(wheel) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    [record] = [name for name in parts if name.endswith(".dist-info/RECORD")]
    listed = parts.pop(record).decode()
    for path in sorted(package.rglob("__pycache__/*.nb[ci]")):
        name = path.relative_to(package.parent).as_posix()
        data = path.read_bytes()
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode()
        listed += f"{name},sha256={digest.rstrip('=')},{len(data)}\n"
        parts[name] = data
    parts[record] = listed.encode()
    with ZipFile(wheel, "w", ZIP_DEFLATED) as new:
        for name, data in parts.items():
            new.writestr(name, data)


def try_extra(name: str, wheel: Path, folder: Path) -> tuple[float, float]:
    """Install the wheel with an extra, and run its commands.

    Returns:
        Size of the environment [MB], and time that the commands took [s].
    """
    venv.create(folder / "env", with_pip=True)
    python = folder / "env" / "bin" / "python"
    work = folder / "work"
    work.mkdir()
    (work / "box.urdf").write_text(URDF)
    pip = [str(python), "-m", "pip", "install", "--quiet"]
    pip += ["--constraint", str(ROOT / "constraints.txt")]
    wanted = str(wheel) if name == "core" else f"{wheel}[{name}]"
    call([*pip, wanted], work)
    libraries = (folder / "env" / "lib").rglob("*")
    size = sum(path.stat().st_size for path in libraries if path.is_file())
    start = time.monotonic()
    for line in SMOKE[name]:
        words = line.format(recording=RECORDING, urdf="box.urdf")
        call(["sh", "-c", f'PATH="{python.parent}:$PATH" {words}'], work)
    return size / 1e6, time.monotonic() - start


def call(words: list[str], folder: Path) -> str:
    """Run a program in a folder without the paths of this one; return its output."""
    done = subprocess.run(
        ["env", "-u", "PYTHONPATH", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = "\n".join((done.stderr or done.stdout).splitlines()[-15:])
        raise EskinError(f"{' '.join(words)} failed with {done.returncode}: {last}")
    return done.stdout


if __name__ == "__main__":
    raise SystemExit(run_program(run))
