"""Give hostile files to the commands of eskin.

    python -m lab.attacks files [--only TEXT]

Each file must be refused with one line and exit code 2, in less than 2 s of processor
time and 500 MB, of which 1 s and 150 MB are those of Python and its imports. Processor
time is what a computer without other work takes; a command that waits without end is
killed.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from eskin.skin import save_skin
from lab.attacks.hostile_recordings import (
    RECORDINGS,
    build_skin_writer,
)
from lab.attacks.hostile_texts import (
    CALIBRATIONS,
    DATASETS,
    KEYS,
    MODELS,
    ROBOTS,
    SKINS,
    SMALL,
    SPECIAL,
    TEXTS,
    Write,
)
from lab.tables import format_head, format_row

MAX_SECONDS = 2.0
MAX_MEGABYTES = 500.0
PATIENCE = 60.0
"""Time after which a command is killed [s]."""
Kind = Literal[
    "model",
    "ranges",
    "commands",
    "calibration",
    "key",
    "skin",
    "robot",
    "recording",
    "set",
]
FILES: dict[Kind, dict[str, Write]] = {
    "model": MODELS | SPECIAL,
    "ranges": TEXTS | SPECIAL,
    "commands": TEXTS | SPECIAL,
    "calibration": CALIBRATIONS | SPECIAL,
    "key": KEYS | SPECIAL,
    "skin": SKINS,
    "robot": ROBOTS | SPECIAL,
    "recording": RECORDINGS | SPECIAL,
    "set": DATASETS,
}
"""Functions that write the files of each kind, by their mistake."""
NAMES: dict[Kind, str] = {
    "model": "hostile.safetensors",
    "ranges": "hostile.yaml",
    "commands": "hostile.yaml",
    "calibration": "hostile.json",
    "key": "hostile.key",
    "skin": "hostile",
    "robot": "hostile.urdf",
    "recording": "hostile.mcap",
    "set": "hostile",
}
COMMANDS: dict[Kind, tuple[str, ...]] = {
    "model": (
        "replay good.mcap --model {}",
        "run --source replay:good.mcap --model {}",
        "evaluate {} good.mcap",
        "demo --headless --seconds 1 --model {}",
    ),
    "ranges": ("label good.mcap --ranges {}",),
    "commands": (
        "run --source replay:good.mcap --robot sim:ur5 --commands {}",
        "demo --headless --seconds 1 --commands {}",
    ),
    "calibration": ("device good --udp 127.0.0.1:9750 --calibration {}",),
    "key": (
        "run --skin good --robot-urdf table --source udp://127.0.0.1:9750 --key {}",
    ),
    "skin": ("skin check {}", "device {} --pty"),
    "robot": (
        "skin check good --robot {}",
        "view good.mcap --port 0 --seconds 0 --robot-urdf {}",
    ),
    "recording": (
        "view {} --port 0 --seconds 0",
        "replay {}",
        "label {}",
        "evaluate ur5 {}",
        "train {} --out new.safetensors",
    ),
    "set": ("convert sleeve {} out",),
}
"""Commands that open a file of each kind. They run in a folder with a good recording
and a good skin."""


@dataclass(frozen=True)
class Command:
    """Give hostile files to the commands of eskin."""

    only: str = ""
    """Part of the names of the files or commands to try; by default all."""


@dataclass(frozen=True)
class FileTrial:
    """Measures how a command has treated a file."""

    kind: Kind
    """Kind of the file."""
    name: str
    """Its mistake."""
    command: str
    """Command, with `{}` for the file."""
    code: int
    """Exit code; negative where a signal ended it."""
    lines: tuple[str, ...]
    """Lines on stderr."""
    seconds: float
    """Processor time that it took [s]."""
    megabytes: float
    """Greatest resident memory [MB]."""

    @property
    def is_good(self) -> bool:
        """Return whether it was refused as it should be."""
        small = self.seconds < MAX_SECONDS and self.megabytes < MAX_MEGABYTES
        return self.code == 2 and len(self.lines) == 1 and small

    def format(self) -> str:
        """Return a row of the table."""
        words = self.command.split()
        cells = (
            self.kind,
            self.name,
            " ".join(words[: 2 if words[0] == "skin" else 1]),
            str(self.code),
            str(len(self.lines)),
            f"{self.seconds:.1f}",
            f"{self.megabytes:.0f}",
        )
        return format_row(cells) + ("" if self.is_good else " !")


def main(command: Command) -> None:
    """Try the files, print a table, and exit with 1 where one was not refused."""
    found: list[FileTrial] = []
    print(format_head(("file", "", "command", "code", "lines", "s", "MB")))
    for kind, files in FILES.items():
        for name, write in files.items():
            for line in COMMANDS[kind]:
                if command.only in f"{kind} {name} {line}":
                    found.append(attack(kind, name, write, line))
                    print(found[-1].format(), flush=True)
    bad = [refusal for refusal in found if not refusal.is_good]
    slowest = max((refusal.seconds for refusal in found), default=0.0)
    largest = max((refusal.megabytes for refusal in found), default=0.0)
    print(
        f"\n{len(found)} tries, {len(bad)} not refused as they should be; at most "
        f"{slowest:.1f} s and {largest:.0f} MB"
    )
    for refusal in bad:
        print(f"{refusal.kind}, {refusal.name}, {refusal.command}:")
        print("\n".join(f"  {line:.300}" for line in refusal.lines[-3:]))
    sys.exit(bool(bad))


def attack(kind: Kind, name: str, write: Write, command: str) -> FileTrial:
    """Run a command on a file, in a folder of its own."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        build_skin_writer(SMALL)(folder / "good.mcap")
        save_skin(SMALL, folder / "good")
        write(folder / NAMES[kind])
        words = command.format(NAMES[kind]).split()
        process = subprocess.Popen(
            [sys.executable, "-m", "eskin.cli.main", *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=(folder / "stderr.txt").open("wb"),
        )
        code, seconds, megabytes = wait(process)
        text = (folder / "stderr.txt").read_text(errors="replace")
    return FileTrial(
        kind, name, command, code, tuple(text.splitlines()), seconds, megabytes
    )


def wait(process: subprocess.Popen[bytes]) -> tuple[int, float, float]:
    """Wait for a process; return exit code, processor time [s] and memory [MB].

    It is killed after `PATIENCE`.
    """
    end = time.monotonic() + PATIENCE
    peak = 0.0
    while True:
        peak = max(peak, read_peak(process.pid))
        number, status, usage = os.wait4(process.pid, os.WNOHANG)
        if number:
            process.returncode = os.waitstatus_to_exitcode(status)
            seconds = usage.ru_utime + usage.ru_stime
            # Until a process has started its program, it has the memory of this one.
            own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            if usage.ru_maxrss > own:
                peak = usage.ru_maxrss / 1024
            return process.returncode, seconds, peak
        if time.monotonic() > end:
            process.kill()
        time.sleep(0.01)


def read_peak(pid: int) -> float:
    """Return the greatest resident memory of a process so far [MB]; 0 at its end."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    found = [line.split()[1] for line in lines if line.startswith("VmHWM")]
    return float(found[0]) / 1024 if found else 0.0
