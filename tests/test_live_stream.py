"""What comes out of a stream is what the whole window gives offline."""

import numpy as np
import pytest
import torch

from eskin.learn.dataset import prepare
from eskin.learn.windows import cut, to_input
from eskin.live import Recognizer
from live_scenes import (
    calibration_of,
    label,
    model_of,
    mounted,
    network,
    record,
    scans,
    two_hands,
)

SCENES = {
    "grid at 10 Hz": (("grid",), "pressure", 10, ()),
    "grid at 50 Hz": (("grid",), "pressure", 50, ()),
    "grid at 200 Hz": (("grid",), "pressure", 200, (480,)),
    "grid with readings dropped": (
        ("grid",),
        "pressure",
        50,
        (120, 121, 140, 150, 151),
    ),
    "grid with a gap": (("grid",), "pressure", 50, tuple(range(140, 175))),
    "not calibrated": (("grid", False), "pressure", 20, (50,)),
    "shear": (("grid", True, "shear"), "shear", 50, (133,)),
    "shear, not used": (("grid", True, "shear"), "pressure", 50, ()),
    "ur5, arm moving": (("ur5",), "pressure", 30, (80, 95)),
}


def live_logits(model, on, stream):
    """Logits of every sequence in order of appearance, one row a reading."""
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    found = {}
    for scan in stream:
        recognizer.push(scan)
        for key, logits in recognizer.logits.items():
            found.setdefault(key, []).append(logits)
    return [np.array(rows) for rows in found.values()]


@pytest.mark.parametrize("scene", SCENES)
def test_a_stream_gives_the_logits_of_the_offline_windows(scene, tmp_path):
    place, kind, rate, dropped = SCENES[scene]
    on = mounted(*place)
    stream = scans(on, two_hands(on), rate, 4.9, dropped)
    path = record(tmp_path / "two.mcap", on, stream, [label(2.3, 3.2, "stroke")])
    net = network(kind)
    model = model_of(net)
    dataset = prepare([path], model.card.pipeline, model.card.graph)
    live = live_logits(model, on, stream)
    assert len(live) >= (3 if on.skin.calibrated else 1)
    assert [len(rows) for rows in live] == np.bincount(dataset.sequence).tolist()
    ends = np.arange(len(dataset.stamps))
    ends = np.unique(np.append(ends[:: max(1, rate // 10)], ends[-1]))
    windows = cut(dataset, ends, dataset.starts[ends], net.config.slots)
    with torch.no_grad():
        graphs = dataset.graphs.select(windows.rows)
        offline = net(to_input(graphs, windows, net.shear)).numpy()
    assert offline.std(axis=0).max() > 0.1
    np.testing.assert_allclose(np.concatenate(live)[ends], offline, atol=1e-4)
