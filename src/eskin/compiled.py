"""This module compiles functions with numba, and keeps what was compiled on disk.

Numba compiles a kept function again only when its own source file has changed; a
change in a file that it calls into, or takes a constant from, goes unnoticed. Here
every kept function carries a digest of its module, of all modules of eskin that this
one imports, and of those that imported kernels import, at any depth. `digest_code` does
so for any module, by which other kept results can be told stale.

Entries, which Python calls, are compiled by `eskin.entries`. With a release of numba
that this was not tried with, numba compiles by itself, which takes a minute instead of
13 s.

On a processor of the level x86-64-v3, as nearly all since 2015 are, code is compiled
for that level, so that wheels can carry it (`lab.build`). What was compiled for another
processor, Python or numba, or from other sources, is compiled again.

`pack` hands tuples of arrays to compiled code once instead of at every call: handing
over an array costs 0.2 us and handing one back 0.8 us, and a recogniser's step needs a
hundred of them. Within compiled code they are then read one by one, where needed.
"""

import ast
import hashlib
import logging
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, final, no_type_check

import numba
from llvmlite import binding
from numba import config, njit, types
from numba.core.cgutils import gep_inbounds
from numba.core.datamodel import models
from numba.core.event import Event, Listener, register
from numba.core.imputils import impl_ret_borrowed, lower_getattr, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.experimental import structref
from numba.extending import register_model

from eskin.places import find_writable, list_places, tell_unkept

PACKAGE = Path(__file__).parent
ENTRIES = PACKAGE / "entries.py"
IMPORTS = re.compile(r"^from eskin\.([\w.]+) import", re.MULTILINE)
"""How a module of kernels imports others; never a package, whose file defines
nothing."""

LEVEL = "x86-64-v3"
LEVEL_FEATURES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
"""What distinguishes a processor of that level."""

REPORT_SECONDS = 5.0
"""Time between two reports of how far compiling has come [s]."""

OWN = "eskin"
"""How the names of modules begin whose compilation is reported, plugins included."""

logger = logging.getLogger(__name__)


def choose_processor() -> None:
    """Let numba compile for `LEVEL` on such a processor, unless told otherwise."""
    settings: Any = config  # whose names are made at its import
    features = binding.get_host_cpu_features()
    is_level = all(features.get(name) for name in LEVEL_FEATURES)
    if is_level and settings.CPU_NAME is None and settings.CPU_FEATURES is None:
        settings.CPU_NAME = LEVEL
        settings.CPU_FEATURES = ""


choose_processor()

try:
    from eskin import entries
except ImportError as error:
    entries = None
    logger.warning(
        "numba %s is not as eskin knows it (%s): compiling takes a minute instead of "
        "13 s; install one that was tried",
        numba.__version__,
        error,
    )


@final
class CompilationReporter(Listener):
    """Logs that code is compiled, how long that may take, and how far it has come.

    Code that is ready on disk is loaded without an event. Functions of other packages
    are not reported.

    Attributes:
        count: number of entries that were compiled, or are being compiled.
        depth: number of functions that are being compiled, each for the one before.
        begin: time of the first report [s].
        last: time of the last report [s].
    """

    def __init__(self) -> None:
        """Report the first compilation."""
        self.count = self.depth = 0
        self.begin = self.last = 0.0

    def on_start(self, event: Event) -> None:
        """Report the first compilation, and a later one after a while."""
        self.depth += 1
        facts: Any = event.data
        module = facts["dispatcher"].py_func.__module__
        if self.depth > 1 or not module.startswith(OWN):
            return
        self.count += 1
        if self.count == 1:
            self.begin = self.last = time.monotonic()
            # A warning, since Python shows no less where nothing is configured.
            logger.warning(
                "compiling code that is not kept on disk yet, and keeping it; this may "
                "take up to a minute"
            )
        elif time.monotonic() - self.last >= REPORT_SECONDS:
            self.last = time.monotonic()
            logger.info("still compiling, for %.0f s so far", self.last - self.begin)

    def on_end(self, event: Event) -> None:
        """Forget the function that was compiled."""
        self.depth -= 1


register("numba:compile", CompilationReporter())


def compiled(function: Any = None, /, **options: Any) -> Any:  # noqa: ANN401
    """Compile a function, without holding the GIL while it runs.

    Used as `@compiled`, or with further options of `numba.njit` as
    `@compiled(error_model="numpy")`.
    """
    if function is None:
        return partial(compiled, **options)
    digest = digest_sources(Path(function.__code__.co_filename))[:16]
    return compile_function(function, digest, options | {"nogil": True})


def compile_function(function: Any, digest: str, options: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return a function that is compiled when it is called first.

    `NUMBA_DISABLE_JIT`, by which people debug functions of their own, does not count:
    as Python, the functions of eskin would take a thousand times as long.
    """
    compile_it = compile_plainly if entries is None else entries.compile_entry
    if not getattr(config, "DISABLE_JIT", 0):
        return compile_it(function, digest, options)
    with enabled_jit():
        dispatcher = compile_it(function, digest, options)
    dispatcher.compile = enabled_jit()(dispatcher.compile)
    return dispatcher


@contextmanager
def enabled_jit() -> Iterator[None]:
    """Let numba compile, whatever `NUMBA_DISABLE_JIT` says."""
    settings: Any = config
    settings.DISABLE_JIT = 0
    try:
        yield
    finally:
        settings.DISABLE_JIT = 1


def compile_plainly(function: Any, digest: str, options: dict[str, Any]) -> Any:  # noqa: ANN401
    """Let numba compile a function by itself, and keep it in a folder of its digest."""
    source = Path(function.__code__.co_filename).parent
    place = find_writable(list_places(source))
    if place is None:
        tell_unkept()
        return njit(**options)(function)
    settings: Any = config
    given = settings.CACHE_DIR
    settings.CACHE_DIR = str(place / digest)
    try:
        return njit(cache=True, **options)(function)
    finally:
        settings.CACHE_DIR = given


def is_kept(function: Any) -> bool:  # noqa: ANN401
    """Tell whether code of a compiled function for this processor is on disk.

    Where numba compiles by itself it counts as kept, since two processes must not
    compile at once then.
    """
    if entries is None:
        return True
    target = function.targetctx.codegen().magic_tuple()
    return any(target in key for key in function._cache.iterate_keys())


@cache
def digest_sources(path: Path) -> str:
    """Return a digest of a module of kernels and of the modules that it imports."""
    text = path.read_text(encoding="utf-8")
    digest = hashlib.sha256(ENTRIES.read_bytes() + text.encode())
    if path == Path(__file__):  # `pack` takes tuples of all modules of kernels.
        for kernels in sorted(PACKAGE.rglob("*_kernels.py")):
            digest.update(digest_sources(kernels).encode())
    for name in IMPORTS.findall(text):
        imported = PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
        if name.endswith("kernels"):
            digest.update(digest_sources(imported).encode())
        else:
            digest.update(imported.read_bytes())
    return digest.hexdigest()


compiled_fastmath = compiled(
    error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"}
)
"""Decorator like `compiled` for loops whose sums may be reordered.

NaN and infinity keep their meaning."""


@cache
def digest_code(module: str) -> str:
    """Return a digest of a module and of all that it imports from eskin.

    A module of another package counts with what it imports from that package as well.
    Comments, docstrings and layout do not count, nor what is imported from elsewhere.
    Data files are not read.

    Args:
        module: dotted name, such as `eskin.learn.dataset`.

    Raises:
        ValueError: there is no such module.
    """
    digest = hashlib.sha256()
    for name in sorted(imported_modules(module)):
        digest.update(f"{name}\n{digest_source(name)}\n".encode())
    return digest.hexdigest()


def imported_modules(module: str) -> set[str]:
    """Return a module, and the modules of its package and of eskin that it imports."""
    packages = {"eskin", module.split(".", 1)[0]}
    found = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            imports = direct_imports(name)
            waiting += [each for each in imports if each.split(".", 1)[0] in packages]
    return found


@cache
def direct_imports(module: str) -> tuple[str, ...]:
    """Return the modules that one imports itself, of packages whose code is found."""
    names = []
    for node in ast.walk(parse_module(module)):
        if isinstance(node, ast.ImportFrom) and node.module:
            # What is imported may be a module itself.
            names += [node.module, *(f"{node.module}.{n.name}" for n in node.names)]
        elif isinstance(node, ast.Import):
            names += [each.name for each in node.names]
    return tuple(name for name in names if find_source(name) is not None)


@cache
def digest_source(module: str) -> str:
    """Return a digest of one module without its docstrings."""
    tree = parse_module(module)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            kept = [statement for statement in body if not is_text(statement)]
            node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def is_text(statement: ast.AST) -> bool:
    """Tell whether a statement is nothing but a string."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def parse_module(module: str) -> ast.Module:
    """Return the syntax tree of a module."""
    path = find_source(module)
    if path is None:
        raise ValueError(f"no module '{module}'; allowed are modules with Python code")
    return ast.parse(path.read_bytes())


def find_source(module: str) -> Path | None:
    """Return the file of a module; None if there is none."""
    first, *rest = module.split(".")
    place = find_top_level(first)
    if place is None:
        return None
    place = place.joinpath(*rest)
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return None


@cache
def find_top_level(name: str) -> Path | None:
    """Return the folder of a package, or the path of a module without its suffix."""
    spec = find_spec(name)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(spec.submodule_search_locations[0])
    origin = spec.origin if spec.has_location else None
    return Path(origin).with_suffix("") if origin else None


@no_type_check
@structref.register
class PackedType(types.StructRef):
    """Describes `Packed` to numba, once for each type of tuple."""

    def preprocess_fields(self, fields: Any) -> Any:  # noqa: ANN401
        """Return the fields with literal types replaced by the types they are of."""
        return tuple((name, types.unliteral(type_)) for name, type_ in fields)


@no_type_check
class Packed(structref.StructRefProxy):
    """A reference to a named tuple of arrays and numbers that compiled code reads.

    It reads them as `packed.fields`. The arrays are shared with the tuple, not copied.
    """


structref.define_proxy(Packed, PackedType, ["parts"])


@final
class ViewType(types.Type):
    """Describes a pointer to a named tuple to numba, whose fields are read one by one.

    A tuple itself is handed over array by array to each function that is called, which
    takes long to compile, and to run.
    """

    def __init__(self, parts: Any) -> None:  # noqa: ANN401
        """Describe pointers to tuples of one type."""
        self.parts = parts
        super().__init__(f"View({parts.name})")

    @property
    def key(self) -> types.Type:
        """What distinguishes it from others."""
        return self.parts


@no_type_check
@register_model(ViewType)
class ViewModel(models.PrimitiveModel):
    """A view is a pointer in compiled code."""

    def __init__(self, dmm: Any, fe_type: ViewType) -> None:  # noqa: ANN401
        """Point to the tuple in memory."""
        super().__init__(dmm, fe_type, dmm[fe_type.parts].get_value_type().as_pointer())


@no_type_check
@infer_getattr
class ViewAttributes(AttributeTemplate):
    """The fields of a view: further views, arrays and numbers."""

    key = ViewType

    def generic_resolve(self, view: ViewType, name: str) -> types.Type | None:
        """Return the type of a field."""
        if name not in view.parts.fields:
            return None
        type_ = view.parts.types[view.parts.fields.index(name)]
        return ViewType(type_) if isinstance(type_, types.BaseNamedTuple) else type_


@no_type_check
@lower_getattr_generic(ViewType)
def read_field(context: Any, builder: Any, view: ViewType, pointer: Any, name: str):  # noqa: ANN201, ANN401
    """Point to a field, or load it."""
    index = view.parts.fields.index(name)
    place = gep_inbounds(builder, pointer, 0, index)
    type_ = view.parts.types[index]
    if isinstance(type_, types.BaseNamedTuple):
        return place
    return impl_ret_borrowed(context, builder, type_, builder.load(place))


@no_type_check
@infer_getattr
class PackedAttributes(AttributeTemplate):
    """Gives a packed tuple its view."""

    key = PackedType

    def resolve_fields(self, packed: PackedType) -> ViewType:
        """Return the type of the view."""
        return ViewType(packed.field_dict["parts"])


@no_type_check
@lower_getattr(PackedType, "fields")
def view_packed(context: Any, builder: Any, packed: PackedType, value: Any) -> Any:  # noqa: ANN401
    """Point to the tuple, which lives as long as the reference."""
    pointer = structref._Utils(context, builder, packed).get_data_pointer(value)
    return gep_inbounds(builder, pointer, 0, 0)


@compiled
@no_type_check
def pack(parts: tuple) -> Packed:
    """Return a reference to a named tuple, which may hold further ones."""
    return Packed(parts)


@compiled
@no_type_check
def unpack(packed: Packed) -> Any:  # noqa: ANN401
    """Return the named tuple that a reference refers to."""
    return packed.parts
