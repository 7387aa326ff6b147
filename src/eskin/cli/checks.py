"""What commands look at before they work, and say of what they are given."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from eskin.errors import EskinError

if TYPE_CHECKING:
    from eskin.learn.dataset import Dataset


def check_writable(target: Path) -> None:
    """Refuse a place where no file can be written, before the work is done.

    Folders on the way to it may be missing.

    Raises:
        EskinError: if it is a folder, or lies where nothing can be written.
    """
    if target.is_dir():
        raise EskinError(
            f"cannot write {target}: it is a folder; give the path of a file"
        )
    nearest = next(place for place in target.absolute().parents if place.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise EskinError(
            f"cannot write {target}: {nearest} is no folder that can be written to; "
            "give a path in one that can"
        )


def tell_cut(*datasets: "Dataset | None") -> None:
    """Name the recordings whose end is missing."""
    for dataset in datasets:
        for recording in dataset.recordings[: dataset.own] if dataset else ():
            if recording.truncated:
                print(f"{recording.path} is cut or damaged: used up to there")
