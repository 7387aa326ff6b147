"""This module reads and writes the calibration file of a skin.

It holds the same JSON as the attachment of a recording: `Calibration.to_bytes`.
"""

from pathlib import Path

from eskin.errors import DeviceError, RecordingError
from eskin.files import atomic_path, read_file
from eskin.touch import MAX_CALIBRATION_BYTES, Calibration


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises:
        RecordingError: the file is no calibration.
        DeviceError: the file cannot be read.
    """
    try:
        return Calibration.from_bytes(read_file(path, MAX_CALIBRATION_BYTES))
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except OSError as error:
        raise DeviceError(
            f"calibration {path} cannot be read ({error.strerror}); allowed is a JSON "
            "file as eskin calibrate writes it; correct the path"
        ) from error


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration file, whole or not at all; missing folders are created."""
    with atomic_path(path, durable=True) as part:
        part.write_bytes(calibration.to_bytes())
