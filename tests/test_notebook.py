"""Tests of what a notebook calls: pressures, touches as rows, values on a skin."""

import numpy as np
import pytest

import eskin
from eskin.skin import load_skin
from helpers.live import Press, mounted, record, scans

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("notebook") / "touched.mcap"
    presses = [Press(2.3, 2.7, 65, 65), Press(4.0, 4.6, 65, 65)]
    stream = scans(mounted(), presses, 50, 6.0)
    return eskin.read_recording(record(path, mounted(), stream))


def test_pressures_have_a_row_a_reading_and_a_column_a_taxel(recording):
    found = np.asarray(recording.pressures())
    assert found.shape == (recording.count, recording.skin.count)
    assert found.max() > 1.0 and (found[:50] < 2.0).all()


def test_touches_have_gestures_and_embeddings_of_the_model(recording):
    rows = eskin.find_touches(recording, "ur5")
    assert len(rows) == 2
    sizes = {len(row["embedding"]) for row in rows}
    assert len(sizes) == 1 and sizes.pop() > 8
    for row in rows:
        assert sum(row["probabilities"].values()) == pytest.approx(1.0, abs=1e-4)
        assert np.ptp(row["embedding"]) > 0.0
        assert row["person"] == recording.metadata.subject


def test_values_are_drawn_one_a_taxel_only():
    skin = load_skin("bent")
    figure = eskin.plot_skin(np.arange(skin.count), skin)
    drawn = sum(len(one.get_paths()) for one in figure.axes[0].collections)
    assert drawn == skin.count
    with pytest.raises(ValueError, match="allowed is a value a taxel"):
        eskin.plot_skin(np.zeros(3), "bent")


def test_skin_is_shown_in_a_cell_without_a_server():
    count = load_skin("bent").count
    shown = eskin.show_skin(np.arange(count), "bent")._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    for values, q in ((np.zeros(3), None), (np.zeros(count), np.zeros(99))):
        with pytest.raises(ValueError, match="allowed are"):
            eskin.show_skin(values, "bent", q=q)


def test_names_of_eskin_are_those_that_are_public():
    assert set(dir(eskin)) == {*eskin.__all__, "__version__"}
    assert all(getattr(eskin, name) is not None for name in dir(eskin))
