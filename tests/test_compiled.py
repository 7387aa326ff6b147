"""What numba keeps on disk follows a change in any kernel that a module imports."""

import ast
import importlib
import sys

import pytest

from eskin import compiled

MODULES = ("eskin.caller_kernels", "eskin.callee_kernels", "eskin.constants")
CALLER = """
from eskin.compiled import compiled
from eskin.callee_kernels import double

@compiled
def quadruple(x):
    return double(double(x))
"""
CALLEE = """
from eskin.compiled import compiled
from eskin.constants import FACTOR

@compiled
def double(x):
    return {} * FACTOR * x
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Import the two modules anew; returns the result and the hits of the cache."""
    monkeypatch.setattr(compiled, "PACKAGE", tmp_path)
    monkeypatch.setattr(sys.modules["eskin"], "__path__", [str(tmp_path)])

    def load(factor, constant=1):
        (tmp_path / "compiled.py").touch()
        (tmp_path / "constants.py").write_text(f"FACTOR = {constant}")
        (tmp_path / "caller_kernels.py").write_text(CALLER)
        (tmp_path / "callee_kernels.py").write_text(CALLEE.format(factor))
        for name in MODULES:
            sys.modules.pop(name, None)
        compiled.digest_sources.cache_clear()
        importlib.invalidate_caches()
        module = importlib.import_module("eskin.caller_kernels")
        return module.quadruple(1), sum(module.quadruple.stats.cache_hits.values())

    yield load
    for name in MODULES:
        sys.modules.pop(name, None)
    compiled.digest_sources.cache_clear()


def test_compiled_function_is_kept_until_a_callee_changes(load):
    assert load("2") == (4, 0)
    assert load("2") == (4, 1)
    assert load("(1 + 2)") == (9, 0)


def test_compiled_function_is_kept_until_a_constant_changes(load):
    assert load("2") == (4, 0)
    assert load("2", constant=(1 + 4)) == (100, 0)


def test_compiled_functions_are_in_modules_of_kernels_and_call_only_those():
    for path in compiled.PACKAGE.rglob("*.py"):
        text = path.read_text()
        if path.name != "compiled.py" and "@compiled" in text:
            assert path.name.endswith("kernels.py"), path
            seen = set(compiled.IMPORTS.findall(text))
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.ImportFrom) and "kernels" in node.module:
                    assert node.module.removeprefix("eskin.") in seen
