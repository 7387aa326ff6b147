"""This module gives a notebook recordings as tables, and draws values of a skin."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from eskin.live import Model, Recognizer, load_model
from eskin.recording import Label, Recording, find_recordings, read_recording
from eskin.recording.records import select_labels
from eskin.robot import Robot
from eskin.skin import MountedSkin, Skin, load_skin, mount_skin
from eskin.skin.picture import draw_values
from eskin.touch import Touch, TouchPipeline, TouchState
from eskin.units import NS_PER_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def measure_pressures(recording: Recording | Path | str) -> Any:  # noqa: ANN401
    """Return the pressure of each taxel at each reading [kPa], as the live system.

    Args:
        recording: recording, or its path.

    Returns:
        An `xarray.DataArray` over `time` and `taxel`, with patch, link, row and column
        of each taxel; without xarray a `pandas.DataFrame` with a row a reading and a
        column a taxel; without either an array of that shape. The first two have the
        attributes `units` and `calibration` (its `source`).

    Raises:
        EskinError: the recording cannot be used.
    """
    if not isinstance(recording, Recording):
        recording = read_recording(recording)
    mounted = MountedSkin(recording.skin, recording.load_robot())
    pipeline = TouchPipeline(mounted, recording.calibration)
    states = ((scan.stamp, pipeline.push_scan(scan)) for scan in recording.scans())
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


def find_touches(recording: Recording | Path | str, model: Model | str = "ur5") -> Any:  # noqa: ANN401
    """Find the touches of recordings, with what a model makes of them.

    Args:
        recording: recording, its path, or a folder of recordings.
        model: model, its name, or the path of its file.

    Returns:
        A row a touch: a `pandas.DataFrame` where pandas is installed, else a list of
        dictionaries. Columns are those of the table of touches (stamps in ns since the
        epoch, forces in N, pressures in kPa), with the person and session of the
        recording and the gesture of its label; `start` and `latest` are places. Columns
        `detected` and `confidence` are of the model, `probabilities` those of its
        classes at the end. `times` and `forces` are arrays with an entry for each
        reading from the first to the last contact: the seconds since the onset, and the
        sum of the forces of all contacts of the touch [N], 0 in a pause between them.
        `embedding` is the mean of the network's features over the readings at which no
        other touch was open; None without one.

    Raises:
        EskinError: a recording or the model cannot be used.
    """
    model = model if isinstance(model, Model) else load_model(model)
    recordings = (
        [recording]
        if isinstance(recording, Recording)
        else map(read_recording, find_recordings([recording]))
    )
    rows = [row for each in recordings for row in list_touches(each, model)]
    if find_spec("pandas") is None:
        return rows
    return import_module("pandas").DataFrame(rows)


def list_touches(recording: Recording, model: Model) -> Iterator[dict[str, Any]]:
    """Yield the rows of a recording's touches, as `find_touches` describes them."""
    recognizer = Recognizer.load(model, recording=recording)
    labels = select_labels(recording.labels)
    features = {}
    detected = {}
    probabilities = {}
    closed = []
    forces = ForceRecorder()
    for scan in recording.scans():
        found = recognizer.push(scan)
        detected |= {each.touch: each for each in found}
        probabilities |= recognizer.probabilities
        if len(recognizer.probabilities) == 1:
            (touch,) = recognizer.probabilities
            values = recognizer.classifier.features
            features.setdefault(touch, []).append(values.copy())
        if recognizer.state is not None:
            closed += recognizer.state.closed_touches
            forces.record_forces(recognizer.state)
    detected |= {each.touch: each for each in recognizer.finish()}
    state = recognizer.state
    closed += () if state is None else state.touches
    for touch in {each.id: each for each in closed}.values():
        if touch.merged_into is None:
            one = detected.get(touch.id)
            shares = probabilities.get(touch.id)
            stamps, newtons = forces.collect(touch)
            yield describe_touch(recording, touch, labels) | {
                "detected": None if one is None else one.gesture,
                "confidence": None if one is None else one.confidence,
                "probabilities": None
                if shares is None
                else dict(zip(model.card.vocabulary, shares.tolist(), strict=True)),
                "times": (stamps - touch.onset) / NS_PER_S,
                "forces": newtons,
                "embedding": np.mean(features[touch.id], axis=0)
                if touch.id in features
                else None,
            }


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


@final
class ForceRecorder:
    """Records the force of every touch over time; stateful.

    Attributes:
        series: forces [N] by their stamps [ns], by the id of their touch.
    """

    def __init__(self) -> None:
        """Start before the first reading."""
        self.series: dict[int, dict[int, float]] = {}

    def record_forces(self, state: TouchState) -> None:
        """Record the forces at the next reading, also of touches not yet confirmed.

        The earlier forces of a touch that is merged into another are added to those of
        that one, as far as they are not from before its onset.
        """
        stamp = state.reading.stamp
        onsets = {touch.id: touch.onset for touch in state.rows}
        for touch in state.tracking.open:
            self.series.setdefault(touch.id, {})[stamp] = touch.force
        for touch in state.tracking.closed:
            heir = touch.merged_into
            if not heir:
                continue
            joined = self.series.setdefault(heir, {})
            for earlier, force in self.series.pop(touch.id, {}).items():
                if earlier >= onsets[heir]:
                    joined[earlier] = joined.get(earlier, 0.0) + force

    def collect(
        self, touch: Touch
    ) -> tuple[Int[np.ndarray, "reading"], Float[np.ndarray, "reading"]]:
        """Return the stamps [ns] and forces [N] of a touch until its last contact."""
        series = self.series[touch.id]
        stamps = sorted(stamp for stamp in series if stamp <= touch.last)
        forces = [series[stamp] for stamp in stamps]
        return np.array(stamps, np.int64), np.array(forces, np.float64)


def plot_skin(
    values: ArrayLike,
    skin: Skin | str | Path,
    unit: str | None = None,
) -> "Figure":
    """Draw a value of each taxel on the unrolled patches of a skin.

    Args:
        values: value of each taxel, such as a row of `measure_pressures`.
        skin: the skin, a preset's name, or a skin's folder.
        unit: what the values are in; by default what their attributes say, as those of
            `measure_pressures` do, which tell a nominal calibration too, else kPa.

    Returns:
        A figure, which a notebook shows.

    Raises:
        ValueError: there is not one value a taxel.
    """
    skin = skin if isinstance(skin, Skin) else load_skin(skin)
    facts = getattr(values, "attrs", {})
    label = unit or str(facts.get("units", "kPa"))
    if unit is None and facts.get("calibration") == "nominal":
        label += " by a nominal calibration"
    return draw_values(skin, np.asarray(values, np.float64), label)


@dataclass(frozen=True)
class SkinView:
    """Holds a scene that a notebook shows in its cell, to be turned by the mouse."""

    html: str
    """The scene as a page of its own, which needs no server."""
    height: int = 420
    """Height in the cell [px]."""

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        style = f"width:100%;height:{self.height}px;border:0"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}"></iframe>'


def show_skin(
    values: ArrayLike,
    skin: Skin | str | Path,
    robot: str | Path | Robot | None = None,
    q: ArrayLike | None = None,
) -> SkinView:
    """Show a value of each taxel on the robot, in three dimensions.

    Args:
        values: value of each taxel, 0 or more, such as a row of
            `measure_pressures`; the greatest has the darkest colour.
        skin: the skin, a preset's name, or a skin's folder.
        robot: robot that wears it: a preset's name, a URDF or a robot, such as what
            `Recording.load_robot` returns; None for that of the preset or of the
            skin's folder, which a skin given as an object does not know.
        q: joint positions [rad]; all zero where None.

    Returns:
        A view, which a notebook shows in the cell.

    Raises:
        ValueError: there is not one value a taxel, or not one position a joint.
        EskinError: the robot or the skin cannot be used, or a skin is given as an
            object without its robot.
    """
    from eskin.page.still import render_still

    mounted = mount_skin(skin, robot)
    joints = len(mounted.robot.joint_names)
    positions = np.zeros(joints) if q is None else np.asarray(q, np.float64)
    shown = np.asarray(values, np.float64)
    for name, array, count in (
        ("values", shown, mounted.skin.count),
        ("q", positions, joints),
    ):
        if array.shape != (count,):
            raise ValueError(
                f"{name} are of shape {array.shape}; allowed are {count} numbers; give "
                "one a taxel, and one a joint"
            )
    return SkinView(render_still(mounted, positions, shown))
