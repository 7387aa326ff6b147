"""Recordings: MCAP files of scans and labels, and where they come from."""

from eskin.recording.agreement import Agreement
from eskin.recording.autolabel import AutoLabelConfig, label_automatically
from eskin.recording.conversion import Conversion
from eskin.recording.detection import DetectionRecord
from eskin.recording.event import EventRecord
from eskin.recording.folder import find_recordings
from eskin.recording.labels import (
    NONE,
    Label,
    best_labels,
    check_no_overlap,
    label_instants,
    labels_from_instants,
    sort_labels,
)
from eskin.recording.metadata import Metadata
from eskin.recording.ranges import load_ranges, rough_ranges
from eskin.recording.reader import Recording, ScanArrays, read_recording
from eskin.recording.relabel import Labelling, find_labels, rewrite
from eskin.recording.shearsense import convert_shearsense
from eskin.recording.sleeve import convert_sleeve
from eskin.recording.socialtouch import convert_socialtouch
from eskin.recording.truth import TruthRecord
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
