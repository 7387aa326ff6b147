"""A camera of LeRobot, of type `eskin`, that sees the pressure on a robot's skin."""

from lerobot_camera_eskin.camera import EskinCamera
from lerobot_camera_eskin.config_eskin import EskinCameraConfig

__all__ = ["EskinCamera", "EskinCameraConfig"]
