"""Tests of what is kept between runs: it follows the code that it was made of.

These are compiled functions, digests of code, and files that are written as a whole.
"""

import ast
import importlib
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.compiler import Flags
from numba.core.event import install_listener

from eskin import compiled, entries, places
from eskin.cli.main import main
from eskin.design.formats.gentact import write_gentact
from eskin.design.formats.icub import write_icub_positions
from eskin.design.formats.tactile_urdf import write_tactile_urdf
from eskin.files import atomic_path
from eskin.learn.checkpoint import Checkpoint, save_checkpoint
from eskin.learn.prepared_recording import PreparedRecording, save_prepared
from eskin.live import create_empty_batch
from eskin.skin import load_skin, save_skin
from eskin.skin.picture import draw_skin
from eskin.touch.contact_kernels import box_gap
from helpers.live import model_of, network

KERNEL_MODULES = {
    "caller_kernels": """
from eskin.compiled import compiled
from eskin.callee_kernels import double

@compiled
def quadruple(x):
    return double(double(x))
""",
    "callee_kernels": """
from eskin.compiled import compiled
from eskin.constants import FACTOR

@compiled
def double(x):
    return {} * FACTOR * x
""",
    "constants": "FACTOR = {}",
}
DIGESTED_MODULES = {
    "__init__": "",
    "top": '"""Top."""\nfrom eskin.low import f\nimport numpy\n',
    "low": 'def f():\n    """Low."""\n    return 1  # one\n',
    "aside": "X = 1\n",
}


@pytest.fixture
def call_kernel(tmp_path, monkeypatch):
    """Return a function that imports the kernels anew and calls them.

    Its result is that of the call, and how often the cache on disk was used.
    """
    monkeypatch.setattr(compiled, "PACKAGE", tmp_path)
    monkeypatch.setattr(sys.modules["eskin"], "__path__", [str(tmp_path)])
    # Bytecode of a source of the same second and size would be taken for its own.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "compiled.py").touch()

    def forget():
        for name in KERNEL_MODULES:
            sys.modules.pop(f"eskin.{name}", None)
        compiled.digest_sources.cache_clear()
        importlib.invalidate_caches()

    def call_kernel(factor, constant=1):
        values = {"callee_kernels": factor, "constants": constant}
        for name, text in KERNEL_MODULES.items():
            (tmp_path / f"{name}.py").write_text(text.format(values.get(name)))
        forget()
        module = importlib.import_module("eskin.caller_kernels")
        return module.quadruple(1), sum(module.quadruple.stats.cache_hits.values())

    yield call_kernel
    forget()


def test_processes_that_compile_at_once_do_not_mix_their_code(tmp_path, monkeypatch):
    """Both have read the index while it was empty, and the first writes code last."""
    file = entries.CodeFile(tmp_path, "kernel")
    delayed = []
    with monkeypatch.context() as empty:
        empty.setattr(file, "_load_index", dict)
        with monkeypatch.context() as slow:
            slow.setattr(file, "_save_data", lambda *saved: delayed.append(saved))
            file.save("float", "code for float")
        file.save("int", "code for int")
        file._save_data(*delayed[0])
    assert file.load("int") == "code for int"


def test_compiled_function_is_kept_until_a_callee_or_constant_changes(call_kernel):
    assert call_kernel("2") == (4, 0)
    assert call_kernel("2") == (4, 1)
    assert call_kernel("(1 + 2)") == (9, 0)
    assert call_kernel("2", constant=(1 + 4)) == (100, 0)


@pytest.fixture
def halve(tmp_path, caplog):
    """Return a function that compiles a kernel which may be kept in some folders.

    It returns the kernel's first result, and how often its code was compiled.
    """
    places.tell_unkept.cache_clear()
    box = np.ones((2, 3))

    def halve(*allowed):
        kernel = entries.compile_entry(box_gap.py_func, "digest", {})
        kernel._cache.places = allowed
        value = kernel(box - 1.0, box)
        return value, sum(kernel.stats.cache_misses.values())

    return halve


def list_code(*folders):
    return [len(list(folder.rglob("*.nbc"))) for folder in folders]


def test_code_is_read_where_it_is_and_kept_where_it_can_be(halve, tmp_path, caplog):
    first = tmp_path / "first"
    second = tmp_path / "second"
    closed = tmp_path / "file" / "folder"
    closed.parent.touch()
    assert halve(closed, second, first) == (1.0, 1)
    assert list_code(first, second) == [0, 1]
    for allowed in ((first, second), (closed, second), (second,)):
        assert halve(*allowed) == (1.0, 0)
    assert list_code(first, second) == [0, 1]
    assert not caplog.records


def test_code_that_cannot_be_kept_runs_and_that_is_told_once(halve, tmp_path, caplog):
    (tmp_path / "file").touch()
    for _ in range(2):
        assert halve(tmp_path / "file" / "folder") == (1.0, 1)
    [told] = caplog.messages
    assert "NUMBA_CACHE_DIR" in told


@pytest.mark.parametrize(
    ("variables", "shared"),
    [
        ({"HOME": "/home/a"}, ["/home/a/.cache/eskin"]),
        ({"HOME": "/home/a", "XDG_CACHE_HOME": "/b"}, ["/b/eskin"]),
        ({"HOME": "~"}, []),
    ],
)
@pytest.mark.parametrize("given", ["", "/given"])
def test_places_of_code_are_the_one_given_the_source_and_the_users_own(
    variables, shared, given, monkeypatch
):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(numba.config, "CACHE_DIR", given)
    found = places.list_places.__wrapped__(Path("/source"))
    first = ["/given/eskin"] if given else []
    assert list(map(str, found)) == [*first, "/source/__pycache__", *shared]


SUM_BOXES = """
import sys, numba, numpy as np
from eskin import compiled
from eskin.touch.contact_kernels import box_gap
box = np.zeros((2, 3))
print(box_gap(box, box + 1.0), len(box_gap.signatures), compiled.entries is None)
print(sum(box_gap.stats.cache_hits.values()), box_gap.stats.cache_path)
print("numba.np.arraymath" in sys.modules, "scipy.linalg" in sys.modules)
"""
"""Program that calls a kernel and tells how it was compiled."""


def run_kernel(folder, before="", **variables):
    """Run `SUM_BOXES` in a process of its own; return its words and its errors."""
    found = subprocess.run(
        [sys.executable, "-c", before + SUM_BOXES],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder), **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    return found.stdout.split(), found.stderr


def test_kept_code_is_loaded_without_what_compiling_needs(tmp_path):
    for is_kept in (False, True):
        told, errors = run_kernel(tmp_path)
        assert told[3] == str(int(is_kept))
        assert len(errors.splitlines()) == (not is_kept), "Python is told of it once"
        assert ("compiling code" in errors) is not is_kept
        assert told[-2:] == [str(not is_kept), "False"]


def test_switch_for_debugging_functions_of_others_leaves_kernels_compiled(tmp_path):
    before = "import numba; f = lambda: 0; assert numba.njit(f) is f"
    told, errors = run_kernel(tmp_path, before, NUMBA_DISABLE_JIT="1")
    assert told[:3] == ["1.0", "1", "False"]
    assert not errors or "compiling code" in errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "reason"),
    [
        ("numba.__version__ = '0.99.0rc1'", r"numba 0\.99\.0rc1 .*were tried"),
        ("from numba.core import codegen; del codegen.JITCodeLibrary", "JITCodeLib"),
    ],
)
def test_numba_that_is_not_as_known_compiles_by_itself(missing, reason, tmp_path):
    for hits in ("0", "1"):
        told, errors = run_kernel(tmp_path, f"import numba; {missing}")
        assert told[:4] == ["1.0", "1", "True", hits]
        lines = errors.splitlines()
        [line] = [each for each in lines if "compiling code" not in each]
        assert re.search(reason, line) and "install one" in line
    digest = compiled.digest_sources(Path(box_gap.py_func.__code__.co_filename))
    assert digest[:16] in told[4]


@pytest.mark.parametrize(
    ("owner", "name"),
    [(owner, name) for owner, names in entries.PARTS.items() for name in names],
)
def test_part_of_numba_that_is_missing_is_named(owner, name, monkeypatch):
    hidden = type(owner.__name__, (), {})
    monkeypatch.setattr(entries, "PARTS", {hidden: (name,)})
    with pytest.raises(ImportError, match=f"no {owner.__name__}.{name}"):
        entries.check_numba()


def test_function_called_by_compiled_code_is_not_compiled_for_python(call_kernel):
    assert call_kernel("2") == (4, 0)
    double = sys.modules["eskin.callee_kernels"].double
    assert not double.signatures
    assert double(3) == 6 and len(double.signatures) == 1


def test_function_of_numba_that_an_entry_used_serves_other_functions():
    box = np.zeros((2, 3))
    entry = compiled.compiled(box_gap.py_func)
    entry._cache = NullCache()
    assert entry(box, box + 1.0) == 1.0
    assert numba.njit(lambda a, b, c: max(a, b, c))(0.0, 2.0, 1.0) == 2.0


def test_flags_of_numba_are_those_that_it_lists_itself():
    flags = Flags()
    flags.nrt = True
    assert entries.list_flags(flags) == {n: getattr(flags, n) for n in flags.options}


def test_compiled_functions_are_in_modules_of_kernels_and_call_only_those():
    for path in compiled.PACKAGE.rglob("*.py"):
        text = path.read_text()
        if path.name != "compiled.py" and "@compiled" in text:
            assert path.name.endswith("kernels.py"), path
            seen = set(compiled.IMPORTS.findall(text))
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.ImportFrom) and "kernels" in node.module:
                    assert node.module.removeprefix("eskin.") in seen


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Return a function that computes the digest of a module after some changes."""
    monkeypatch.setattr(compiled, "find_top_level", {"eskin": tmp_path}.get)
    names = "digest_code", "digest_source", "direct_imports"
    kept = [getattr(compiled, name) for name in names]

    def digest(**changes):
        for name, text in (DIGESTED_MODULES | changes).items():
            (tmp_path / f"{name}.py").write_text(text)
        for function in kept:
            function.cache_clear()
        return compiled.digest_code("eskin.top")

    yield digest
    for function in kept:
        function.cache_clear()


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({"aside": "X = 2\n"}, True),
        ({"low": 'def f():\n    """Another text."""\n\n    return 1\n'}, True),
        ({"low": "def f():\n    return 2\n"}, False),
        ({"top": "from eskin.low import f\n"}, False),
    ],
)
def test_digest_changes_only_with_the_code_that_a_module_runs(digest, changes, is_same):
    assert (digest() == digest(**changes)) == is_same


def test_unknown_module_is_refused():
    with pytest.raises(ValueError, match=r"eskin\.nothing"):
        compiled.digest_code("eskin.nothing")


@pytest.mark.parametrize("durable", [False, True])
def test_file_takes_its_place_at_the_end_of_the_block(tmp_path, durable):
    path = tmp_path / "new" / "a.txt"
    with atomic_path(path, durable) as part:
        part.write_text("new")
        assert not path.exists()
        assert part.suffix == path.suffix
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


WRITERS = {
    "m.safetensors": lambda path: model_of(network()).save(path),
    "m.training": lambda path: save_checkpoint(path, Checkpoint("facts", 1, {}, {})),
    "a.npz": lambda path: save_prepared(path, PreparedRecording(*NO_ROWS, None)),
    "skin": lambda path: save_skin(load_skin("bent"), path),
    "skin.csv": lambda path: write_gentact(path, load_skin("bent")),
    "skin.urdf": lambda path: write_tactile_urdf(path, load_skin("bent")),
    "icub": lambda path: write_icub_positions(path, load_skin("bent")),
    "skin.png": lambda path: draw_skin(load_skin("bent"), path),
}
NO_ROWS = (create_empty_batch(4), np.zeros(0, np.int64), np.zeros(0, np.int64))


@pytest.mark.parametrize("name", WRITERS)
def test_write_that_fails_at_its_end_leaves_the_files_as_they_were(
    name, tmp_path, monkeypatch
):
    def fail(path, mode) -> None:
        raise OSError("no space left")

    def read():
        found = (path for path in sorted(tmp_path.rglob("*")) if path.is_file())
        return {path: path.read_bytes() for path in found}

    WRITERS[name](tmp_path / name)
    whole = read()
    for path in whole:
        path.write_text("old")
    old = read()
    with monkeypatch.context() as full, pytest.raises(OSError, match="no space"):
        full.setattr(Path, "chmod", fail)
        WRITERS[name](tmp_path / name)
    assert read() == old
    WRITERS[name](tmp_path / name)
    assert read().keys() == whole.keys() and old not in (whole, read())


def test_compiling_is_reported_once_and_on_stderr_of_the_command(monkeypatch, capsys):
    logger = logging.getLogger("eskin.compiled")
    monkeypatch.setattr(logger, "handlers", [])
    monkeypatch.setattr(logger, "level", logging.NOTSET)
    monkeypatch.setattr(sys, "argv", ["eskin", "--version"])
    with pytest.raises(SystemExit):
        main()
    kernels = [lambda x: x + 1, lambda x: x + 2, lambda x: x + 3]
    for kernel in kernels:
        kernel.__module__ = "eskin.some_kernels"
    numba.njit(kernels[0])(1)  # reported by the listener of the process, perhaps
    capsys.readouterr()
    with install_listener("numba:compile", compiled.CompilationReporter()):
        numba.njit(lambda x: x + 4)(1)
        assert capsys.readouterr() == ("", ""), "it is of another package"
        for kernel in kernels[1:]:
            numba.njit(kernel)(1)
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and "kept on disk" in err
