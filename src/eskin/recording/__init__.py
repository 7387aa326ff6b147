"""Recordings: MCAP files of scans and labels, and where they come from."""

from eskin.recording.autolabel import (
    Agreement,
    AutoLabelConfig,
    Labelling,
    find_labels,
    label_automatically,
    rewrite,
)
from eskin.recording.conversion import Conversion
from eskin.recording.labels import (
    NONE,
    Label,
    best_labels,
    check_no_overlap,
    label_instants,
    labels_from_instants,
    load_ranges,
    rough_ranges,
    sort_labels,
)
from eskin.recording.reader import (
    Recording,
    ScanArrays,
    find_recordings,
    read_recording,
)
from eskin.recording.records import DetectionRecord, EventRecord, Metadata, TruthRecord
from eskin.recording.shearsense import convert_shearsense
from eskin.recording.sleeve import convert_sleeve
from eskin.recording.socialtouch import convert_socialtouch
from eskin.recording.writer import RecordingWriter, write_all

__all__ = [
    "NONE",
    "Agreement",
    "AutoLabelConfig",
    "Labelling",
    "find_labels",
    "label_automatically",
    "load_ranges",
    "rough_ranges",
    "rewrite",
    "Conversion",
    "DetectionRecord",
    "EventRecord",
    "Label",
    "Metadata",
    "Recording",
    "RecordingWriter",
    "ScanArrays",
    "TruthRecord",
    "best_labels",
    "check_no_overlap",
    "convert_shearsense",
    "convert_sleeve",
    "convert_socialtouch",
    "find_recordings",
    "label_instants",
    "labels_from_instants",
    "read_recording",
    "sort_labels",
    "write_all",
]
