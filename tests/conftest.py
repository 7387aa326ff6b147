"""Shapes and types are checked while the tests run, and only then."""

import os
from pathlib import Path

# Before numpy and torch: tests share the cores, one thread each is fastest.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from jaxtyping import install_import_hook

from helpers.source import MODULES, SOURCE

# The hook would break compiled code, so it skips modules whose names end in kernels.
CHECKED = """
    transforms robot skin touch recording graph model nn learn live drivers stream
    command ur sim demo page viewer
""".split()
install_import_hook(
    [
        ".".join(("eskin", *path.relative_to(SOURCE).with_suffix("").parts))
        for path in MODULES
        if path.relative_to(SOURCE).with_suffix("").parts[0] in CHECKED
        and not path.stem.endswith(("kernels", "__init__"))
    ],
    "beartype.beartype",
)

SHARED = Path(os.environ.get("ESKIN_SHARED", Path(__file__).parents[2] / "shared"))


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


def folder_or_skip(name: str) -> Path:
    folder = SHARED / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set ESKIN_SHARED")
    return folder
