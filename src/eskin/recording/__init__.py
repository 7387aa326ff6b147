"""This package reads, writes and labels recordings, which are MCAP files."""

from eskin.recording.autolabel import (
    AutoLabelConfig,
    AutoLabelResult,
    LabelAgreement,
    label_automatically,
    label_recording,
)
from eskin.recording.reader import (
    NO_OVERRIDES,
    Overrides,
    Recording,
    ScanArrays,
    find_recordings,
    read_calibration,
    read_recording,
)
from eskin.recording.records import (
    NONE,
    PARTLY_LABELLED,
    DetectionRecord,
    EventRecord,
    Label,
    Metadata,
    TruthRecord,
    build_labels,
    build_rough_ranges,
    check_no_overlap,
    label_instants,
    load_ranges,
    select_labels,
    sort_labels,
)
from eskin.recording.rosbag import write_bag
from eskin.recording.tables import write_tables
from eskin.recording.writer import (
    RecordingWriter,
    rewrite_recording,
    write_all,
    write_calibration,
)

__all__ = [
    "NONE",
    "NO_OVERRIDES",
    "AutoLabelConfig",
    "AutoLabelResult",
    "DetectionRecord",
    "EventRecord",
    "Label",
    "LabelAgreement",
    "Metadata",
    "PARTLY_LABELLED",
    "Overrides",
    "Recording",
    "RecordingWriter",
    "ScanArrays",
    "TruthRecord",
    "build_labels",
    "build_rough_ranges",
    "check_no_overlap",
    "find_recordings",
    "label_automatically",
    "label_instants",
    "label_recording",
    "load_ranges",
    "read_calibration",
    "read_recording",
    "rewrite_recording",
    "select_labels",
    "sort_labels",
    "write_all",
    "write_bag",
    "write_calibration",
    "write_tables",
]
