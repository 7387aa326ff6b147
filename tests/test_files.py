"""Files are whole or not there."""

import pytest

from eskin.files import atomic_path


@pytest.mark.parametrize("durable", [False, True])
def test_file_takes_its_place_at_the_end_of_the_block(tmp_path, durable):
    path = tmp_path / "new" / "a.txt"
    with atomic_path(path, durable) as part:
        part.write_text("new")
        assert not path.exists()
        assert part.suffix == path.suffix
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def test_exception_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
