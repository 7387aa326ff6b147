"""This module compiles entries, functions that Python calls, by private parts of numba.

An entry gets machine code, and a wrapper that takes Python's objects apart. A function
that compiled code calls gets neither, be it of numba itself: its code is linked into
each entry that needs it, which is optimised as a whole, once. Numba would optimise,
compile and keep every function that way, which takes twice as long.

Numba changes its private parts without notice. They are used as they were in the
releases of `TRIED`; the module cannot be imported with others, nor where a part is
missing.
"""

import contextlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, cast, final, no_type_check
from uuid import uuid4

import numba
import scipy
from numba import njit, types
from numba.core.caching import IndexDataCacheFile, NullCache
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from numba.core.targetconfig import TargetConfig

from eskin.places import list_places, tell_unkept

TRIED = ((0, 61), (0, 68))
"""Oldest and latest release of numba that were tried."""
PARTS: dict[Any, tuple[str, ...]] = {
    CPUContext: ("create_cfunc_wrapper", "get_executable"),
    CompileResult: ("_rebuild", "_reduce"),
    CompilerBase: ("_compile_core",),
    Dispatcher: ("get_call_template", "get_overload"),
    IndexDataCacheFile: ("_data_name", "_load_index", "load", "save"),
    JITCPUCodegen: ("_library_class", "magic_tuple"),
    JITCodeLibrary: ("_get_module_for_linking", "finalize", "has_dynamic_globals"),
    TargetConfig: ("options", "values"),
}
"""Parts of numba that are used, beside what the imports name."""


def check_numba() -> None:
    """Raise unless numba is as it was tried.

    Raises:
        ImportError: it is another release, or a part is missing.
    """
    release = tuple(map(int, re.findall(r"\d+", numba.__version__)[:2]))
    if not TRIED[0] <= release <= TRIED[1]:
        oldest, latest = (".".join(map(str, each)) for each in TRIED)
        raise ImportError(f"{oldest} to {latest} were tried")
    for owner, names in PARTS.items():
        for name in names:
            if not hasattr(owner, name):
                raise ImportError(f"it has no {owner.__name__}.{name}")


check_numba()


@cache
def list_defaults(kind: type[TargetConfig]) -> dict[str, Any]:
    """Return the default of each of numba's flags."""
    return {name: option.default for name, option in kind.options.items()}


def list_flags(flags: TargetConfig) -> dict[str, Any]:
    """Return numba's flags, as `TargetConfig.values` does, but fast."""
    return list_defaults(type(flags)) | flags._values


# Numba compares them at each call of a function that it resolves, for a sixth of the
# time that compiling takes.
TargetConfig.values = list_flags  # type: ignore[method-assign]


def import_blas() -> None:
    """Import scipy's BLAS, which numba calls, without the rest of `scipy.linalg`.

    That takes a tenth of the time in which a command starts, and 15 MB. Whoever imports
    it later gets the whole.
    """
    package = "scipy.linalg"
    if package in sys.modules:
        return
    bare = ModuleType(package)
    bare.__path__ = [str(Path(scipy.__path__[0]) / "linalg")]
    sys.modules[package] = bare
    try:
        import_module(f"{package}.cython_blas")
    finally:
        del sys.modules[package]


import_blas()


class PartLibrary(JITCodeLibrary):
    """The code of a function that only compiled code calls, which is linked into that.

    Numba's own library optimises it and makes machine code of it first.
    """

    def finalize(self) -> None:
        """Link what the function calls."""
        for library in self._linking_libraries:
            module = library._get_module_for_linking()
            self._final_module.link_in(module, preserve=True)
        self._finalized = True


@no_type_check
class EntryCompiler(CompilerBase):
    """Compiles a function that Python calls.

    All that it calls, functions of numba as well, becomes a part of it.
    """

    def define_pipelines(self) -> list:
        """Return numba's usual passes."""
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]

    def _compile_core(self) -> Any:  # noqa: ANN401
        """Run the passes while numba makes parts of all other functions."""
        state = self.state
        context = cast(Any, cpu_target.target_context)
        codegen = context.codegen()
        state.library = codegen.create_library(state.func_id.func_qualname)
        state.library.enable_object_caching()
        codegen._library_class = PartLibrary
        # Numba knows functions by what Python calls: any function of its own will do.
        context.get_executable = lambda *_: [].append
        context.create_cfunc_wrapper = lambda *_: None
        try:
            return super()._compile_core()
        finally:
            del codegen._library_class
            del context.get_executable, context.create_cfunc_wrapper


@final
class CodeFile(IndexDataCacheFile):
    """Keeps the code of a function in one folder, an index and a file for each type."""

    def __init__(self, place: Path, name: str) -> None:
        """Open nothing yet."""
        super().__init__(str(place), name, "")
        self.place = place
        self.name = name

    def _data_name(self, number: int) -> str:
        """Return the name of a new file.

        Numba counts its files of code from 1. Where two processes compile at once, each
        would write its own code to the same file, and calls of the one run that of the
        other: of other types, which ends in wrong results or a crash.
        """
        return f"{self.name}.{uuid4().hex}.nbc"


@final
@no_type_check
class CodeStore(NullCache):
    """Keeps the code of an entry on disk, as numba's own cache does.

    The digest of the sources is part of the names of its files, so that none of other
    sources is opened: it may refer to types whose modules have moved, which numba
    cannot read.
    """

    def __init__(self, function: Callable, digest: str) -> None:
        """Open nothing yet."""
        code = function.__code__
        source = Path(code.co_filename)
        own = re.sub("[<>]", "", function.__qualname__)
        version = f"py{sys.version_info.major}{sys.version_info.minor}"
        place = f"{own}-{code.co_firstlineno}"
        self.name = f"{source.stem}.{place}.{version}.{digest}"
        self.places = list_places(source.parent)

    @property
    def cache_path(self) -> str:  # type: ignore[override]
        """Folder to which code is written first."""
        return str(self.places[0])

    @cached_property
    def files(self) -> tuple[CodeFile, ...]:
        """Files of each folder that may keep the code."""
        return tuple(CodeFile(place, self.name) for place in self.places)

    def load_overload(  # type: ignore[override]
        self,
        sig: Any,  # noqa: ANN401
        target_context: Any,  # noqa: ANN401
    ) -> CompileResult | None:
        """Load the code for some types; return None where it is not kept."""
        # The rest of what numba gets ready is for compiling: 0.2 s and 40 MB.
        rtsys.initialize(target_context)
        key = (sig, target_context.codegen().magic_tuple())
        for file in self.files:
            data = None
            with contextlib.suppress(OSError):
                data = file.load(key)
            if data is not None:
                return CompileResult._rebuild(target_context, *data)
        return None

    def save_overload(self, sig: Any, cres: CompileResult) -> None:  # noqa: ANN401
        """Keep the code for some types where that is possible; else tell so, once."""
        # Addresses of this process are part of it.
        if cres.library.has_dynamic_globals:
            return
        key = (sig, cres.codegen.magic_tuple())
        reduced = cres._reduce()
        for file in self.files:
            try:
                os.makedirs(file.place, exist_ok=True)
                file.save(key, reduced)
            except OSError:
                continue
            return
        tell_unkept()

    def iterate_keys(self) -> Iterator[tuple]:
        """Yield the types and the processor of each code that is kept."""
        for file in self.files:
            with contextlib.suppress(OSError):
                yield from file._load_index()


@no_type_check
def compile_entry(function: Callable, digest: str, options: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return a function that is compiled when it is called first.

    Args:
        function: function that Python or compiled code calls.
        digest: digest of all that its code depends on.
        options: further options of `numba.njit`.
    """
    options = options | {"no_cfunc_wrapper": True}
    entry = njit(pipeline_class=EntryCompiler, **options)(function)
    part = njit(no_cpython_wrapper=True, **options)(function)

    def get_call_template(args: Any, kws: Any) -> Any:  # noqa: ANN401
        # Else a constant argument makes a function of its own.
        return part.get_call_template(tuple(map(types.unliteral, args)), kws)

    # By these, numba finds what a call in compiled code runs.
    entry.get_call_template = get_call_template
    entry.get_overload = part.get_overload
    entry._cache = CodeStore(function, digest)
    return entry
