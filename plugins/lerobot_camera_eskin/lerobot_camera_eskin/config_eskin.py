"""The configuration of the camera, such as `{type: eskin, source: sim:ur5}`."""

from dataclasses import dataclass

from lerobot.cameras.configs import CameraConfig


@CameraConfig.register_subclass("eskin")
@dataclass(kw_only=True)
class EskinCameraConfig(CameraConfig):
    """Which source of scans is seen, and how."""

    source: str = "sim:ur5"
    """URI of the source, as of `eskin run --source`."""

    skin: str | None = None
    """Skin of a device: a preset's name or a folder."""

    robot_urdf: str | None = None
    """Robot of the skin: a URDF file or a preset's name."""

    white: float = 60.0
    """Pressure that is white [kPa]."""
