"""Packing many scans at once: the same bytes as one by one, several times as fast.

All messages of one skin have the same length, so they are the rows of one array.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import RecordingError
from eskin.recording.cdr import ENCAPSULATION, LATEST_STAMP
from eskin.recording.messages import to_16_bits
from eskin.units import NS_PER_S

Field = tuple[str, str] | tuple[str, str, int]
"""Name and type of a field, and how many of it follow each other."""


def layout(*fields: Field) -> np.dtype:
    """The message with these fields, each aligned to its own size unless empty."""
    names, formats, offsets = ["encapsulation"], [np.dtype("S4")], [0]
    end = len(ENCAPSULATION)
    for name, code, *many in fields:
        single = np.dtype(code)
        aligned = 1 if single.kind == "S" or many == [0] else single.itemsize
        end += -(end - len(ENCAPSULATION)) % aligned
        names.append(name)
        formats.append(np.dtype((code, tuple(many))) if many else single)
        offsets.append(end)
        end += formats[-1].itemsize
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
    )


STAMP: tuple[Field, ...] = (("seconds", "<i4"), ("nanoseconds", "<u4"))


def text(name: str, content: str) -> tuple[Field, ...]:
    """The fields of a string."""
    size = len(content.encode()) + 1
    return ((f"{name}_length", "<u4"), (name, f"S{size}"))


@lru_cache(maxsize=8)
def reading_template(frame_id: str, taxels: int) -> np.ndarray:
    """One message of `/eskin/reading` without shear and values."""
    message = layout(
        *STAMP,
        *text("frame", frame_id),
        ("counts_length", "<u4"),
        ("counts", "<u2", taxels),
        ("received_length", "<u4"),
        ("received", "?", taxels),
        ("shear_length", "<u4"),
    )
    template = np.zeros(1, message)
    put_text(template, "frame", frame_id)
    template["counts_length"] = template["received_length"] = taxels
    return template


@lru_cache(maxsize=8)
def state_template(names: tuple[str, ...]) -> np.ndarray:
    """One message of `/joint_states` without values."""
    each = [text(f"name{i}", name) for i, name in enumerate(names)]
    message = layout(
        *STAMP,
        *text("frame", ""),
        ("names_length", "<u4"),
        *(field for fields in each for field in fields),
        ("positions_length", "<u4"),
        ("positions", "<f8", len(names)),
        ("velocities_length", "<u4"),
        ("efforts_length", "<u4"),
    )
    template = np.zeros(1, message)
    put_text(template, "frame", "")
    template["names_length"] = template["positions_length"] = len(names)
    for i, name in enumerate(names):
        put_text(template, f"name{i}", name)
    return template


def put_text(template: np.ndarray, name: str, content: str) -> None:
    """Fill in a string."""
    template[name] = content.encode()
    template[f"{name}_length"] = len(content.encode()) + 1


def stamped(template: np.ndarray, stamps: Int[np.ndarray, "reading"]) -> np.ndarray:
    """The template once a stamp, with its encapsulation and stamp."""
    messages = np.repeat(template, len(stamps))
    seconds, nanoseconds = np.divmod(stamps, NS_PER_S)
    messages["encapsulation"] = ENCAPSULATION
    messages["seconds"], messages["nanoseconds"] = seconds, nanoseconds
    return messages


def pack_readings(
    stamps: Int[np.ndarray, "reading"],
    counts: Int[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
    frame_id: str,
) -> list[bytes]:
    """Messages of `/eskin/reading` without shear.

    Raises:
        RecordingError: when a stamp or a count cannot be written.
    """
    if len(stamps) and not (0 <= stamps.min() and stamps.max() < LATEST_STAMP):
        raise RecordingError(
            f"stamps from {stamps.min()} to {stamps.max()} ns cannot be written; "
            "allowed are 0 to 2^31 s since the epoch; give nanoseconds of Unix time"
        )
    messages = stamped(reading_template(frame_id, counts.shape[1]), stamps)
    narrow = to_16_bits(counts.reshape(-1), np.dtype("<u2"), "counts")
    messages["counts"] = narrow.reshape(counts.shape)
    messages["received"] = received
    return rows(messages)


def pack_joint_states(
    stamps: Int[np.ndarray, "reading"],
    names: tuple[str, ...],
    q: Float[np.ndarray, "reading joint"],
) -> list[bytes]:
    """Messages of `/joint_states` with positions [rad] and nothing else."""
    messages = stamped(state_template(names), stamps)
    messages["positions"] = q
    return rows(messages)


def rows(messages: np.ndarray) -> list[bytes]:
    """Each message as bytes."""
    whole, size = messages.tobytes(), messages.itemsize
    return [whole[i : i + size] for i in range(0, len(whole), size)]
