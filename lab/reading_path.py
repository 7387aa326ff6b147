"""Count the files of eskin that one reading passes on its way from UDP to detection.

    python -m lab.reading_path

A simulated person touches the ur5 skin, whose patches send over UDP on loopback from
another process. Here `eskin.open_source` receives them and `eskin.Recognizer`
recognises. After the first detection, when all is set up and compiled, a profiler notes
the file of every Python function that is called, until `DETECTIONS` more are made.

numba shows a profiler each call of a compiled function from Python, with the file of
the function that was compiled. What compiled functions call in turn is not shown; it is
found from the names that they use, at any depth, and listed apart: such a function may
be called, but need not have been. The thread and queue of a `Stream`, by which `eskin
run` passes scans to the recogniser, are left out, as is what draws and records.

The count means nothing where too few touches were detected: then one line says what
came, and the exit code is 1.
"""

import gc
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import CodeType, FrameType

from numba.core.dispatcher import Dispatcher

import eskin
from eskin.cli.main import print_error
from eskin.errors import EskinError

PACKAGE = Path(eskin.__file__).parent
ADDRESS = "127.0.0.1:9791"
DETECTIONS = 5
"""Detections that are profiled."""
PATIENCE = 120.0
"""Longest wait for the sender, and for a detection [s]."""


class Profiler:
    """Collects, in every thread, the code that is called while it is on.

    Attributes:
        on: whether calls are noted.
        called: code objects of the package in the order of their first call.
        lengths: number of files that each reading passed.
    """

    def __init__(self) -> None:
        """Start switched off, in this thread and in those that are started later."""
        self.on = False
        self.called: dict[CodeType, None] = {}
        self.files: set[str] = set()
        self.lengths: list[int] = []
        threading.setprofile(self.note)
        sys.setprofile(self.note)

    def note(self, frame: FrameType, event: str, argument: object) -> None:
        """Note the code of a call."""
        if self.on and event == "call" and is_inside(frame.f_code):
            self.called.setdefault(frame.f_code)
            self.files.add(frame.f_code.co_filename)

    def end_reading(self) -> None:
        """Keep how many files were passed since the reading before, if it is on."""
        if self.on:
            self.lengths.append(len(self.files))
        self.files.clear()


def is_inside(code: CodeType) -> bool:
    """Return whether code is of a file of eskin."""
    return code.co_filename.startswith(f"{PACKAGE}/")


def find_compiled() -> dict[CodeType, Dispatcher]:
    """Return every compiled function by the code that it was compiled from."""
    found = (each for each in gc.get_objects() if is_compiled(each))
    return {each.py_func.__code__: each for each in found}


def is_compiled(value: object) -> bool:
    """Return whether a value is a compiled function."""
    return issubclass(type(value), Dispatcher)


def find_inner(called: list[CodeType]) -> list[CodeType]:
    """Return the compiled functions that called ones use, at any depth."""
    compiled = find_compiled()
    waiting = list(called)
    found: dict[CodeType, None] = {}
    while waiting:
        if (code := waiting.pop()) in compiled:
            known = compiled[code].py_func.__globals__
            used = [known[name] for name in code.co_names if name in known]
            inner = [each.py_func.__code__ for each in used if is_compiled(each)]
            waiting += [each for each in inner if each not in found]
            found |= dict.fromkeys(inner)
    return [code for code in found if code not in called]


def list_files(codes: list[CodeType]) -> list[str]:
    """Return the files of code, each once, relative to the package."""
    paths = (Path(code.co_filename).relative_to(PACKAGE) for code in codes)
    return list(dict.fromkeys(str(path) for path in paths))


def receive(calibration: Path, profiler: Profiler) -> int:
    """Recognise what comes; return the number of detections that were profiled.

    Args:
        calibration: file of the calibration that the sender has written.
        profiler: profiler that is on from the first detection to the last.

    Raises:
        EskinError: nothing comes.
    """
    config = eskin.SourceConfig(skin="ur5", calibration=calibration, patience=PATIENCE)
    model = eskin.load_model("ur5")
    found = 0
    end = time.monotonic() + PATIENCE
    with eskin.open_source(f"udp://{ADDRESS}", config=config) as source:
        mounted = source.info.mounted
        recognizer = eskin.Recognizer(model, mounted, source.info.calibration)
        for scan in source:
            found += len(recognizer.push(scan))
            profiler.end_reading()
            is_over = found > DETECTIONS or time.monotonic() > end
            # Closing the source is no part of a reading's path.
            profiler.on = found > 0 and not is_over
            if is_over:
                break
    return max(found - 1, 0)


def build_sender(calibration: Path) -> list[str]:
    """Return the command that sends touches, and writes its calibration to a file."""
    words = ["device", "ur5", "--udp", ADDRESS, "--calibration", str(calibration)]
    return [sys.executable, "-m", "eskin", *words]


def receive_sent(profiler: Profiler) -> int:
    """Start the sender, and return what `receive` returns.

    Raises:
        EskinError: nothing comes.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        argv = build_sender(path)
        with subprocess.Popen(argv, stdout=subprocess.DEVNULL) as sender:
            try:
                while not path.exists() and sender.poll() is None:
                    time.sleep(0.1)
                return receive(path, profiler)
            finally:
                sender.terminate()


def main() -> int:
    """Receive, and print the files in the order of their first call.

    Returns:
        Exit code: 1 where nothing came, or fewer touches than are profiled.
    """
    profiler = Profiler()
    try:
        found = receive_sent(profiler)
    except EskinError as error:
        print_error(str(error))
        return 1
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    count = len(profiler.lengths)
    if found < DETECTIONS:
        print_error(
            f"got {found} detections in {count} profiled readings, with {PATIENCE:g} s "
            f"for all; needed are {DETECTIONS}; run it again now that code is compiled"
        )
        return 1
    called = list(profiler.called)
    files = list_files(called)
    inner = [name for name in list_files(find_inner(called)) if name not in files]
    print("\n".join(files))
    typical = statistics.median_low(profiler.lengths)
    longest = max(profiler.lengths)
    print(f"a reading passes {typical} files at the median and {longest} at most")
    print(f"{len(files)} files in {count} readings and {found} detections")
    print(f"{len(inner)} more that compiled code may call: {', '.join(inner)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
