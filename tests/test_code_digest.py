"""A digest of code changes with the code that a module runs, and with nothing else."""

import pytest

from eskin import code_digest

FILES = {
    "__init__.py": "",
    "top.py": '"""Top."""\nfrom eskin.low import f\nimport numpy\n',
    "low.py": 'def f():\n    """Low."""\n    return 1  # one\n',
    "aside.py": "X = 1\n",
}


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """The digest of `eskin.top` after files are changed."""
    places = {"eskin": tmp_path}
    monkeypatch.setattr(code_digest, "find_top_level", places.get)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)

    def digest(**changes):
        for name, text in changes.items():
            (tmp_path / f"{name}.py").write_text(text)
        for kept in (
            code_digest.digest_code,
            code_digest.digest_source,
            code_digest.direct_imports,
        ):
            kept.cache_clear()
        return code_digest.digest_code("eskin.top")

    yield digest
    code_digest.digest_code.cache_clear()
    code_digest.digest_source.cache_clear()
    code_digest.direct_imports.cache_clear()


@pytest.mark.parametrize(
    "change",
    [
        {"aside": "X = 2\n"},
        {"low": 'def f():\n    """Another text."""\n\n    return 1\n'},
    ],
)
def test_digest_stays_when_only_text_or_other_modules_change(digest, change):
    assert digest() == digest(**change)


@pytest.mark.parametrize(
    "change",
    [{"low": "def f():\n    return 2\n"}, {"top": "from eskin.low import f\n"}],
)
def test_digest_changes_with_a_module_and_with_what_it_imports(digest, change):
    assert digest() != digest(**change)


def test_unknown_module_is_refused():
    with pytest.raises(ValueError, match="no module 'eskin.nothing'"):
        code_digest.digest_code("eskin.nothing")
