"""This module checks options and paths before a command starts its work."""

import errno
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eskin.errors import DeviceError, EskinError
from eskin.files import YAML_SUFFIXES, read_file

if TYPE_CHECKING:
    from eskin.recording import Overrides
    from eskin.touch import Fault

MAX_CHECKED = 20
"""Number of recordings that are read before a command begins; more are read by it."""
MAX_CHECKED_BYTES = 256 << 20
"""Largest of these on disk [bytes]."""
TRIAL_BYTES = 4096
"""Size of the file that is written to try a folder [bytes]."""
BLOCK = 512
"""Unit in which the system counts a file's size on disk [bytes]."""
OUTPUTS = ("--out", "--record", "--results")
"""Options whose files are written, whatever they hold now."""


@dataclass(frozen=True)
class Range:
    """A range annotates an option with the numbers that it takes."""

    low: float
    """Smallest number."""

    high: float = math.inf
    """Largest number; inf for all that are finite."""

    is_open: bool = False
    """Whether the smallest number itself is not allowed."""

    allows_inf: bool = False
    """Whether the option may be infinite."""

    def __contains__(self, value: float) -> bool:
        """Return whether a number is in the range."""
        is_above = value > self.low if self.is_open else value >= self.low
        return is_above and value <= self.high and (value < math.inf or self.allows_inf)

    def __str__(self) -> str:
        """Return the allowed values, as messages say them."""
        is_bounded = self.high < math.inf
        kind = "numbers" if is_bounded or self.allows_inf else "finite numbers"
        low = f"{'above' if self.is_open else 'from'} {self.low:g}"
        return f"{kind} {low} up to {self.high:g}" if is_bounded else f"{kind} {low}"


POSITIVE = Range(0, is_open=True)
NOT_NEGATIVE = Range(0)
POSITIVE_OR_INF = Range(0, is_open=True, allows_inf=True)


@dataclass(frozen=True)
class Needs:
    """A need annotates an option that is of no use without another one."""

    other: str
    """Name of the other option's field."""


@dataclass(frozen=True)
class Excludes:
    """An exclusion annotates an option that must not be given with another one."""

    other: str
    """Name of the other option's field."""


def check_options(command: Any) -> None:  # noqa: ANN401
    """Raise unless the options of a command are as its fields are annotated.

    Raises:
        ValueError: naming an option that is out of range, that is given without one
            that it needs, or with one that it excludes.
    """
    for field in fields(command):
        value = getattr(command, field.name)
        option = name_option(field.name)
        if not is_given(value):
            continue
        for rule in getattr(field.type, "__metadata__", ()):
            if isinstance(rule, Range) and value not in rule:
                raise ValueError(f"{option} is {value}; allowed are {rule}")
            if isinstance(rule, Needs) and not is_given(getattr(command, rule.other)):
                raise ValueError(
                    f"{option} is given without {name_option(rule.other)}; allowed is "
                    "both; add it, or leave both out"
                )
            if isinstance(rule, Excludes) and is_given(getattr(command, rule.other)):
                raise ValueError(
                    f"{option} is given with {name_option(rule.other)}; allowed is one "
                    "of them; leave the other out"
                )


def name_option(field: str) -> str:
    """Return the option of a field of a command."""
    return "--" + field.replace("_", "-")


def is_given(value: object) -> bool:
    """Return whether the value of an option is another than none at all."""
    return value is not None and value is not False and value != ()


def check_files(words: Sequence[str]) -> None:
    """Raise if a file that a command names cannot be used.

    Commands that import torch or the simulator begin with this, so that a file is
    refused before these seconds are spent, and before it takes memory beside them.

    Args:
        words: arguments of the command.

    Raises:
        EskinError: if a model, recording or command map cannot be used.
    """
    from eskin.live.model_file import MODEL_SUFFIX
    from eskin.recording import is_recording

    pairs = zip(["", *words], words, strict=False)
    read = [word for before, word in pairs if before not in OUTPUTS]
    named = [path for path in map(Path, read) if path.suffix and path.exists()]
    recordings = [path for path in named if is_recording(path)]
    for path in recordings[:MAX_CHECKED]:
        # A file with a hole is smaller on disk than it says.
        if path.stat().st_blocks * BLOCK <= MAX_CHECKED_BYTES:
            check_recording(path)
    for path in named:
        if path.suffix == MODEL_SUFFIX:
            from eskin.live import ESKIN, check_weights, load_model

            model = load_model(path)
            if model.card.recogniser == ESKIN:
                check_weights(model)
        elif path.suffix in YAML_SUFFIXES:
            check_yaml(path)


def check_yaml(path: Path) -> None:
    """Raise if a file is no plain YAML; its reader checks the content."""
    from eskin.files import MAX_YAML_BYTES, load_plain_yaml

    try:
        load_plain_yaml(read_file(path, MAX_YAML_BYTES).decode())
    except OSError as error:
        raise EskinError(
            f"{path} cannot be read ({error.strerror}); allowed is a YAML file"
        ) from error
    except UnicodeDecodeError as error:
        raise EskinError(f"{path}: byte {error.start} is no UTF-8") from None
    except ValueError as error:
        raise EskinError(f"{path}{error}") from None


def check_recording(path: Path) -> None:
    """Raise if a recording cannot be used, or its skin takes too much memory."""
    from eskin.recording import read_recording
    from eskin.touch import FrontEnd

    recording = read_recording(path)
    FrontEnd(recording.skin, recording.calibration)


def check_way(faults: "Sequence[Fault]") -> None:
    """Raise if one of the faults is that counts go another way under pressure.

    Raises:
        DeviceError: they do, so that nothing is felt.
    """
    from eskin.stream import describe_way

    if text := describe_way(faults):
        raise DeviceError(text)


def load_overrides(calibration: Path | None, robot_urdf: str | None) -> "Overrides":
    """Load what --calibration and --robot-urdf name, where they are given.

    Raises:
        EskinError: if it is no calibration file, or no robot.
    """
    from eskin.recording import Overrides, read_calibration
    from eskin.skin import load_robot_for_skin

    return Overrides(
        None if calibration is None else read_calibration(calibration),
        load_robot_for_skin(None, robot_urdf),
    )


def check_writable(target: Path) -> None:
    """Raise if no file can be written at a path; its parent folders may be missing.

    A file that is there is replaced, unless it is a recording.

    Raises:
        EskinError: if it is a folder or a recording, or is in a place that cannot be
            written to.
    """
    from eskin.recording import is_recording

    if target.is_dir():
        raise EskinError(
            f"cannot write {target}: it is a folder; give the path of a file"
        )
    if is_recording(target):
        raise EskinError(
            f"cannot write {target}: it is a recording, which no command replaces; "
            "allowed is another path; move it away or give another"
        )
    check_folder(target.absolute().parent)


def check_new(target: Path) -> None:
    """Raise unless a path is free, and a file or folder can be written there.

    Raises:
        EskinError: if something is there, or it cannot be written.
    """
    if target.exists():
        raise EskinError(
            f"cannot write {target}: it is there already; allowed is another path; "
            "move it away or give another"
        )
    check_folder(target.absolute().parent)


def check_folder(folder: Path) -> None:
    """Raise if a folder cannot be made or written to.

    Raises:
        EskinError: if something else is in its place, or it cannot be written to.
    """
    paths = folder.absolute(), *folder.absolute().parents
    nearest = next(path for path in paths if path.exists())
    reason = f"{nearest} is no folder"
    remedy = "give a path in one"
    if nearest.is_dir():
        try:
            with tempfile.TemporaryFile(dir=nearest) as trial:
                trial.write(bytes(TRIAL_BYTES))
                trial.flush()
            return
        except OSError as error:
            reason = f"{nearest}: {str(error.strerror).lower()}"
            remedy = "give a path in a folder that can be written to"
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                remedy = "free some space, or give a path on another disk"
    raise EskinError(f"cannot write to {folder}: {reason}; {remedy}")


def check_picture(target: Path) -> None:
    """Raise if a picture cannot be written at a path.

    Raises:
        EskinError: if it cannot be written there.
        ValueError: if its format is unknown.
    """
    from eskin.skin.picture import check_picture_format

    check_writable(target)
    check_picture_format(target)
