"""Run the inputs of `../shared/cases` that once failed, each against its right result.

    python -m lab.cases                     # all, about ten minutes
    python -m lab.cases csv tactile_urdf    # those of some folders

A case is a command that runs in a copy of its folder, and what its output has to show.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from lab.tables import format_head, format_row

CASES = Path(__file__).parents[2] / "shared" / "cases"
MEMORY = 6_000_000
"""Memory that a command may use [kB], as the cases ask."""
LONGEST = 300
"""Time that it may take [s]."""


@dataclass(frozen=True)
class Case:
    """A case is a command and its right result."""

    folder: str
    command: str
    """Command for the shell; `python` and `eskin` are from this environment."""
    wanted: tuple[str, ...]
    """Patterns that the output has to contain."""
    unwanted: tuple[str, ...] = ("Traceback", "Segmentation")
    """Patterns that it must not contain."""
    code: int = 0
    """Its exit code."""
    memory: str = str(MEMORY)
    """Memory that it may use [kB]; a browser reserves much more than it uses."""

    def run(self, folder: Path) -> str:
        """Run it in a folder; return the mistake, empty if there is none."""
        binaries = Path(sys.executable).parent
        path = f"{binaries}{os.pathsep}{os.environ['PATH']}"
        try:
            done = subprocess.run(
                ["bash", "-c", f"ulimit -v {self.memory}; {self.command}"],
                cwd=folder,
                env=os.environ | {"PATH": path, "COLUMNS": "1000"},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=LONGEST,
            )
        except subprocess.TimeoutExpired:
            return f"not done after {LONGEST} s"
        wrong = [f"no '{each}'" for each in self.wanted if not has(each, done.stdout)]
        wrong += [f"'{each}'" for each in self.unwanted if has(each, done.stdout)]
        if done.returncode != self.code:
            wrong.append(f"exit code {done.returncode}, not {self.code}")
        last = (done.stdout.strip().splitlines() or [""])[-1]
        return f"{'; '.join(wrong)}; it says: {last[:200]}" if wrong else ""


def has(pattern: str, text: str) -> bool:
    """Return whether a pattern is found in a text."""
    return re.search(pattern, text, re.DOTALL) is not None


def load(folder: str, file: str, *wanted: str) -> Case:
    """Build a case that loads a URDF and reads the shape of its first link."""
    return Case(folder, f"python ../ext.py {file}", wanted, ("CRASH", "Traceback"))


def change(old: str, new: str, *wanted: str) -> Case:
    """Build a case that loads a URDF in which one place is changed."""
    command = f"sed 's|{old}|{new}|' mimic_of_mimic.urdf > changed.urdf"
    command += f"; {URDF.format('changed')} 2>&1 | tail -2"
    return Case("urdf_misc", command, wanted)


def feed(case: str, *wanted: str, skin: str = "pad", code: int = 0) -> Case:
    """Build a case that sends one disorder over a pseudo-terminal."""
    command = f"python mkskin.py; python feed.py {case} 5 {skin}"
    return Case("csv", command, (f"rc {code}", *wanted))


def convert(folder: str, file: str, *wanted: str, code: int = 0) -> Case:
    """Build a case that converts a file to a skin, and prints its taxels."""
    arm = " --robot-urdf panda_like.urdf --link base" if "gentact" in folder else ""
    command = f"eskin skin convert {file} out{arm} && cat out/taxels.csv"
    return Case(folder, command, wanted, code=code)


def train(folder: str, name: str, *wanted: str) -> Case:
    """Build a case that trains on one recording, which is refused."""
    command = (
        f"python make.py; eskin train {name}.mcap --start ur5 --out m.safetensors "
        "--train.epochs 1 --train.steps 3"
    )
    return Case(folder, command, wanted, code=2)


def connect(cause: str, *wanted: str) -> Case:
    """Build a case that commands a UR whose client fails for a cause."""
    return Case(
        "t4_ur_reason_lost",
        f"UR_CASE={cause} PYTHONPATH=fake:$PYTHONPATH eskin run --source sim:ur5 "
        "--robot ur://127.0.0.1 --ask terminal --allow-simulated-touch --seconds 4",
        wanted,
        code=2,
    )


VIEW = (
    "eskin run --source sim:ur5 --view --port 8777 > run.log & for each in $(seq 60); "
    "do grep -q http run.log && break; sleep 1; done; {}; kill %1"
)
"""Shows the page at port 8777 while a command looks at it."""
THROUGH = (
    'python fwd.py & sleep 2; python -c "import re, urllib.request as r; '
    "link = re.search(r'http://[^ ]*/', open('run.log').read()).group(); "
    "print(r.urlopen(link.replace('8777', '8779')).status)\"; kill %2"
)
"""Opens it through a tunnel with another port."""


def table(file: str, *wanted: str, code: int = 2) -> Case:
    """Build a case that converts a table of frames."""
    return Case(
        "t4_table_messages", f"python mk.py && {TABLE.format(file)}", wanted, code=code
    )


def name(first: str, second: str, *wanted: str, code: int = 0) -> Case:
    """Build a case that converts a table of two gestures, and prints its labels."""
    write = (
        "from mk import w; "
        f"w('a.csv', lab=lambda g, r: {{'poke': '{first}'}}.get(g, '{second}'))"
    )
    command = f'python -c "{write}" && {TABLE.format("a.csv")} && {LABELS}'
    return Case("t4_table_names_not_latin", command, wanted, code=code)


def sketch(form: str, *wanted: str, options: str = "", code: int = 0) -> Case:
    """Build a case that sends a form of lines to `eskin run` for six seconds."""
    command = f"python cli.py {form} '{options}'"
    return Case("t4_csv_hints", command, (f"rc {code}", *wanted))


TABLE = (
    "eskin convert table {} out --rows 8 --columns 8 --rate 50 --label gesture "
    "--person who"
)
LABELS = (
    'python -c "from eskin.recording import read_recording; '
    "print(*{each.gesture for each in read_recording('out/a-p0.mcap').labels})\""
)


def install_read_only(prepare: str, program: str, *wanted: str) -> Case:
    """Build a case that runs a copy of eskin where nothing can be written.

    Args:
        prepare: command that is run on the copy in `ro` before.
        program: program in Python, without double quotes.
        wanted: patterns that the output has to contain.
    """
    command = (
        f'rm -rf path home; python -c "{GAP}"; '
        f"cp -r {Path(__file__).parents[1] / 'src' / 'eskin'} ro; {prepare}; mkdir "
        "path home; mv ro path/eskin; chmod -R a-w path; chmod 555 home; ./nocap.sh "
        f'env -i PATH=$PATH HOME=$PWD/home PYTHONPATH=$PWD/path python -c "{program}"'
        "; ./nocap.sh env -i PATH=$PATH HOME=$PWD/home PYTHONPATH=$PWD/path eskin skin "
        "show ur5"
    )
    return Case("t4_read_only_install", command, (*wanted, "2112"))


def disable_jit(program: str, *wanted: str) -> Case:
    """Build a case that runs a program with numba's switch for debugging."""
    return Case("t4_numba_disable_jit", f"NUMBA_DISABLE_JIT=1 {program}", wanted)


def run_on_windows(program: str, code: int = 0) -> Case:
    """Build a case that runs a program where what Windows lacks is taken away."""
    command = f'PYTHONPATH=.:$PYTHONPATH python -c "import win; {program}"'
    right = r"\A[^\n]*eskin does not run on Windows[^\n]*\n\Z"
    return Case("t4_windows_names", command, (right,), code=code)


READY = (
    "from eskin.compiled import is_kept; from eskin.touch.contact_kernels import "
    "box_gap; print('ready', is_kept(box_gap))"
)
GAP = (
    "import numpy as np; from eskin.touch.contact_kernels import box_gap; "
    "print('gap', box_gap(np.zeros((2, 3)), np.ones((2, 3))))"
)
URDF = "python -c \"import eskin; print(eskin.load_robot('{}.urdf').joint_names)\""
DESIGN = "eskin skin design r.urdf --out d --density 1"
ALL_READ = r"wrong values 0.*used twice 0; steps back 0"
LIST = (
    Case("glitch_one_scan", "python try.py", (r"with one glitch scan: 1[34] of 14",)),
    Case(
        "situations",
        "python startzero.py",
        (r"sz_rest120 +pokes (\d+) felt \1 ",),
        (r"lost \[\d", "Traceback"),
    ),
    Case(
        "situations",
        "python make.py; python inv.py; for each in inverted press_inverted; do "
        "eskin run --source replay:out/$each.mcap --pace inf; done; "
        "eskin calibrate --help",
        (r"fall under pressure.*fall under pressure",),
    ),
    feed("hz_8", r"8 scans a second", ALL_READ),
    feed("hz_10", r"10 scans a second", ALL_READ),
    feed("hz_20", r"20 scans a second", ALL_READ),
    feed("burst_8", ALL_READ),
    feed("floats", ALL_READ),
    feed("row_per_line", ALL_READ),
    feed("brackets", ALL_READ),
    feed("lfcr", ALL_READ),
    feed("cr_only", ALL_READ),
    feed("nan_cells", r"no recording|wrong values"),
    feed("time_column_corner", r"may be a time.*time=ms", skin="pad63b", code=2),
    feed("time_column", r"time=ms", code=2),
    feed("decimal_comma_half", r"decimal=comma", code=2),
    feed("t_ms", r"time=ms", code=2),
    feed("label", r"label=DATA:", code=2),
    feed("row_more", r"72 numbers; allowed", code=2),
    load("dae_unit_cm", "r.urdf", r"size \[0\.2 0\.1 0\.3\]"),
    load("mesh_find_leftover", "r.urdf", "run xacro first"),
    load("mesh_parent_dir", "robot/r.urdf", r"OK .*size \[0\.2 0\.1 0\.3\]"),
    load("stl_lfs_pointer", "r.urdf", "git lfs pull"),
    Case("dae_unit_cm", DESIGN, ()),
    Case("stl_mm_no_scale", DESIGN, (r"300 m",), code=2),
    Case(
        "mesh_600k_triangles",
        "python make.py 320e3 && eskin skin check skin --robot r.urdf",
        (),
        code=0,
    ),
    Case("mesh_600k_triangles", f"python make.py 320e3 && {DESIGN}", ()),
    convert("tactile_urdf", "col_major.urdf", r"\n1,[^,]*,1,0,"),
    convert("tactile_urdf", "gaps.urdf", r",0,10,.*,0,200,"),
    convert("tactile_urdf", "xmlns.urdf"),
    convert("tactile_urdf", "xacro.urdf", "xacro", code=2),
    convert("icub_thermal_pads", "part.txt", r"10 taxels", r"2 .*thermal|thermal.* 2"),
    convert("gentact_2025", "unordered.csv", r"\n0,.*0\.01.*\n1,.*\n2,.*0\.03"),
    convert("gentact_2025", "isaac.csv"),
    Case(
        "ur_gripper",
        'python -c "from eskin import load_skin; from eskin.skin import save_skin; '
        "save_skin(load_skin('ur5'), 'skin')\"; eskin device skin --robot-urdf "
        "ur5_gripper.urdf --udp 127.0.0.1:9791 --play sim & sleep 5; eskin run "
        "--source udp://127.0.0.1:9791 --skin skin --robot-urdf ur5_gripper.urdf "
        "--robot sim:ur5 --allow-unauthenticated --seconds 5; kill %1",
        ("finger_joint", r"\d{2} readings"),
    ),
    Case("urdf_misc", URDF.format("mimic_of_mimic"), ()),
    Case("urdf_misc", URDF.format("floating"), ("is taken as fixed",)),
    Case("urdf_misc", URDF.format("declaration_not_first"), ()),
    Case("urdf_misc", URDF.format("quaternion_origin"), ()),
    change("<axis", '<origin rpy="0 0 90"/><axis', r"degrees.*radians"),
    change("<geometry>", "<origin/><origin/><geometry>", r"2 <origin>.*one"),
    change('<link name="d">', '<link name="d"><link name="e"/>', r"in robot; move"),
    change('lower="-1"', 'lower="-0_1"', r"'-0_1'; wanted: 1 finite number"),
    change('lower="-1"', 'lower="-90"', r"degrees.*radians"),
    Case(
        "t4_icub_bad_units",
        "python icub.py",
        (r"== millimetres 2.*19\.5 m wide.*millimetres", r"12 of 12 taxels lie"),
    ),
    Case(
        "t4_page_no_webgl",
        VIEW.format("python b2.py"),
        (r"no WebGL long.*\nTrue .*this browser has no WebGL",),
        memory="unlimited",
    ),
    Case("t4_page_other_port", VIEW.format(THROUGH), (r"\b200\b",)),
    Case(
        "t4_lerobot_gap",
        "python d1.py; for each in zero_first gap_30d gap_1h; do "
        "eskin export $each.mcap --lerobot $each; done; "
        "eskin run --source replay:zero_first.mcap",
        (
            r"55 years without.*1 episode, 999 frames",
            r"30 days without.*2 episodes, 1000 frames",
            r"60 minutes without.*2 episodes, 1000 frames",
            r"skipped 55 years without readings.*1000 readings",
        ),
    ),
    Case(
        "t4_stamps_in_us",
        "python d1.py; eskin replay in_us.mcap",
        (r"in_us.mcap: 50,000 scans a second.*in_us.mcap: 50,000 scans a second",),
    ),
    train("t4_train_refuses_own_model", "weird_names", r"weird_names.mcap, label at 2"),
    train("t4_train_refuses_own_model", "long_name", r"label at 2.93 s.*300 bytes"),
    train("t4_train_refuses_own_model", "newline_name", r"label at 2.93 s.*printed"),
    train(
        "t4_train_wrong_label_times",
        "late_labels",
        r"8 of 8 labels hold no touch.*1\.4\d s earlier",
    ),
    train("t4_train_wrong_label_times", "far_labels", r"8 of 8 labels lie outside"),
    train(
        "t4_train_wrong_label_times",
        "overlap",
        r"'poke' from 2\.93 to 3\.33 s and 'stroke' from 2\.93 to 3\.33 s overlap",
    ),
    connect("registers", r"already in use.*PROFINET"),
    connect("local_6s", "Failed to start control script.*remote control, and end"),
    connect("hang", "has not answered for 20 s.*address and cable"),
    connect("abort", "client .* has ended.*connect again"),
    connect("not_running", "reached, but its program"),
    Case(
        "t4_csv_hints",
        "python try.py",
        (
            r"word START +scans 150 read 149 right 149",
            r"END after +scans 150 read 149 right 149",
            r"----- after +scans 150 read 149 right 149",
            r"===== after +scans 150 read 149 right 149",
            r"R0: a,b [^\n]*label=R\*:",
            r'"t":..,"d":\[..\]} +scans 150 read 149 right 149',
            r"0x100..0x109 scans 150 read 0 [^\n]*base=16",
            r"us at the end [^\n]*give csv:/dev/x,last=ignore",
            r"number at the end [^\n]*last=ignore if the last is no count",
            r"prefix of the IDE [^\n]*label=\* ->",
            r"-1 where a cell is missing [^\n]*missing=-1",
        ),
        (r"wrong [1-9](?![^\n]*\n63 taxels)", "Traceback"),
    ),
    sketch("start", r"1[0-5]\d readings"),
    sketch("start", "does not begin with 'START'", options=",label=START", code=2),
    sketch("frameno", "last=ignore if the last is no count", code=2),
    sketch("ide", r"label=\* ->", code=2),
    sketch("ide", "readings", options=",label=* ->"),
    sketch("hex", "base=10 if .*base=16 if", code=2),
    sketch("json", "readings"),
    sketch("json", "readings", options=",time=ms"),
    install_read_only("true", READY, "ready True"),
    install_read_only(
        "find ro -name __pycache__ | xargs rm -r", GAP, "gap 1.0", "set NUMBA_CACHE_DIR"
    ),
    disable_jit("eskin doctor", "weights ur5: recognises"),
    disable_jit("python -c \"import eskin; print(eskin.Recognizer.load('ur5'))\""),
    run_on_windows(
        "import eskin, eskin.errors\ntry: eskin.load_robot('x.urdf')\n"
        "except eskin.errors.PlatformError as error: print(error)"
    ),
    run_on_windows(
        "import sys; sys.argv = ['eskin', 'run', '--source', 'sim:ur5']; "
        "from eskin.cli.main import main; main()",
        code=2,
    ),
    table("nan.csv", "line 51, column c63 is nan"),
    table("utf16.csv", "8 labels", code=0),
    table("semi_deccomma.csv", "line 2, column c0.*commas are decimal here"),
    table("latin.csv", "line 2 is no UTF-8.*save it as UTF-8"),
    name("轻拍", "抚摸", "轻拍", "抚摸"),
    name("нажать", "гладить", "нажать", "гладить"),
    name("👋", "👆", "👋", "👆"),
    name("swipe+", "swipe-", r"swipe\+", "swipe-"),
    name("drücken", "stroke", "drücken", "stroke"),
    name("Poke", "poke", "'Poke' and 'poke' differ only in case", code=2),
)


def main() -> int:
    """Run the cases; return 1 where one is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of cases; none for all")
    options = parser.parse_args()
    chosen = [c for c in LIST if not options.folders or c.folder in options.folders]
    failed = 0
    print(format_head(("folder", "command", "right")))
    with tempfile.TemporaryDirectory() as name:
        place = shutil.copytree(CASES, Path(name) / "cases")
        for case in chosen:
            wrong = case.run(place / case.folder)
            failed += bool(wrong)
            print(format_row((case.folder, case.command, wrong or "yes")), flush=True)
    print(f"\n{len(chosen) - failed} of {len(chosen)} are right")
    return failed > 0


if __name__ == "__main__":
    sys.exit(main())
