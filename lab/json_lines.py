"""This module keeps the results of long benchmarks as JSON, one object a line."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def read_results(path: Path | None, kind: type[T]) -> list[T]:
    """Return the results of a file; none without one."""
    if path is None or not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [kind(**json.loads(line)) for line in lines]


def append_results(path: Path | None, results: Iterable[T]) -> None:
    """Append results to a file, if there is to be one."""
    if path is None:
        return
    with path.open("a", encoding="utf-8") as file:
        file.writelines(json.dumps(asdict(result)) + "\n" for result in results)
