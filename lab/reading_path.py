"""Count the files of eskin that one reading passes on its way from UDP to detection.

    python -m lab.reading_path

A simulated person touches the ur5 skin, whose patches send over UDP on loopback from
another process. Here `eskin.open_source` receives them and `eskin.Recognizer`
recognises. After the first detection, when all is set up and compiled, a profiler notes
the file of every Python function that is called, until `DETECTIONS` more are made.

numba shows a profiler each call of a compiled function from Python, with the file of
the function that was compiled. What compiled functions call in turn is not shown; it is
found from the names that they use, at any depth, and listed apart: such a function may
be called, but need not have been.
"""

import gc
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType

import eskin
from eskin.cli.main import run

PACKAGE = Path(eskin.__file__).parent
ADDRESS = "127.0.0.1:9791"
DETECTIONS = 10
PATIENCE = 60.0
"""Longest wait for the sender, and for a detection [s]."""


class Profiler:
    """Collects, in every thread, the code that is called while it is on.

    Attributes:
        on: whether calls are noted.
        called: code objects of the package in the order of their first call.
    """

    def __init__(self) -> None:
        """Start switched off, in this thread and in those that are started later."""
        self.on = False
        self.called: dict[CodeType, None] = {}
        threading.setprofile(self.note)
        sys.setprofile(self.note)

    def note(self, frame: FrameType, event: str, argument: object) -> None:
        """Note the code of a call."""
        if self.on and event == "call" and is_inside(frame.f_code):
            self.called.setdefault(frame.f_code)


def is_inside(code: CodeType) -> bool:
    """Return whether code is of a file of eskin."""
    return code.co_filename.startswith(f"{PACKAGE}/")


def find_compiled() -> dict[CodeType, object]:
    """Return the Python function of every compiled function, by its code."""
    functions = (
        vars(each).get("py_func")
        for each in gc.get_objects()
        if "numba" in type(each).__module__ and hasattr(each, "__dict__")
    )
    return {function.__code__: function for function in functions if function}


def find_inner(called: list[CodeType]) -> list[CodeType]:
    """Return the compiled functions that called ones use, at any depth."""
    compiled, found, waiting = find_compiled(), {}, list(called)
    while waiting:
        function = compiled.get(waiting.pop())
        names = function.__code__.co_names if function else ()
        for name in names:
            used = getattr(function.__globals__.get(name), "py_func", None)
            if used is not None and used.__code__ not in found:
                found[used.__code__] = None
                waiting.append(used.__code__)
    return [code for code in found if code not in called]


def list_files(codes: list[CodeType]) -> list[str]:
    """Return the files of code, each once, relative to the package."""
    paths = (Path(code.co_filename).relative_to(PACKAGE) for code in codes)
    return list(dict.fromkeys(str(path) for path in paths))


def main() -> None:
    """Receive, and print the files in the order of their first call."""
