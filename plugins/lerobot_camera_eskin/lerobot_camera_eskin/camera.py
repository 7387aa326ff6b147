"""The camera reads a source in a thread, as other cameras of LeRobot do."""

import threading
import time
from typing import Any

import numpy as np
from lerobot.cameras.camera import Camera

from eskin.app import SourceConfig, open_source
from eskin.skin import Skin
from eskin.touch import TouchPipeline
from lerobot_camera_eskin.config_eskin import EskinCameraConfig

GAP = 1
"""Rows of pixels between two patches."""


def place_pixels(skin: Skin) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Return row and column of each taxel's pixel, and height and width of the image.

    Patches lie below each other, each by its rows and columns.
    """
    rows = np.zeros(skin.count, int)
    top = 0
    for number in range(len(skin.patches)):
        own = skin.patch_index == number
        rows[own] = skin.rows[own] + top
        top += int(skin.rows[own].max(initial=-1)) + 1 + GAP
    return rows, skin.columns, top - GAP, int(skin.columns.max(initial=0)) + 1


class EskinCamera(Camera):
    """Gives images with a pixel a taxel, from black to white by pressure."""

    def __init__(self, config: EskinCameraConfig) -> None:
        """Open nothing yet."""
        super().__init__(config)
        self.config = config
        self.source = self.thread = None
        self.arrived = threading.Condition()
        self.image = None
        self.stamp = 0.0
        self.taken = 0.0
        self.error: Exception | None = None

    @property
    def is_connected(self) -> bool:
        """Return whether the source is open."""
        return self.source is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return none: a source is named by its URI."""
        return []

    def connect(self, warmup: bool = True) -> None:
        """Open the source, and wait for its first image."""
        given = SourceConfig(skin=self.config.skin, robot=self.config.robot_urdf)
        self.source = source = open_source(self.config.source, config=given)
        self.pipeline = TouchPipeline(source.info.mounted, source.info.calibration)
        self.pixels = place_pixels(source.info.skin)
        self.height, self.width = self.pixels[2:]
        self.fps = self.fps or round(source.info.rate)
        self.thread = threading.Thread(target=self.watch, args=(source,), daemon=True)
        self.thread.start()
        if warmup:
            self.async_read(10_000)

    def watch(self, source: Any) -> None:
        """Make an image of each scan, until the source is closed."""
        rows, columns, height, width = self.pixels
        try:
            while self.source is source and not source.ended:
                scan = source.read(0.1)
                if scan is None:
                    continue
                reading = self.pipeline.push_scan(scan).reading
                shade = np.clip(255 * reading.pressure / self.config.white, 0, 255)
                image = np.zeros((height, width, 3), np.uint8)
                image[rows, columns] = np.where(reading.valid, shade, 0)[:, None]
                with self.arrived:
                    self.image = image
                    self.stamp = time.monotonic()
                    self.arrived.notify_all()
        except Exception as error:  # noqa: BLE001  It is raised where it is read.
            self.error = error
        finally:
            source.close()
            with self.arrived:
                self.arrived.notify_all()

    def read(self, *_: object) -> np.ndarray:
        """Return the next image."""
        return self.async_read(1000)

    def async_read(self, timeout_ms: float = 200) -> np.ndarray:
        """Return the latest image that was not returned yet; wait for it for a time."""
        with self.arrived:
            fresh = self.arrived.wait_for(
                lambda: self.stamp > self.taken or self.error, timeout_ms / 1000
            )
            if self.error is not None:
                raise RuntimeError(f"the source has failed: {self.error}")
            if not fresh:
                raise TimeoutError(f"no scan within {timeout_ms:g} ms")
            self.taken = self.stamp
            return self.image

    def read_latest(self, max_age_ms: int = 500) -> np.ndarray:
        """Return the latest image, at most so old."""
        with self.arrived:
            age = time.monotonic() - self.stamp
            if self.image is None or age > max_age_ms / 1000:
                raise TimeoutError(f"the latest scan is older than {max_age_ms} ms")
            return self.image

    def disconnect(self) -> None:
        """Close the source."""
        self.source = None
        if self.thread is not None:
            self.thread.join()
