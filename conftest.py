"""Shapes and types are checked while the tests run, and only then."""

import gc
import os
import re
import runpy
import sys
from pathlib import Path

# Before numpy and torch: tests share the cores, one thread each is fastest.
os.environ.setdefault("OMP_NUM_THREADS", "1")
gc.disable()  # while modules are imported: a seventh of that time

import jaxtyping
import pytest
from hypothesis import settings

from helpers.checking import begin_test, check_some
from helpers.examples import EXAMPLES
from helpers.source import MODULES, name_module

# Modules that name no shape are left to pyright.
CHECKED = {name_module(path) for path in MODULES if "jaxtyping" in path.read_text()}
# The hook would break compiled code.
COMPILED = {name for name in CHECKED if name.endswith(("kernels", "__init__"))}
# The hook decorates with what it finds under this name.
jaxtyping.jaxtyped = check_some
jaxtyping.install_import_hook(sorted(CHECKED - COMPILED), "beartype.beartype")

# No example fails because the computer is busy.
settings.register_profile("untimed", settings.default, deadline=None)
settings.load_profile("untimed")

COMPILES_ALL = "test_cli_doctor.py"
CALLS_KERNELS = re.compile(
    r"eskin\.(app|cli|learn|live|page\.viewer|sim\.(bench|demo|interactive)|stream)\b|"
    r"from eskin import|helpers\.(devices|graphs|learning|live)|from lab"
)
"""Imports of test files that need the recogniser, whose code compiles for minutes."""
LONGEST = (
    "test_shipped_weights.py",
    "test_cli_export.py",
    "test_page_browser.py",
    "test_examples.py",
    "test_learn_processes.py",
)
"""Test files that a worker begins early: the others would wait for its end."""

LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface name="lo" multicast="true"/>'
    "</Interfaces></General></Domain></CycloneDDS>"
)
"""Settings of Cyclone DDS that keep its messages on this computer."""

SHARED = Path(os.environ.get("ESKIN_SHARED", Path(__file__).parents[1] / "shared"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker compile all code while the others run files that need none.

    Then the longest come first.
    """
    paths = {item.path for item in items}
    places = {
        path: (
            path.name != COMPILES_ALL,
            bool(CALLS_KERNELS.search(path.read_text())),
            path.name not in LONGEST,
        )
        for path in paths
    }
    items.sort(key=lambda item: places[item.path])


def pytest_collection_finish() -> None:
    """Collect garbage rarely, and never among the modules: a tenth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


def pytest_runtest_setup() -> None:
    begin_test()


@pytest.fixture(scope="session")
def sleeve_folder() -> Path:
    """The public sleeve recordings, or a skip that says where they were sought."""
    return folder_or_skip("sleeve")


@pytest.fixture(scope="session")
def shearsense_folder() -> Path:
    """The public ShearSense recordings, or a skip that says where they were sought."""
    return folder_or_skip("shearsense")


@pytest.fixture(scope="session")
def socialtouch_folder() -> Path:
    """The public SocialTouch recordings, or a skip that says where they were sought."""
    return folder_or_skip("socialtouch")


@pytest.fixture
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a training be validated, and its last layer fitted, on few windows."""
    monkeypatch.setattr("eskin.learn.training.VALIDATION_WINDOWS", 32)
    monkeypatch.setattr("eskin.learn.last_layer.WINDOWS", 256)


@pytest.fixture
def run_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Run an example as a program; return its exit code, text and error."""

    def run(name: str, *words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", [name, *map(str, words)])
        code = 0
        try:
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        except SystemExit as stop:
            code = int(stop.code or 0)
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep ROS 2 to this computer, and apart from other tests."""
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 200))


def folder_or_skip(name: str) -> Path:
    folder = SHARED / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set ESKIN_SHARED")
    return folder
