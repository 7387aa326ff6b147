"""This module writes recordings as a bag of ROS 2: a folder with metadata.yaml."""

import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from eskin.errors import RecordingError
from eskin.files import write_folder
from eskin.progress import track_progress
from eskin.recording.mcap_file import McapReader, TopicMessage
from eskin.recording.messages import EVENT, TOPICS, TRUTH
from eskin.recording.reader import Recording
from eskin.recording.writer import rewrite_recording
from eskin.registry import Exporter

METADATA = "metadata.yaml"
BAG_VERSION = 5
"""Version of metadata.yaml, which ROS 2 Humble and later read."""
TYPE_NAMES = {topic.name: topic.type_name for topic in (*TOPICS, TRUTH, EVENT)}


@dataclass(frozen=True)
class BagFile:
    """What metadata.yaml says of one file."""

    name: str
    """Name of the file in the folder."""
    start: int
    """First log time [ns since the epoch]; 0 without messages."""
    end: int
    """Last log time [ns since the epoch]; 0 without messages."""
    counts: Counter[str]
    """Number of messages of each topic."""


def write_bag(recordings: Sequence[Recording], folder: Path | str) -> int:
    """Write recordings as one bag, which `ros2 bag info` and `ros2 bag play` open.

    The files are copies; one that is cut short is written again without its damage.

    Args:
        recordings: recordings in the order of time.
        folder: folder of the bag, which must not exist.

    Returns:
        Number of messages.

    Raises:
        RecordingError: the folder exists or cannot be written, or two recordings have
            one name.
    """
    names = [recording.path.name.removesuffix(".part") for recording in recordings]
    if len(set(names)) < len(names):
        raise RecordingError(
            f"recordings are called {', '.join(names)}; allowed is each name once in a "
            "bag; rename them or write bags of their own"
        )
    files = []
    with write_folder(Path(folder), RecordingError) as work:
        pairs = list(zip(names, recordings, strict=True))
        for name, recording in track_progress(pairs, "recordings", len(pairs)):
            target = work / name
            if recording.truncated:
                rewrite_recording(recording, target)
            else:
                shutil.copyfile(recording.path, target)
            files.append(count_messages(target))
        text = yaml.safe_dump(describe_bag(files), sort_keys=False)
        (work / METADATA).write_text(text, encoding="utf-8")
    return sum(sum(file.counts.values()) for file in files)


def count_messages(path: Path) -> BagFile:
    """Count the messages of a file."""
    counts: Counter[str] = Counter()
    start = end = 0
    for item in McapReader(path):
        if isinstance(item, TopicMessage):
            start = item.log_time if not counts else min(start, item.log_time)
            end = max(end, item.log_time)
            counts[item.topic] += 1
    return BagFile(path.name, start, end, counts)


def describe_bag(files: Sequence[BagFile]) -> dict[str, Any]:
    """Return the content of metadata.yaml."""
    whole = sum((file.counts for file in files), Counter())
    timed = [file for file in files if file.counts]
    start = min((file.start for file in timed), default=0)
    end = max((file.end for file in timed), default=0)
    topics = [
        {
            "topic_metadata": {
                "name": name,
                "type": TYPE_NAMES[name],
                "serialization_format": "cdr",
                "offered_qos_profiles": "",
            },
            "message_count": whole[name],
        }
        for name in TYPE_NAMES
        if whole[name]
    ]
    information = {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        **describe_time(start, end),
        "message_count": sum(whole.values()),
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                **describe_time(file.start, file.end),
                "message_count": sum(file.counts.values()),
            }
            for file in files
        ],
    }
    return {"rosbag2_bagfile_information": information}


def describe_time(start: int, end: int) -> dict[str, Any]:
    """Return the entries of metadata.yaml for a span of time [ns since the epoch]."""
    return {
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
    }


BAG = Exporter(lambda recordings, folder: {"messages": write_bag(recordings, folder)})
