"""What commands look at before they work, and say of what they are given."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from eskin.errors import EskinError

if TYPE_CHECKING:
    from eskin.learn.dataset import Dataset

PICTURES = (".png", ".svg", ".pdf")


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
    check_folder(target.absolute().parent)


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made or written to, before the work is done.

    Raises:
        EskinError: if something else is in its place, or nothing can be written there.
    """
    places = folder.absolute(), *folder.absolute().parents
    nearest = next(place for place in places if place.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise EskinError(
            f"cannot write to {folder}: {nearest} is no folder that can be written to; "
            "give a path in one that can"
        )


def check_picture(target: Path) -> None:
    """Refuse a picture that cannot be written, before the work is done.

    Raises:
        EskinError: if its place cannot be written, or its format is unknown.
    """
    check_writable(target)
    if target.suffix not in PICTURES:
        raise EskinError(
            f"{target} is no picture that can be drawn; allowed are "
            f"{', '.join(PICTURES)}; change its end"
        )


def tell_cut(*datasets: "Dataset | None") -> None:
    """Name the recordings whose end is missing."""
    for dataset in datasets:
        for recording in (
            dataset.recordings[: dataset.original_count] if dataset else ()
        ):
            if recording.truncated:
                print(f"{recording.path} is cut or damaged: used up to there")
