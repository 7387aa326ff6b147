"""This module compiles functions with numba, and keeps what was compiled on disk.

Numba compiles a kept function again only when its own source file has changed; a
change in a file that it calls into goes unnoticed. Here every kept function carries a
digest of all modules of kernels, so that a change in any of them compiles all anew.
"""

import hashlib
from functools import cache, partial
from pathlib import Path
from typing import Any

from numba import njit

PACKAGE = Path(__file__).parent


def compiled(function: Any = None, /, **options: Any) -> Any:  # noqa: ANN401
    """Compile a function, without holding the GIL while it runs.

    Used as `@compiled`, or with further options of `numba.njit` as
    `@compiled(error_model="numpy")`.
    """
    if function is None:
        return partial(compiled, **options)
    dispatcher = njit(cache=True, nogil=True, **options)(function)
    # Numba has no public way to say what else a cached function depends on.
    file = dispatcher._cache._cache_file
    file._source_stamp = (file._source_stamp, digest_sources())
    return dispatcher


@cache
def digest_sources() -> str:
    """Return a digest of all modules that hold compiled functions."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*kernels.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
