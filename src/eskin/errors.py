"""This module defines the exceptions of eskin.

EskinError
├── RobotError          a URDF that cannot be used                (ValueError)
├── SkinError           a skin file that cannot be used           (ValueError)
├── SkinMismatchError   data or model that does not fit the skin  (ValueError)
├── ReadingError        a reading of the wrong length or type     (ValueError)
├── RecordingError      a recording that cannot be read           (ValueError)
├── ImportSourceError   a public data set that cannot be converted (ValueError)
├── ModelError          weights that cannot be used               (ValueError)
├── GenerationError     clips that cannot be simulated            (ValueError)
├── PacketError         bytes that are no packet of a device      (ValueError)
├── CommandError        a command map that cannot be used         (ValueError)
├── ExtraError          an optional package that is not installed (ImportError)
├── PlatformError       a system that eskin does not run on       (ImportError)
├── DeviceError         a device or port that cannot be used      (OSError)
│   └── JointsError     joint positions that are not known
├── ArmError            an arm that cannot be used                (OSError)
│   └── JogError        a jog that an arm does not make
└── StreamError         a stream that had to stop                 (RuntimeError)

Every message says in one line what is wrong, what was got, what is allowed, and a
remedy unless that is plain. The command line prints that line and exits with code 2.
What is only doubted is told by a warning instead.
"""

import logging
import platform
from functools import lru_cache
from importlib.util import find_spec

import numpy as np
from jaxtyping import Float

logger = logging.getLogger(__name__)


class EskinError(Exception):
    """This is the base class of all errors that callers of eskin may handle."""


class RobotError(EskinError, ValueError):
    """A robot description cannot be used."""


class SkinError(EskinError, ValueError):
    """A skin file or skin cannot be used."""


class SkinMismatchError(EskinError, ValueError):
    """Data, robot or model do not match the skin that they are used with."""


class ReadingError(EskinError, ValueError):
    """A reading has the wrong length or type."""


class RecordingError(EskinError, ValueError):
    """A recording cannot be read or written."""


class ImportSourceError(EskinError, ValueError):
    """A public data set cannot be converted."""


class ModelError(EskinError, ValueError):
    """Model weights or metadata cannot be used."""


class GenerationError(EskinError, ValueError):
    """Clips cannot be simulated, or are missing."""


class PacketError(EskinError, ValueError):
    """Bytes are not a packet of the device protocol.

    Attributes:
        reason: check that failed: `length`, `crc`, `version`, `kind` or `content`.
    """

    def __init__(self, message: str, reason: str) -> None:
        """Store the message and the check that failed."""
        super().__init__(message)
        self.reason = reason


class ExtraError(EskinError, ImportError):
    """An optional package is needed and not installed."""


class PlatformError(EskinError, ImportError):
    """The operating system is one that eskin does not run on."""


def check_platform() -> None:
    """Raise unless the operating system has what serial ports and locks of files need.

    Raises:
        PlatformError: it has not, as Windows.
    """
    missing = [name for name in ("fcntl", "termios") if find_spec(name) is None]
    if missing:
        raise PlatformError(
            f"eskin does not run on Windows: {platform.system()} has no "
            f"{' and no '.join(missing)} here; allowed is Linux; run it there, in WSL "
            "or in a container"
        )


class DeviceError(EskinError, OSError):
    """A device, port or address cannot be used, or is lost."""


class JointsError(DeviceError):
    """The joint positions of a robot are not known at a time.

    Attributes:
        q: the last that were known, zeros before [rad].
    """

    def __init__(self, message: str, q: Float[np.ndarray, "joint"]) -> None:
        """Store the message and the last joint positions."""
        super().__init__(message)
        self.q = q


class CommandError(EskinError, ValueError):
    """A command map cannot be used."""


class ArmError(EskinError, OSError):
    """An arm cannot be used, or is lost."""


class JogError(ArmError):
    """An arm does not make a jog, and has not moved."""


class StreamError(EskinError, RuntimeError):
    """A stream had to stop, or cannot start."""


@lru_cache(maxsize=256)
def warn_once(text: str) -> None:
    """Log a warning, unless it was logged before: a file may be read more than once."""
    logger.warning("%s", text)
