"""This module compiles functions with numba, and keeps what was compiled on disk.

Numba compiles a kept function again only when its own source file has changed; a
change in a file that it calls into, or takes a constant from, goes unnoticed. Here
every kept function carries a digest of its module, of all modules of eskin that this
one imports, and of those that imported kernels import, at any depth.
"""

import hashlib
import logging
import re
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, final
from uuid import uuid4

from numba import njit
from numba.core.event import Event, Listener, register

PACKAGE = Path(__file__).parent
IMPORTS = re.compile(r"^from eskin\.([\w.]+) import", re.MULTILINE)
"""How a module of kernels imports others; never a package, whose file defines
nothing."""

Parameters = TypeVar("Parameters", bound=tuple)

logger = logging.getLogger(__name__)


@final
class CompilationReporter(Listener):
    """Logs once in a process that code is compiled, and how long that may take.

    Code that is ready on disk is loaded without an event.

    Attributes:
        reported: whether it has been logged.
    """

    def __init__(self) -> None:
        """Report the first compilation."""
        self.reported = False

    def on_start(self, event: Event) -> None:
        """Report the beginning of a compilation."""
        if not self.reported:
            self.reported = True
            logger.info(
                "compiling code, which is then kept on disk; the first time this takes "
                "a minute or two"
            )

    def on_end(self, event: Event) -> None:
        """Do nothing."""


register("numba:compile", CompilationReporter())


def compiled(function: Any = None, /, **options: Any) -> Any:  # noqa: ANN401
    """Compile a function, without holding the GIL while it runs.

    Used as `@compiled`, or with further options of `numba.njit` as
    `@compiled(error_model="numpy")`.
    """
    if function is None:
        return partial(compiled, **options)
    dispatcher = njit(cache=True, nogil=True, **options)(function)
    # Numba has no public way to say what else a cached function depends on. The digest
    # is part of the names, so that no file of other sources is opened: it may refer to
    # types whose modules have moved, which numba cannot read.
    file = dispatcher._cache._cache_file  # type: ignore[attr-defined]
    digest = digest_sources(Path(function.__code__.co_filename))[:16]
    index = Path(file._index_path)
    file._index_path = str(index.with_name(f"{index.stem}.{digest}.nbi"))
    # Numba counts its files of code from 1. Where two processes compile at once, each
    # would write its own code to the same file, and calls of the one run that of the
    # other: of other types, which ends in wrong results or a crash.
    file._data_name = lambda number: f"{index.stem}.{digest}.{uuid4().hex}.nbc"
    return dispatcher


@cache
def digest_sources(path: Path) -> str:
    """Return a digest of a module of kernels and of the modules that it imports."""
    text = path.read_text(encoding="utf-8")
    digest = hashlib.sha256(text.encode())
    for name in IMPORTS.findall(text):
        imported = PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
        if name.endswith("kernels"):
            digest.update(digest_sources(imported).encode())
        else:
            digest.update(imported.read_bytes())
    return digest.hexdigest()


def build_parameters(
    kind: type[Parameters],
    *configs: Any,  # noqa: ANN401
    **values: Any,  # noqa: ANN401
) -> Parameters:
    """Build a named tuple that compiled code takes, field by field by its name.

    Args:
        kind: the class of the tuple.
        configs: objects that have the fields as attributes; the first one counts.
        values: fields that none of them has.
    """
    for name in kind.__annotations__:
        if name not in values:
            sources = (
                getattr(config, name) for config in configs if hasattr(config, name)
            )
            values[name] = next(sources)
    return kind(**values)


compiled_fastmath = compiled(
    error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"}
)
"""Decorator like `compiled` for loops whose sums may be reordered.

NaN and infinity keep their meaning."""
