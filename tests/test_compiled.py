"""What numba keeps on disk follows a change in any module of kernels."""

import importlib.util

import pytest

from eskin import compiled

SOURCE = """
from eskin.compiled import compiled

@compiled
def double(x):
    return 2 * x
"""


@pytest.fixture
def load(tmp_path):
    path = tmp_path / "some_kernels.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("some_kernels", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.double(2) == 4
        return sum(module.double.stats.cache_hits.values())

    return load


def test_compiled_function_is_kept_until_any_kernel_changes(load, monkeypatch):
    assert load() == 0
    assert load() == 1
    monkeypatch.setattr(compiled, "digest_sources", lambda: "changed")
    assert load() == 0


def test_every_compiled_module_is_in_the_digest():
    for path in compiled.PACKAGE.rglob("*.py"):
        if path.name != "compiled.py" and "@compiled" in path.read_text():
            assert path.name.endswith("kernels.py"), path
