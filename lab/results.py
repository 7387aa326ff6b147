"""Make the tables of docs/results.md again, part by part.

    python -m lab.results list --sets SETS
    python -m lab.results run --sets SETS --data ../shared/data
    python -m lab.results run people streams --sets SETS --minutes 110

A part is what stands under one heading of the page and runs by itself. Its commands are
those of the page. What they print is kept in SETS/kept/PART.txt, with the commit, the
date and the seconds of each. `run` runs the commands whose output is missing there, or
of another commit, of the parts that are named, or of all. A run that is cut loses only
the command that was running, and of the commands that keep answers of their own not
even that (`Part.keeps`): with `--minutes` a run ends in time, and the next goes on.

The commit is the last that changed what a figure depends on (`MEASURED`). Where files
differ from it nothing is run, so that no output is taken for that of a commit whose
code did not print it.
"""

import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

import tyro

from eskin.errors import EskinError
from eskin.files import atomic_path
from lab.program import run_program
from lab.tables import format_head, format_row

ROOT = Path(__file__).parents[1]
MEASURED = (
    "src",
    "lab",
    "plugins/paper_network",
    "constraints.txt",
    ":!lab/tests",
    ":!lab/notes",
    ":!*.md",
)
"""What a figure depends on, as paths of git."""
ANSWER = re.compile(
    r"^\$ (?P<command>.+)\n"
    r"# commit (?P<commit>[^,\n]+), (?P<date>.+), (?P<seconds>\d+) s$",
    re.MULTILINE,
)
"""Head of the output of a command in a kept file."""


class PartError(EskinError, RuntimeError):
    """A command of a part has failed."""


@dataclass(frozen=True)
class Part:
    """A part is what one run measures for the page."""

    name: str
    """Name on the command line."""
    heading: str
    """Heading of the page under which its table and its commands stand."""
    commands: tuple[str, ...]
    """Commands of the page. SETS is the folder of the simulated sets, DATA that of the
    public sets, and FOLDER one that belongs to the part."""
    minutes: int | None = None
    """About how long it takes on a core that other programs share [min]; None where it
    was not measured."""
    keeps: str = ""
    """What its commands keep beside what they print, from which a cut one goes on."""


SETS_KEPT = "sets, prepared recordings"
ANSWERS_KEPT = "sets, the answers of each training"
PAGE = (
    Part(
        "people",
        "Recognition on held-out simulated people",
        (
            "python -m lab.recogniser final --sets SETS --seed 7 --clips 300 "
            "--only final-fresh final-shifted final-moving",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "pose",
        "Recognition on held-out simulated people",
        (
            "python -m lab.recogniser pairs --sets SETS --clips 250",
            "python -m lab.same_touch",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "skins",
        "Recognition on held-out simulated people",
        ("python -m lab.recogniser skins --sets SETS --clips 200",),
        keeps=SETS_KEPT,
    ),
    Part(
        "transfer",
        "Real people",
        (
            "python -m lab.transfer --model ur5-sim",
            "python -m lab.transfer shearsense --model ur5-sim",
            "python -m lab.transfer shearsense --model ur5",
            "python -m lab.transfer sleeve --model ur5-sim",
            "python -m lab.transfer sleeve --model ur5",
        ),
        minutes=15,
    ),
    Part(
        "one-person",
        "Real people",
        (
            "python -m lab.weights --sets SETS --out FOLDER --weights p0 p1",
            "python -m lab.transfer --model FOLDER/p0.safetensors --people P1",
            "python -m lab.transfer --model FOLDER/p1.safetensors --people P0",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "small-sensors",
        "Real people",
        tuple(
            f"python -m lab.small_sensors {part} --seed 11 --draws 40"
            for part in (
                "rests",
                "caresses",
                "travel",
                "beats",
                "taps",
                "bumps",
                "drawn",
            )
        ),
        minutes=4,
    ),
    Part(
        "phone",
        "Real people",
        ("python -m lab.small_sensors phone --people P10 P12 P15 P18",),
        minutes=3,
    ),
    Part(
        "trained-sleeve",
        "Real people",
        (
            "python -m lab.real_recordings sleeve --data DATA/sleeve --seeds 3",
            "python -m lab.real_recordings sleeve --data DATA/sleeve --methods eskin "
            "paper",
        ),
        keeps=ANSWERS_KEPT,
    ),
    Part(
        "trained-shearsense",
        "Real people",
        ("python -m lab.real_recordings shearsense --data DATA/shearsense --seeds 3",),
        keeps=ANSWERS_KEPT,
    ),
    Part(
        "trained-socialtouch",
        "Real people",
        (
            "python -m lab.real_recordings socialtouch --data DATA/socialtouch "
            "--seeds 3",
        ),
        keeps=ANSWERS_KEPT,
    ),
    Part(
        "groups",
        "Real people",
        (
            "python -m lab.weights --sets SETS --out FOLDER --weights groups-p0",
            "python -m lab.transfer socialtouch-groups --model "
            "FOLDER/groups-p0.safetensors --people P1",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "designed-skins",
        "Designed skins",
        (
            "python -m lab.designed_skins measure --work FOLDER --only ur5 panda talos "
            "go2",
            "python -m lab.designed_skins table --work FOLDER",
        ),
        keeps="skins, sets",
    ),
    Part(
        "families",
        "Sensor families",
        (
            "python -m lab.recogniser final --sets SETS --seed 7 --clips 300 "
            "--only final-divider final-logarithmic final-capacitive final-linear",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "flaws",
        "Sensor families",
        (
            "python -m lab.flaws touches --builds 20 --minutes 1 --keep "
            "FOLDER/touches.jsonl",
        ),
        keeps="the result of each build",
    ),
    Part(
        "rest",
        "Sensor families",
        (
            "python -m lab.flaws rest --builds 12 --starts 8",
            "python -m lab.flaws real",
        ),
    ),
    Part(
        "streams",
        "Streams",
        (
            "python -m lab.recogniser final --sets SETS --seed 7 --clips 40 --only "
            "final-streams-fresh final-streams-families",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "accidents",
        "Streams",
        ("python -m lab.recogniser final --sets SETS --seed 6 --only final-accidents",),
        keeps=SETS_KEPT,
    ),
    Part(
        "quiet",
        "Streams",
        (
            "python -m lab.recogniser final --sets SETS --seed 4 --clips 96 --only "
            "final-quiet",
        ),
        keeps=SETS_KEPT,
    ),
    Part(
        "release",
        "Ends of touches, crosstalk",
        (
            "python -m lab.release make FOLDER --seed 7400 --only slow fresh families "
            "creep",
            "python -m lab.release play FOLDER FOLDER/found.json --seed 7400 --only "
            "slow fresh families creep",
        ),
        keeps="streams",
    ),
    Part(
        "crosstalk",
        "Ends of touches, crosstalk",
        ("python -m lab.crosstalk play FOLDER/found.json --first 7400",),
    ),
    Part(
        "paper-size",
        "Compared with other methods",
        (
            "python -m lab.comparison table --sets SETS",
            "python -m lab.paper table2 --sets SETS",
        ),
        keeps=ANSWERS_KEPT,
    ),
    Part(
        "large",
        "Compared with other methods",
        ("python -m lab.comparison large --sets SETS",),
        keeps=ANSWERS_KEPT,
    ),
    Part(
        "arm",
        "An arm commanded by touch",
        (
            "python -m lab.commanded_arm --builds 3 --seconds 60 --seed 33000 --only "
            "shifted divider logarithmic capacitive linear",
            "python -m lab.commanded_arm --builds 4 --seconds 60 --seed 33000 --only "
            "fresh",
        ),
    ),
    Part(
        "demo",
        "An arm commanded by touch",
        tuple(
            f"eskin demo --headless --seconds 300 --seed {seed}" for seed in (1, 4, 7)
        ),
    ),
    Part(
        "starts",
        "An arm commanded by touch",
        (
            "python -m lab.starts --seed 63000",
            "python -m lab.starts --seed 64000 --builds 10 --people 4",
        ),
    ),
    Part(
        "moving-arm",
        "An arm commanded by touch",
        (
            "python -m lab.moving_arm touches --seed 65000",
            "python -m lab.moving_arm lost --minutes 3 --builds 3",
        ),
    ),
    Part("clicks", "An arm commanded by touch", ("python -m lab.page_clicks",)),
    Part(
        "curve",
        "Operating curve",
        (
            "python -m lab.curve --sets SETS --clips 12 --seed 7 --picture "
            "FOLDER/curve.png",
        ),
        keeps=SETS_KEPT,
    ),
    Part("faults", "Faults and attacks", ("python -m lab.attacks faults",)),
    Part(
        "forgery",
        "Faults and attacks",
        ("python -m lab.attacks forgery --packets 1000000",),
    ),
    Part(
        "cable",
        "Faults and attacks",
        ("python -m lab.attacks delay", "python -m lab.attacks hold"),
    ),
    Part(
        "files",
        "Faults and attacks",
        ("python -m lab.attacks files", "python -m lab.attacks claims"),
    ),
    Part(
        "fuzz",
        "Faults and attacks",
        (
            "python -m lab.fuzz decoder --inputs 300000",
            "python -m lab.fuzz skin --inputs 4000",
            "python -m lab.fuzz recording --inputs 5000",
            "python -m lab.fuzz commands --inputs 4000",
            "python -m lab.fuzz model --inputs 2000",
            "python -m lab.fuzz urdf --inputs 2000",
        ),
    ),
    Part(
        "crush",
        "Faults and attacks",
        ("python -m lab.attacks crush --events 5 --each 5",),
        minutes=11,
    ),
    Part("kill", "Faults and attacks", ("python -m lab.soak kill",), minutes=1),
    Part("hour", "Faults and attacks", ("python -m lab.soak stream",)),
    Part("ur-stop", "Faults and attacks", ("python -m lab.ur_stop",)),
    Part(
        "one-scan",
        "Faults and attacks",
        ("python -m lab.one_scan --draws 400",),
        minutes=5,
    ),
    Part("rates", "Faults and attacks", ("python -m lab.csv_rates",), minutes=2),
    Part(
        "polarity",
        "Faults and attacks",
        ("python -m lab.polarity --builds 8",),
        minutes=2,
    ),
    Part(
        "events",
        "What does more than a person asked",
        (
            "python -m lab.attacks events --seed 53000 --only single streams --events "
            "4",
            "python -m lab.attacks events --seed 53000 --only mixes --events 8",
        ),
    ),
    Part(
        "events-kept",
        "What does more than a person asked",
        (
            "python -m lab.attacks events --seed 52000 --keep FOLDER/events.jsonl",
            "python -m lab.attacks events --kept FOLDER/events.jsonl",
            "python -m lab.attacks events --kept FOLDER/events.jsonl --only single "
            "--map paper",
        ),
    ),
    Part(
        "step",
        "Speed and memory",
        ("eskin bench latency", "python -m lab.latency"),
    ),
    Part("methods-step", "Speed and memory", ("python -m lab.paper table3",)),
    Part("scaling", "Speed and memory", ("python -m lab.scaling",)),
    Part(
        "load",
        "Speed and memory",
        ("python -m lab.sustained", "eskin bench throughput --over udp"),
    ),
    Part("start", "Speed and memory", ("python -m lab.start",)),
    Part("memory", "Speed and memory", ("python -m lab.memory",)),
    Part(
        "simulator",
        "The simulator against measured properties",
        ("python -m lab.simulation",),
        minutes=3,
    ),
)
"""Parts of the page, in its order."""
PARTS = {part.name: part for part in PAGE}


@dataclass(frozen=True)
class KeptOutput:
    """The output of one command, and what it was measured on."""

    command: str
    """Command as the page has it."""
    commit: str
    """Commit of the code."""
    date: str
    """Day and time at which it ended."""
    seconds: int
    """Time that it took [s]."""
    output: str
    """What it printed."""

    def format(self) -> str:
        """Format it for the kept file."""
        head = (
            f"$ {self.command}\n# commit {self.commit}, {self.date}, {self.seconds} s"
        )
        return f"{head}\n{self.output.strip()}\n"


@dataclass(frozen=True)
class ResultsCommand:
    """List the parts of docs/results.md, or run those that are missing."""

    what: tyro.conf.Positional[Literal["list", "run"]]
    """What to do."""
    parts: tyro.conf.Positional[tuple[str, ...]] = ()
    """Parts; all unless given."""
    sets: Path = Path("sets")
    """Folder of the simulated sets, and of what is kept."""
    data: Path = Path("../shared/data")
    """Folder of the public sets, with a folder for each."""
    minutes: float = math.inf
    """Time after which the command that runs is ended [min]."""


def find_commit(root: Path) -> str:
    """Find the last commit that changed the measured code.

    Raises:
        ValueError: this is no clone.
    """
    return run_git(root, "log", "-1", "--format=%h", "--abbrev=8").strip()


def find_changes(root: Path) -> list[str]:
    """Find what differs from the last commit in the measured code, new files too.

    Raises:
        ValueError: this is no clone.
    """
    lines = run_git(root, "status", "--porcelain").splitlines()
    return [line[3:] for line in lines]


def check_code(root: Path, commit: str) -> None:
    """Check that the measured code is that of a commit.

    Raises:
        ValueError: files differ from it, another is checked out, or this is no clone.
    """
    changes = find_changes(root)
    found = find_commit(root)
    if changes:
        got = f"{len(changes)} changed or new, such as {changes[0]}"
    elif found != commit:
        got = f"commit {found}"
    else:
        return
    raise ValueError(
        f"{root}: {got}; allowed is the code of commit {commit} until the run is over; "
        "commit or remove what differs, and run it again"
    )


def run_git(root: Path, *words: str) -> str:
    """Run a command of git on the measured code, and return what it prints.

    Raises:
        ValueError: this is no clone.
    """
    argv = ["git", *words, "--", *MEASURED]
    try:
        done = subprocess.run(
            argv, cwd=root, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError) as error:
        raise ValueError(
            f"{root}: got no commits; allowed is a clone of eskin with git; clone it"
        ) from error
    return done.stdout


def find_file(sets: Path, part: Part) -> Path:
    """Return the file that keeps the output of a part."""
    return sets / "kept" / f"{part.name}.txt"


def read_outputs(sets: Path, part: Part) -> dict[str, KeptOutput]:
    """Read the kept outputs of a part, by its commands; others are left out."""
    path = find_file(sets, part)
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    heads = list(ANSWER.finditer(text))
    ends = [head.start() for head in heads[1:]]
    found = {}
    for head, end in zip(heads, [*ends, len(text)], strict=False):
        output = KeptOutput(
            head["command"],
            head["commit"],
            head["date"],
            int(head["seconds"]),
            text[head.end() : end].strip(),
        )
        if output.command in part.commands:
            found[output.command] = output
    return found


def write_outputs(sets: Path, part: Part, outputs: dict[str, KeptOutput]) -> None:
    """Write the kept outputs of a part, in the order of its commands."""
    chosen = [outputs[command] for command in part.commands if command in outputs]
    with atomic_path(find_file(sets, part)) as path:
        path.write_text("\n".join(each.format() for each in chosen), encoding="utf-8")


def find_missing(part: Part, outputs: dict[str, KeptOutput], commit: str) -> list[str]:
    """Find the commands whose output is missing, or is not of a commit."""
    return [
        command
        for command in part.commands
        if command not in outputs or outputs[command].commit != commit
    ]


def build_argv(command: str, part: Part, sets: Path, data: Path) -> list[str]:
    """Return the words of a command, with this Python, in which the folders stand."""
    places = {"SETS": sets, "DATA": data, "FOLDER": find_folder(sets, part)}
    words = []
    for word in shlex.split(command):
        first, *rest = word.split("/")
        words.append("/".join([str(places.get(first, first)), *rest]))
    program, *options = words
    return [sys.executable, *(["-m", "eskin"] if program == "eskin" else []), *options]


def find_folder(sets: Path, part: Part) -> Path:
    """Return the folder that belongs to a part."""
    return sets / "kept" / part.name


def run_command(argv: Sequence[str], timeout: float) -> str:
    """Run a command from the root of the clone; return what it prints.

    Its errors and its progress go to the terminal, and where it fails, what it printed,
    too. Ctrl-C ends it, and with it all processes that it has started.

    Args:
        argv: its words.
        timeout: time after which it is ended [s].

    Raises:
        TimeoutError: the time is over.
        PartError: it fails.
    """
    environment = os.environ | {"PYTHONPATH": find_path()}
    with subprocess.Popen(
        argv,
        cwd=ROOT,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(
                timeout=None if math.isinf(timeout) else max(timeout, 0.0)
            )
        except subprocess.TimeoutExpired as error:
            raise TimeoutError from error
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
    if process.returncode != 0:
        print(output, flush=True)
        last = (output.strip().splitlines() or ["nothing"])[-1]
        raise PartError(
            f"'{shlex.join(argv)}' ended with {process.returncode}, and printed last: "
            f"{last}; correct what it says, and run the part again"
        )
    return output


def find_path() -> str:
    """Return the folders of modules: this process's, with the root of the clone."""
    return os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(ROOT)]))


def run_part(part: Part, command: ResultsCommand, commit: str, end: float) -> None:
    """Run the missing commands of a part, and keep what each prints.

    The folder of the part begins empty at each commit, so that nothing of another is
    measured.

    Args:
        part: the part.
        command: where the sets are.
        commit: commit of the code.
        end: time at which the command that runs is ended [s, monotonic clock].

    Raises:
        TimeoutError: the time is over.
        PartError: a command fails.
        ValueError: the code has changed while a command ran, whose output is not kept.
    """
    sets = command.sets.absolute()
    outputs = read_outputs(sets, part)
    missing = find_missing(part, outputs, commit)
    folder = find_folder(sets, part)
    mark = folder / "commit.txt"
    if missing and not (mark.exists() and mark.read_text() == commit):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        mark.write_text(commit)
    for words in missing:
        print(f"$ {words}", flush=True)
        argv = build_argv(words, part, sets, command.data.absolute())
        begun = time.monotonic()
        printed = run_command(argv, end - begun)
        check_code(ROOT, commit)
        date = datetime.now().strftime("%Y-%m-%d %H:%M")
        seconds = round(time.monotonic() - begun)
        outputs[words] = KeptOutput(words, commit, date, seconds, printed)
        write_outputs(sets, part, outputs)
        print(printed, flush=True)
    print(
        f"{part.name} is measured at commit {commit}, kept in {find_file(sets, part)}"
    )


def list_parts(parts: Sequence[Part], sets: Path, commit: str) -> Iterator[str]:
    """Yield the rows of a table that tells how much of each part is done."""
    yield format_head(
        ("part", "heading", "done", "of commit", "minutes", "goes on from")
    )
    for part in parts:
        outputs = read_outputs(sets, part)
        done = len(part.commands) - len(find_missing(part, outputs, commit))
        commits = dict.fromkeys(each.commit for each in outputs.values())
        measured = round(sum(each.seconds for each in outputs.values()) / 60)
        minutes = measured if len(outputs) == len(part.commands) else part.minutes
        cells = (
            part.name,
            part.heading,
            f"{done} of {len(part.commands)}",
            ", ".join(commits) or "none",
            "not measured" if minutes is None else str(minutes),
            part.keeps,
        )
        yield format_row(cells)


def choose_parts(names: Sequence[str]) -> list[Part]:
    """Return the parts of some names, or all.

    Raises:
        ValueError: there is no part of a name.
    """
    for name in names:
        if name not in PARTS:
            raise ValueError(f"part '{name}'; allowed are {', '.join(PARTS)}")
    return [PARTS[name] for name in names] if names else list(PAGE)


def run_results(command: ResultsCommand) -> dict[str, object]:
    """List parts, or run what is missing of them; return those that are done.

    Raises:
        ValueError: a part is not known, this is no clone, or the code is not that of
            its commit, before or after a command.
        PartError: a command has failed; the parts after it were run.
    """
    parts = choose_parts(command.parts)
    commit = find_commit(ROOT)
    failed = []
    if command.what == "list":
        changes = find_changes(ROOT)
        print("\n".join(list_parts(parts, command.sets, commit)))
        differs = f", and differs in {', '.join(changes)}" if changes else ""
        print(f"\nthe code is of commit {commit}{differs}")
    else:
        check_code(ROOT, commit)
        end = time.monotonic() + 60.0 * command.minutes
        for part in parts:
            try:
                run_part(part, command, commit, end)
            except TimeoutError:
                print(f"{command.minutes:g} min are over; run it again to go on")
                break
            except PartError as error:
                failed.append(f"{part.name}: {error}")
    if failed:
        raise PartError("; ".join(failed))
    left = {
        part.name: len(find_missing(part, read_outputs(command.sets, part), commit))
        for part in parts
    }
    return {"commit": commit, "missing": {k: v for k, v in left.items() if v}}


if __name__ == "__main__":
    sys.exit(run_program(run_results))
