"""This module writes recordings as Parquet tables (extra `parquet`).

The table `readings.parquet` has a row a reading, `touches.parquet` one a touch, and
`taxels.parquet` one a taxel.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from eskin.errors import RecordingError
from eskin.files import READINGS, TAXELS, TOUCHES, write_folder
from eskin.notebook import describe_origin, describe_touch, list_taxels
from eskin.progress import show_progress
from eskin.recording import Label, Recording, select_labels
from eskin.registry import Exporter, find_package
from eskin.skin import MountedSkin
from eskin.touch import Scan, Touch, TouchPipeline, TouchState

UNITS = {
    "pressure": "kPa",
    "peak_pressure": "kPa",
    "peak_force": "N",
    "impulse": "N s",
    "duration": "s",
    "q": "rad or m",
    "start": "m",
    "latest": "m",
    "position": "m",
    "area": "m2",
}
"""Units of the columns, which are in the metadata of their fields."""
GROUP_ROWS = 1000
"""Number of readings in a row group, which is held in memory."""


def write_tables(recordings: Sequence[Recording], folder: Path | str) -> dict[str, int]:
    """Write the readings and touches of recordings as two Parquet files.

    Pressures and touches are those that the live pipeline finds.

    Args:
        recordings: the recordings.
        folder: folder of the tables, which must not exist.

    Returns:
        Numbers of `readings` and of `touches`.

    Raises:
        ExtraError: pyarrow is not installed.
        RecordingError: the folder exists or cannot be written, or a recording cannot
            be read.
    """
    arrow = find_package("pyarrow", "pyarrow", "parquet", "a Parquet table")
    parquet = find_package("pyarrow.parquet", "pyarrow", "parquet", "a Parquet table")
    touches: list[dict[str, Any]] = []
    count = 0
    schema = build_reading_schema(arrow)
    with write_folder(Path(folder), RecordingError) as work:
        total = sum(recording.count for recording in recordings)
        with (
            parquet.ParquetWriter(work / READINGS, schema, compression="zstd") as file,
            show_progress("readings", total) as update,
        ):
            for recording in recordings:
                rows = list_rows(recording, touches)
                for group in split_groups(rows):
                    file.write_table(arrow.Table.from_pylist(group, schema))
                    count += len(group)
                    update(count)
        table = arrow.Table.from_pylist(touches, build_touch_schema(arrow))
        parquet.write_table(table, work / TOUCHES, compression="zstd")
        rows = [row for recording in recordings for row in list_taxels(recording)]
        table = arrow.Table.from_pylist(rows, build_taxel_schema(arrow))
        parquet.write_table(table, work / TAXELS, compression="zstd")
    return {"readings": count, "touches": len(touches)}


def split_groups(rows: Iterator[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows in groups."""
    group = []
    for row in rows:
        group.append(row)
        if len(group) == GROUP_ROWS:
            yield group
            group = []
    if group:
        yield group


def list_rows(
    recording: Recording, touches: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a recording's readings; append the rows of its touches."""
    mounted = MountedSkin(recording.skin, recording.load_robot())
    pipeline = TouchPipeline(mounted, recording.calibration)
    labels = select_labels(recording.labels)

    def add_touches(found: tuple[Touch, ...]) -> None:
        kept = [touch for touch in found if touch.merged_into is None]
        touches.extend(describe_touch(recording, touch, labels) for touch in kept)

    for scan in recording.scans():
        state = pipeline.push_scan(scan)
        add_touches(state.closed_touches)
        yield describe_reading(recording, scan, state, labels)
    add_touches(pipeline.finish())


def build_schema(arrow: Any, columns: Sequence[tuple[str, Any]]) -> Any:  # noqa: ANN401
    """Build a schema of columns, with their units."""
    return arrow.schema(
        [
            arrow.field(name, kind, metadata={"unit": UNITS[name]})
            if name in UNITS
            else arrow.field(name, kind)
            for name, kind in columns
        ]
    )


def build_taxel_schema(arrow: Any) -> Any:  # noqa: ANN401
    """Build the schema of the taxels."""
    place = arrow.list_(arrow.float64())
    kinds = {"taxel": arrow.int64(), "row": arrow.int64(), "column": arrow.int64()}
    kinds |= {"position": place, "normal": place, "area": arrow.float64()}
    names = ("recording", "taxel", "patch", "link", "row", "column")
    columns = [
        (name, kinds.get(name, arrow.string()))
        for name in (*names, "position", "normal", "area")
    ]
    return build_schema(arrow, columns)


def build_reading_schema(arrow: Any) -> Any:  # noqa: ANN401
    """Build the schema of the readings."""
    name = arrow.dictionary(arrow.int32(), arrow.string())
    return build_schema(
        arrow,
        [
            ("recording", name),
            ("person", name),
            ("session", name),
            ("stamp", arrow.timestamp("ns", "UTC")),
            ("counts", arrow.list_(arrow.int32())),
            ("received", arrow.list_(arrow.bool_())),
            ("pressure", arrow.list_(arrow.float32())),
            ("valid", arrow.list_(arrow.bool_())),
            ("shear", arrow.list_(arrow.int32())),
            ("q", arrow.list_(arrow.float64())),
            ("gesture", arrow.string()),
        ],
    )


def build_touch_schema(arrow: Any) -> Any:  # noqa: ANN401
    """Build the schema of the touches."""
    number = arrow.float64()
    text = arrow.string()
    place = arrow.list_(arrow.float64())
    stamp = arrow.timestamp("ns", "UTC")
    return build_schema(
        arrow,
        [
            ("recording", text),
            ("person", text),
            ("session", text),
            ("touch", arrow.int64()),
            ("onset", stamp),
            ("end", stamp),
            ("duration", number),
            ("link", text),
            ("patch", text),
            ("contacts", arrow.int64()),
            ("peak_force", number),
            ("peak_pressure", number),
            ("impulse", number),
            ("start", place),
            ("latest", place),
            ("gesture", text),
            ("label_source", text),
            ("detected", text),
            ("confidence", number),
        ],
    )


def describe_reading(
    recording: Recording, scan: Scan, state: TouchState, labels: tuple[Label, ...]
) -> dict[str, Any]:
    """Return the row of a reading; its label gives `gesture`, or null."""
    named = [label for label in labels if label.start <= scan.stamp < label.end]
    return {
        **describe_origin(recording),
        "stamp": scan.stamp,
        "counts": scan.counts,
        "received": scan.received,
        "pressure": state.reading.pressure,
        "valid": state.reading.valid,
        "shear": None if scan.shear is None else scan.shear.reshape(-1),
        "q": scan.q,
        "gesture": named[-1].gesture if named else None,
    }


TABLES = Exporter(write_tables)
