"""Tests of the camera for LeRobot, with stand-ins for LeRobot where it is missing."""

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from helpers.live import Press, mounted, record, scans

FOLDER = Path(__file__).parents[1] / "plugins" / "lerobot_camera_eskin"


class ConfigStandIn:
    """Registers types of cameras."""

    known = {}

    @classmethod
    def register_subclass(cls, name):
        return lambda own: cls.known.setdefault(name, own)


class CameraStandIn:
    def __init__(self, config):
        self.fps = None
        self.height = None
        self.width = None


@pytest.fixture
def plugin(monkeypatch):
    modules = {
        "lerobot": {},
        "lerobot.cameras": {},
        "lerobot.cameras.configs": {"CameraConfig": ConfigStandIn},
        "lerobot.cameras.camera": {"Camera": CameraStandIn},
    }
    for name, values in modules.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(FOLDER)
    import lerobot_camera_eskin

    yield lerobot_camera_eskin
    for name in [n for n in sys.modules if n.startswith("lerobot_camera_eskin")]:
        del sys.modules[name]


def test_camera_shows_where_the_skin_is_pressed(plugin, tmp_path):
    on = mounted()
    stream = scans(on, [Press(0.5, 3.0, 65, 65)], 50, 3.0)
    path = record(tmp_path / "a.mcap", on, stream)
    assert ConfigStandIn.known["eskin"] is plugin.EskinCameraConfig
    camera = plugin.EskinCamera(plugin.EskinCameraConfig(source=f"replay:{path}"))
    assert not camera.is_connected
    camera.connect()
    images = []
    with pytest.raises(TimeoutError):
        while True:
            images.append(camera.async_read(1000))
    camera.disconnect()
    assert not camera.is_connected
    skin = on.skin
    assert images[0].shape == (camera.height, camera.width, 3) == (8, 30, 3)
    assert images[0].dtype == np.uint8 and camera.fps == 50
    pressed = max(images, key=np.max)[..., 0]
    place = np.unravel_index(pressed.argmax(), pressed.shape)
    assert place == (skin.rows[65], skin.columns[65])
    assert pressed.max() > 100


def test_camera_waits_no_longer_than_it_is_told(plugin, tmp_path):
    path = record(tmp_path / "a.mcap", mounted(), scans(mounted(), [], 50, 0.1))
    camera = plugin.EskinCamera(plugin.EskinCameraConfig(source=f"replay:{path}"))
    camera.connect()
    try:
        with pytest.raises(TimeoutError):
            for _ in range(10):
                camera.async_read(50)
    finally:
        camera.disconnect()
