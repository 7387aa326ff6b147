"""This module finds the folders in which compiled code is kept.

Code is read from whichever folder has it, and written to the first that can be written.
"""

import logging
import os
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from numba import config

logger = logging.getLogger(__name__)


@cache
def list_places(source: Path) -> tuple[Path, ...]:
    """Return the folders that may keep the code of a folder of sources.

    The first is that of `NUMBA_CACHE_DIR`, if it is set. The next is beside the
    sources, where a wheel carries code that is ready. The last is the user's own, if
    there is one.
    """
    settings: object = config  # whose names are made at its import
    given = getattr(settings, "CACHE_DIR", "")
    own = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    places = [source / "__pycache__"]
    if given:
        places.insert(0, Path(given).absolute() / "eskin")
    if own.is_absolute():
        places.append(own / "eskin")
    return tuple(places)


def find_writable(places: Sequence[Path]) -> Path | None:
    """Return the first of some folders that can be written; None if there is none."""
    for place in places:
        try:
            place.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=place).close()
        except OSError:
            continue
        return place
    return None


@cache
def tell_unkept() -> None:
    """Tell once that compiled code is not kept, and the remedy."""
    logger.warning(
        "compiled code is not kept, so that every start compiles for a minute: neither "
        "the folder of eskin nor the user's ~/.cache can be written; set "
        "NUMBA_CACHE_DIR to a folder that can"
    )
