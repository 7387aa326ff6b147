"""The error tree.

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
├── DeviceError         a device or port that cannot be used      (OSError)
├── ArmError            an arm that cannot be used                (OSError)
│   └── JogError        a step that an arm does not make
└── StreamError         a stream that had to stop                 (RuntimeError)

Every message says what is wrong, what was got, what is allowed, and the remedy, in one
line. The command line turns each of these into that line and exit code 2.
"""


class EskinError(Exception):
    """What a caller of eskin may want to handle."""


class RobotError(EskinError, ValueError):
    """A robot description that cannot be used."""


class SkinError(EskinError, ValueError):
    """A skin file or skin that cannot be used."""


class SkinMismatchError(EskinError, ValueError):
    """Data, robot or model that does not fit the skin it is used with."""


class ReadingError(EskinError, ValueError):
    """A reading of the wrong length or type."""


class RecordingError(EskinError, ValueError):
    """A recording that cannot be read or written."""


class ImportSourceError(EskinError, ValueError):
    """A public data set that cannot be converted."""


class ModelError(EskinError, ValueError):
    """Model weights or metadata that cannot be used."""


class GenerationError(EskinError, ValueError):
    """Clips that cannot be simulated, or not there."""


class PacketError(EskinError, ValueError):
    """Bytes that are no packet of the device protocol.

    Attributes:
        reason: the check that failed: `length`, `crc`, `version`, `kind` or `content`.
    """

    def __init__(self, message: str, reason: str) -> None:
        """Say what is wrong, and by which check."""
        super().__init__(message)
        self.reason = reason


class ExtraError(EskinError, ImportError):
    """An optional package that is needed and not installed."""


class DeviceError(EskinError, OSError):
    """A device, port or address that cannot be used, or is lost."""


class CommandError(EskinError, ValueError):
    """A command map that cannot be used."""


class ArmError(EskinError, OSError):
    """An arm that cannot be used, or is lost."""


class JogError(ArmError):
    """A step that an arm does not make; it stands as it did."""


class StreamError(EskinError, RuntimeError):
    """A stream that had to stop, or cannot begin."""
