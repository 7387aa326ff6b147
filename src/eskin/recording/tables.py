"""This module describes recordings as tables: pressures, taxels and touches."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from eskin.recording.reader import Recording
from eskin.recording.records import Label
from eskin.skin import MountedSkin
from eskin.touch import Touch, TouchPipeline
from eskin.units import NS_PER_S


def measure_pressures(recording: Recording) -> Any:  # noqa: ANN401
    """Return the pressures of a recording, as `Recording.pressures` does."""
    mounted = MountedSkin(recording.skin, recording.load_robot())
    pipeline = TouchPipeline(mounted, recording.calibration)
    states = ((scan.stamp, pipeline.push(scan)) for scan in recording.scans())
    pairs = [(stamp, state.reading.pressure.copy()) for stamp, state in states]
    times = np.array([stamp for stamp, _ in pairs], "datetime64[ns]")
    values = np.array([row for _, row in pairs], np.float32)
    values = values.reshape(-1, recording.skin.count)
    taxels = list_taxels(recording)
    facts = {"units": "kPa", "calibration": recording.calibration.source}
    if find_spec("xarray") is not None:
        names = ("patch", "link", "row", "column")
        own = {name: ("taxel", [row[name] for row in taxels]) for name in names}
        coordinates = {"time": times, "taxel": np.arange(len(taxels)), **own}
        return import_module("xarray").DataArray(
            values, coordinates, ("time", "taxel"), "pressure", attrs=facts
        )
    if find_spec("pandas") is not None:
        pandas = import_module("pandas")
        cells = [(row["patch"], row["row"], row["column"]) for row in taxels]
        columns = pandas.MultiIndex.from_tuples(cells, names=("patch", "row", "column"))
        frame = pandas.DataFrame(values, times, columns)
        frame.attrs = facts
        return frame
    return values


def list_taxels(recording: Recording) -> list[dict[str, Any]]:
    """List the rows of a recording's taxels."""
    skin = recording.skin
    return [
        {
            "recording": recording.path.name,
            "taxel": taxel,
            "patch": skin.patches[number].id,
            "link": skin.patches[number].link,
            "row": int(skin.rows[taxel]),
            "column": int(skin.columns[taxel]),
            "position": skin.positions[taxel],
            "normal": skin.normals[taxel],
            "area": float(skin.areas[taxel]),
        }
        for taxel, number in enumerate(skin.patch_index.tolist())
    ]


def describe_touch(
    recording: Recording, touch: Touch, labels: tuple[Label, ...]
) -> dict[str, Any]:
    """Return the row of a touch, with its label and detection where it has them."""
    label = find_label(touch, labels)
    found = next((d for d in recording.detections if d.onset == touch.onset), None)
    return {
        **describe_origin(recording),
        "touch": touch.id,
        "onset": touch.onset,
        "end": touch.last,
        "duration": (touch.last - touch.onset) / NS_PER_S,
        "link": touch.link,
        "patch": touch.contact.patch,
        "contacts": len(touch.tracks),
        "peak_force": touch.peak_force,
        "peak_pressure": touch.peak,
        "impulse": touch.impulse,
        "start": touch.start,
        "latest": touch.latest,
        "gesture": None if label is None else label.gesture,
        "label_source": None if label is None else label.source,
        "detected": None if found is None else found.gesture,
        "confidence": None if found is None else found.confidence,
    }


def describe_origin(recording: Recording) -> dict[str, str]:
    """Return the columns that say where a row is from."""
    person = recording.metadata.subject
    session = recording.metadata.session
    return {"recording": recording.path.name, "person": person, "session": session}


def find_label(touch: Touch, labels: tuple[Label, ...]) -> Label | None:
    """Return the label that overlaps a touch longest; None without one."""
    overlaps = [
        (min(label.end, touch.last) - max(label.start, touch.onset), label)
        for label in labels
    ]
    overlap, label = max(overlaps, default=(-1, None), key=lambda pair: pair[0])
    return label if overlap >= 0 else None
