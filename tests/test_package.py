"""Tests of the package: it is built, and works where nothing else of it is."""

import json
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from helpers.live import Press, mounted, record, scans
from lab.build import LEFT_OUT, SMOKE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = tuple(PROJECT["optional-dependencies"])
NOT_NEEDED = (
    "torch",
    "ray",
    "mujoco",
    "playwright",
    "sklearn",
    "matplotlib",
    "trimesh",
    "cyclonedds",
    "foxglove",
    "onnx",
    "onnxruntime",
    "pyarrow",
)
"""Modules without which `eskin run` works."""
FIND = (
    "import importlib.util as u, json; "
    f"print(json.dumps([n for n in {NOT_NEEDED} if u.find_spec(n)]))"
)
"""Code that prints which of them are installed."""


def call(*words, **options):
    done = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build an sdist of a copy of the project, and a wheel of that; return both."""
    folder = tmp_path_factory.mktemp("built")
    copy = folder / "eskin"
    copy.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    leave = shutil.ignore_patterns("__pycache__", "*.egg-info")
    shutil.copytree(ROOT / "src", copy / "src", ignore=leave)
    build = f"import setuptools.build_meta as b; print(b.build_sdist({str(folder)!r}))"
    name = call(sys.executable, "-c", build, cwd=copy).splitlines()[-1]
    words = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir")
    call(sys.executable, "-m", "pip", *words, folder, folder / name)
    [wheel] = folder.glob("*.whl")
    return folder / name, wheel


@pytest.fixture(scope="module")
def environment(built, tmp_path_factory):
    """Install the wheel in a new environment that sees what it needs of this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    target = call(python, "-c", "import sysconfig as s; print(s.get_path('purelib'))")
    words = ("--quiet", "--no-deps", "--no-compile", "--target", target.strip())
    call(sys.executable, "-m", "pip", "install", *words, built[1])
    needed = folder / "needed"
    needed.mkdir()
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        name = path.name.partition(".")[0].partition("-")[0]
        if name not in (*NOT_NEEDED, "eskin", "__editable__"):
            (needed / path.name).symlink_to(path)
    Path(target.strip(), "needed.pth").write_text(str(needed))
    return python


def test_sdist_and_wheel_hold_every_file_of_the_package(built):
    expected = {
        str(path.relative_to(ROOT / "src"))
        for path in (ROOT / "src" / "eskin").rglob("*")
        if path.is_file() and path.suffix not in (".pyc", ".nbc", ".nbi")
    }
    with zipfile.ZipFile(built[1]) as wheel:
        names = set(wheel.namelist())
    assert {name for name in names if name.startswith("eskin/")} == expected
    with tarfile.open(built[0]) as sdist:
        files = {name.partition("/")[2] for name in sdist.getnames()}
    assert {f"src/{name}" for name in expected} <= files
    assert {"README.md", "LICENSE", "pyproject.toml"} <= files


def test_version_is_the_same_everywhere(built):
    stated = PROJECT["version"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    messages = ElementTree.parse(ROOT / "msg" / "eskin_msgs" / "package.xml")
    assert stated == citation["version"] == messages.findtext("version")
    assert stated == version("eskin")
    assert all(f"eskin-{stated}" in path.name for path in built)


def test_installed_wheel_runs_without_what_only_training_needs(environment):
    words = "eskin.app, eskin.live, eskin.stream, eskin.page, eskin.bus, eskin.sim"
    script = f"{FIND}; import {words}; print(eskin.__file__)"
    found, where = call(environment, "-I", "-c", script).splitlines()
    assert found == "[]" and Path(where).is_relative_to(environment.parents[1])
    out = call(environment, "-I", "-m", "eskin.cli.main", "run", "--help")
    assert "--source" in out
    [script] = environment.parents[1].rglob("bin/eskin")
    assert "eskin.__main__" in script.read_text()


@pytest.mark.long
def test_wheel_with_all_that_it_needs_is_small_and_runs(built, tmp_path):
    venv.create(tmp_path, with_pip=True)
    python = tmp_path / "bin" / "python"
    constraints = ("--constraint", ROOT / "constraints.txt")
    call(python, "-m", "pip", "install", "--quiet", *constraints, built[1])
    size = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    assert size < 700e6
    assert call(tmp_path / "bin" / "eskin", "--version").startswith("eskin ")
    assert not set(json.loads(call(python, "-c", FIND))) & set(NOT_NEEDED[:4])
    path = tmp_path / "touched.mcap"
    stream = scans(mounted(), [Press(2.3, 2.7, 65, 65)], 50, 3.5)
    record(path, mounted(), stream)
    words = ("run", "--source", f"replay:{path}", "--pace", "20", "--json")
    out = call(tmp_path / "bin" / "eskin", *words)
    assert json.loads(out.splitlines()[-1])["readings"] == len(stream)


def read_pins():
    """Return the versions of the lock, by normalized name."""
    lines = (ROOT / "constraints.txt").read_text().split()
    pairs = (line.split("==") for line in lines)
    return {canonicalize_name(name): version for name, version in pairs}


def find_requirements(wanted, found):
    """Collect all that a requirement needs, with what its extras need."""
    requirement = Requirement(wanted)
    key = canonicalize_name(requirement.name), tuple(sorted(requirement.extras))
    if key in found:
        return
    found[key] = requirement
    if requirement.name == "torch":
        return  # What it needs differs from build to build: those for GPUs need CUDA.
    try:
        needs = requires(requirement.name) or []
    except PackageNotFoundError:
        return
    for each in map(Requirement, needs):
        extras = requirement.extras or {""}
        if each.marker is None or any(
            each.marker.evaluate({"extra": e}) for e in extras
        ):
            find_requirements(str(each), found)


@pytest.mark.parametrize("name", ["", *EXTRAS])
def test_lock_pins_all_that_the_core_and_each_extra_need(name):
    """From the package index alone: a version each, and no path or address."""
    pins = read_pins()
    found = {}
    find_requirements(f"eskin[{name}]" if name else "eskin", found)
    assert {key for key, _ in found} - {"eskin", "setuptools"} <= set(pins)
    for (key, _), requirement in found.items():
        if key in pins:
            assert requirement.specifier.contains(pins[key], prereleases=True)


def test_build_tries_the_core_and_every_extra():
    assert set(SMOKE) == {"core", *EXTRAS} - set(LEFT_OUT)
