"""Play the same counts to the front ends of two checkouts, and compare what they say.

    python -m lab.front_ends make FOLDER               # simulate the worlds, once
    python -m lab.front_ends play FOLDER OUT.json      # by the eskin that is imported
    python -m lab.front_ends compare A.json B.json ... # a table, a column a file

Worlds are counts of each family of sensors on the arm's skin: untouched with all flaws
typical; touches of people on such builds and on builds as drawn; and untouched builds
without flaws, on which `play` puts faults from the start or from 20 s on, and pats on
one, two and four taxels, alone and on and beside a row that floats. `play` gives the
counts to a recogniser with the nominal calibration. A touch opens where it is first
shown.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from eskin import MountedSkin, Recognizer
from eskin.recording import TruthRecord
from eskin.sim.sensor import FAMILIES
from eskin.skin import Skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.attacks import skin_faults
from lab.attacks.skin_faults import FaultTarget, FaultySkin, build_target
from lab.flaws.scoring import TrueContact, Watcher, score_touch
from lab.flaws.stream import (
    ALL,
    INTACT,
    BuildPlan,
    BuildRun,
    build_live_skin,
    build_truth,
    get_model,
)
from lab.tables import format_head, format_row

Found = dict[str, dict[str, float]]
"""Figures by their names, by row, family and build."""
SETTLING = 5.0
"""Time after the start that is not counted [s]."""
LATE = 20.0
"""Time at which a fault begins that is not there from the start [s]."""
PATS = 40
INTERVAL = 0.6
DURATION = 0.2
"""Pats of a row, the time from one to the next, and the duration of each [s]."""
FIRST_PAT = 8.0
PAT = 20.0
"""Median of the peak pressures of pats [kPa]."""
LADDER = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.3, 16.0, 22.6)
"""Peak pressures at which one taxel is pressed, each four times [kPa]."""
ONSET = 0.06
END = 0.1
"""Largest errors of an onset and of an end [s]."""


def float_column(target: FaultTarget) -> np.ndarray:
    """Choose the taxels of a column of at least five taxels."""
    turned = replace(target, skin=replace_rows(target.skin))
    return skin_faults.choose_row(turned)


def replace_rows(skin: Skin) -> Skin:
    """Return a skin whose rows are the columns of another one."""
    return replace(skin, rows=skin.columns, columns=skin.rows)


def shift_taxels(target: FaultTarget) -> skin_faults.Disturbance:
    """Return offsets of 1 % of the taxels that jump every five seconds."""
    taxels = skin_faults.choose(target, 0.01)
    rng = target.rng
    offset = np.zeros(target.skin.count)
    last = 0.0

    def disturb(seconds: float) -> np.ndarray:
        nonlocal last
        jumps = rng.random(len(taxels)) < (seconds - last) / 5.0
        last = seconds
        offset[taxels[jumps]] = rng.uniform(-60.0, 60.0, int(jumps.sum()))
        return offset

    return disturb


def ramp(target: FaultTarget) -> skin_faults.Disturbance:
    """Return 1 % of the taxels that rise or fall by 10 counts a second, to 150."""
    slope = np.zeros(target.skin.count)
    taxels = skin_faults.choose(target, 0.01)
    slope[taxels] = target.rng.choice([-10.0, 10.0], len(taxels))
    return lambda seconds: np.clip(slope * seconds, -150.0, 150.0)


def stick(target: FaultTarget) -> skin_faults.Disturbance:
    """Return 1 % of the taxels that are pulled to full scale."""
    stuck = np.zeros(target.skin.count)
    stuck[skin_faults.choose(target, 0.01)] = target.full_scale / target.unit
    return lambda seconds: stuck


FAULTS: dict[str, Callable[[FaultTarget], skin_faults.Disturbance]] = {
    **{name: make for name, make in skin_faults.FAULTS.items() if name != "none"},
    "5 % noisy, sigma 9": lambda target: skin_faults.add_noise(target, 0.05, 9.0),
    "floating column": lambda target: skin_faults.add_white(
        target, float_column(target), skin_faults.FLOATING
    ),
    "floating column, slow": lambda target: skin_faults.wander(
        target, float_column(target)
    ),
    "offset jumps": shift_taxels,
    "slow ramp": ramp,
    "stuck at full scale": stick,
}


def list_worlds(
    seconds: float, builds: int, touches: int
) -> list[tuple[str, str, int, float, int]]:
    """List the worlds to simulate, by the arguments of `make_world`."""
    worlds: list[tuple[str, str, int, float, int]] = []
    for n, family in enumerate(FAMILIES):
        for number in range(n, len(FAMILIES) * builds, len(FAMILIES)):
            worlds += [
                ("rest", ALL, number, seconds, 0),
                ("touch", ALL, number, SETTLING, touches),
                ("touch", family, number, SETTLING, touches),
            ]
        worlds.append(("calm", INTACT, n, 60.0, 0))
    return worlds


def make_world(
    folder: Path, kind: str, row: str, number: int, seconds: float, touches: int
) -> None:
    """Simulate one world and store it."""
    run = Recorded(BuildPlan(row, number, 0.0, 0))
    run.wait(seconds)
    rows = []
    gestures = ("poke", "double_pat", "grab", "stroke")
    for k in range(touches):
        start = len(run.scans_kept)
        truth = run.perform(gestures[k % 4])
        if truth.pressed.any():
            rows.append((start, truth))
    scans = run.scans_kept
    arrays = {
        "stamps": np.array([scan.stamp for scan in scans]),
        "counts": np.array([scan.counts for scan in scans], np.uint16),
        "received": np.packbits([scan.received for scan in scans], axis=1),
        "q": run.q,
        "spans": np.array([(s, len(t.stamps)) for s, t in rows]).reshape(-1, 2),
        "gestures": np.array([t.gesture for _, t in rows], str),
    }
    for n, (_, truth) in enumerate(rows):
        arrays[f"force{n}"] = truth.force
        arrays[f"centre{n}"] = truth.centre
    name = f"{kind}-{row.replace(' ', '_')}-{number}.npz"
    np.savez_compressed(folder / name, **arrays)


class Recorded(BuildRun):
    """A run that keeps its scans, and recognises none."""

    def __init__(self, plan: BuildPlan) -> None:
        """Draw build, person and pose."""
        super().__init__(plan)
        self.scans_kept: list[Scan] = []
        self.watcher = self  # type: ignore[assignment]

    def push(self, scan: Scan) -> None:
        """Keep a scan."""
        self.scans_kept.append(scan)

    def perform(self, gesture: str) -> TrueContact:
        """Perform a touch and a pause; return the truth."""
        self.truths: list[TruthRecord] = []
        self.stamps = []
        self.forces = []
        self.live.hand.perform(gesture)
        while self.live.hand.touching:
            self.scan()
        self.wait(self.rng.uniform(1.5, 3.0))
        return build_truth(self.truths, self.stamps, self.forces)


@lru_cache(maxsize=2)
def find_skin(row: str, number: int) -> tuple[MountedSkin, Calibration]:
    """Return the skin of a world and the calibration of its build."""
    live = build_live_skin(row, number, 70_000 + number)
    return live.mounted, live.calibration


class Player:
    """A player gives scans to a recogniser, and counts openings and detections."""

    def __init__(self, row: str, number: int) -> None:
        """Build the recogniser of a world."""
        mounted, self.calibration = find_skin(row, number)
        self.skin = mounted.skin
        recognizer = Recognizer(get_model("ur5"), mounted, self.calibration)
        self.watcher = Watcher(recognizer)

    def push(self, scan: Scan) -> None:
        """Process the next scan."""
        self.watcher.push(scan)

    def tally(self) -> dict[str, float]:
        """Return what was counted so far."""
        rest = self.watcher.rest
        return {"openings": rest.openings, "detections": rest.detections}


def read_scans(data: dict[str, np.ndarray]) -> Iterator[Scan]:
    """Yield the scans of a world."""
    count = data["counts"].shape[1]
    received = np.unpackbits(data["received"], axis=1, count=count).astype(bool)
    for n, stamp in enumerate(data["stamps"].tolist()):
        counts = data["counts"][n].astype(np.int32)
        yield Scan(stamp, counts, received[n], data["q"])


def play_rest(data: dict, row: str, number: int) -> dict[str, float]:
    """Play an untouched world."""
    player = Player(row, number)
    for scan in read_scans(data):
        player.push(scan)
    return player.tally() | {"hours": player.watcher.rest.seconds / 3600}


def play_touches(data: dict, row: str, number: int) -> dict[str, float]:
    """Play touches, and score their onsets and ends."""
    player = Player(row, number)
    scans = list(read_scans(data))
    names = ("onsets", "ends", "forced", "touches")
    result: dict[str, float] = dict.fromkeys(names, 0.0)
    done = 0
    for n, (start, size) in enumerate(data["spans"].tolist()):
        for scan in scans[done:start]:
            player.push(scan)
        done = start + size
        player.watcher.follow()
        for scan in scans[start:done]:
            player.push(scan)
        stamps = data["stamps"][start:done]
        gesture = str(data["gestures"][n])
        truth = TrueContact(gesture, stamps, data[f"force{n}"], data[f"centre{n}"])
        if truth.peak < 1.0:
            continue
        assert player.watcher.trails is not None
        score = score_touch(truth, player.watcher.trails)
        onset = score.onset_error
        end = score.end_error
        result["touches"] += 1
        result["onsets"] += onset is not None and abs(onset) <= ONSET
        result["ends"] += end is not None and abs(end) <= END
        result["forced"] += score.forced == gesture
    return result


def play_fault(
    data: dict, row: str, number: int, fault: str, start: float
) -> dict[str, float]:
    """Play an untouched world with a fault that begins at a time [s]."""
    player = Player(row, number)
    target = build_target(player.skin, player.calibration, number)
    faulty = FaultySkin.__new__(FaultySkin)
    faulty.target = target
    faulty.disturb = FAULTS[fault](target)
    faulty.first = None
    first = int(data["stamps"][0])
    for scan in read_scans(data):
        if scan.stamp - first >= start * NS_PER_S:
            scan = faulty.corrupt(scan)
        player.push(scan)
    return player.tally()


def choose_pads(skin: Skin, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Choose one, two and four neighbouring taxels of a row, and four of two rows."""
    places = {
        (p, r, c): i
        for i, (p, r, c) in enumerate(
            zip(skin.patch_index, skin.rows, skin.columns, strict=True)
        )
    }
    while True:
        p, r, c = list(places)[int(rng.integers(len(places)))]
        row = [places.get((p, r, c + k)) for k in range(5)]
        after = [places.get((p, r + 1, c + k)) for k in range(5)]
        beside = [places.get((p, r + 3, c + k)) for k in range(2)]
        below = [places.get((p, r + 4, c + k)) for k in range(2)]
        if None not in (*row, *after, *beside, *below):
            return {
                "1 of a line": np.array(row[:1]),
                "2 of a line": np.array(row[:2]),
                "4 of a line": np.array(row[:4]),
                "4 of two lines": np.array([*row[:2], *after[:2]]),
                "beside": np.array([*beside, *below]),
            }


def press(
    player: Player,
    data: dict,
    taxels: np.ndarray,
    peaks: np.ndarray,
    floating: np.ndarray | None = None,
    slow: bool = False,
) -> np.ndarray:
    """Press some taxels again and again; return which presses were felt in time.

    `floating` are taxels that float from the start.
    """
    skin = player.skin
    calibration = player.calibration
    add = None
    target = build_target(skin, calibration, 3)
    if floating is not None:
        make = skin_faults.wander if slow else skin_faults.add_white
        add = make(target, floating, *(() if slow else (skin_faults.FLOATING,)))
    first = int(data["stamps"][0])
    felt = np.zeros(len(peaks), bool)
    player.watcher.follow()
    for scan in read_scans(data):
        t = (scan.stamp - first) / NS_PER_S
        counts = scan.counts.astype(float)
        if add is not None:
            counts += add(t) * target.unit
        k, phase = divmod(t - FIRST_PAT, INTERVAL)
        if k >= len(peaks) + 1:
            break
        if 0 <= k < len(peaks) and 0.0 < phase < DURATION:
            pressure = np.zeros(skin.count)
            pressure[taxels] = peaks[int(k)] * np.sin(np.pi * phase / DURATION) ** 0.5
            counts += calibration.compute_counts(pressure)
        counts = np.clip(np.round(counts), 0, calibration.full_scale).astype(np.int32)
        player.push(replace(scan, counts=counts))
    trails = player.watcher.trails or {}
    samples = [one for trail in trails.values() for one in trail.samples]
    stamps = np.array([one.stamp for one in samples if one.force > 0.0])
    times = (stamps - first) / NS_PER_S - FIRST_PAT
    numbers, phases = np.divmod(times, INTERVAL)
    for n in numbers[phases < DURATION + 0.02].astype(int):
        if 0 <= n < len(peaks):
            felt[n] = True
    late = (phases > DURATION + END) & (phases < INTERVAL - 0.02)
    for n in np.unique(numbers[late].astype(int)):
        if 0 <= n < len(peaks):
            felt[n] = False  # It goes on for too long after the press.
    return felt


def play_pats(data: dict, row: str, number: int) -> Found:
    """Pat taxels of a calm world."""
    rng = np.random.default_rng(number)
    result: Found = {}
    skin = Player(row, number).skin
    pads = choose_pads(skin, rng)
    line = np.flatnonzero(
        (skin.rows == skin.rows[pads["1 of a line"][0]])
        & (skin.patch_index == skin.patch_index[pads["1 of a line"][0]])
    )
    peaks = PAT * np.exp(0.3 * rng.standard_normal(PATS))
    for name in ("1 of a line", "2 of a line", "4 of a line", "4 of two lines"):
        felt = press(Player(row, number), data, pads[name], peaks)
        result[f"pats, {name}"] = {
            "felt": int(felt.sum()),
            "last": int(felt[-10:].sum()),
        }
    for slow in (False, True):
        what = "slow" if slow else "white"
        for name, pad in (("on", "4 of two lines"), ("beside", "beside")):
            felt = press(Player(row, number), data, pads[pad], peaks, line, slow)
            result[f"pats {name} a floating row, {what}"] = {"felt": int(felt.sum())}
    ladder = np.repeat(LADDER, 4)
    felt = press(Player(row, number), data, pads["1 of a line"], ladder)
    share = felt.reshape(-1, 4).sum(axis=1)
    right = share >= 3
    lightest = next((LADDER[n] for n in range(len(LADDER)) if right[n:].all()), 99.0)
    result["lightest press of one taxel"] = {"kPa": lightest}
    return result


def list_plays(
    folder: Path, only: list[str], families: list[str], named: list[str]
) -> list[tuple[Path, str, str, float]]:
    """List what to play: a world, of which kind, and a fault with its start."""
    plays: list[tuple[Path, str, str, float]] = []
    for path in sorted(folder.glob("*.npz")):
        kind, _, number = path.stem.split("-")
        if FAMILIES[int(number) % 4] not in families:
            continue
        if kind in only:
            plays.append((path, kind, "", 0.0))
        if kind == "calm" and "pats" in only:
            plays.append((path, "pats", "", 0.0))
        if kind == "calm" and "faults" in only:
            names = [name for name in FAULTS if any(part in name for part in named)]
            plays += [(path, "", name, at) for name in names for at in (0.0, LATE)]
    return plays


def play(path: Path, kind: str, fault: str, start: float) -> Found:
    """Play a world; return what was counted, by row, family and build."""
    _, name, number = path.stem.split("-")
    row = name.replace("_", " ")
    n = int(number)
    with np.load(path) as file:
        data = dict(file)
    if kind == "pats":
        found = play_pats(data, row, n)
    elif kind == "touch":
        label = "typical" if row == ALL else "as drawn"
        found = {f"touch {label}": play_touches(data, row, n)}
    elif kind == "rest":
        found = {"rest": play_rest(data, row, n)}
    else:
        when = "from 20 s" if start else "from the start"
        found = {f"{fault}, {when}": play_fault(data, row, n, fault, start)}
    return {f"{what}|{FAMILIES[n % 4]}|{n}": one for what, one in found.items()}


def compare(paths: list[Path]) -> None:
    """Print the sums over families and builds of each row, a column a file."""
    files = [json.loads(path.read_text("utf-8")) for path in paths]
    print(format_head(["row", "figure", *(path.stem for path in paths)]))
    rows = list(dict.fromkeys(key.split("|")[0] for file in files for key in file))
    totals: dict[str, np.ndarray] = {}
    for row in rows:
        keys = [key for key in files[0] if key.split("|")[0] == row]
        for figure in files[0][keys[0]] if keys else ():
            cells = []
            sums = []
            for file in files:
                parts = [file[key][figure] if key in file else np.nan for key in keys]
                sums.append(float(np.sum(parts)))
                each = "/".join(f"{part:.3g}" for part in parts)
                cells.append(f"{sums[-1]:.4g} ({each})")
            for when in ("from the start", "from 20 s"):
                if row.endswith(when):
                    key = f"all faults, {when}|{figure}"
                    totals[key] = totals.get(key, np.zeros(len(files))) + sums
            if len(set(cells)) > 1 or not row.endswith(("start", "20 s")):
                print(format_row([row, figure, *cells]))
    for key, sums in totals.items():
        print(format_row([*key.split("|"), *(f"{one:g}" for one in sums)]))


def main() -> None:
    """Make worlds, play them, or compare what files of figures say."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("part", choices=("make", "play", "compare"))
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=125.0)
    parser.add_argument("--builds", type=int, default=2)
    parser.add_argument("--touches", type=int, default=12)
    parts = ["rest", "touch", "pats", "faults"]
    parser.add_argument("--only", nargs="+", default=parts, choices=parts)
    kinds = list(FAMILIES)
    parser.add_argument("--families", nargs="+", default=kinds, choices=kinds)
    parser.add_argument("--named", nargs="+", default=[""], help="parts of fault names")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    folder = options.paths[0]
    if options.part == "compare":
        compare(options.paths)
        return
    with ProcessPoolExecutor(options.workers) as pool:
        if options.part == "make":
            folder.mkdir(parents=True, exist_ok=True)
            worlds = list_worlds(options.seconds, options.builds, options.touches)
            list(
                pool.map(make_world, [folder] * len(worlds), *zip(*worlds, strict=True))
            )
            return
        plays = list_plays(folder, options.only, options.families, options.named)
        found = list(pool.map(play, *zip(*plays, strict=True)))
    merged = {key: one for part in found for key, one in part.items()}
    options.paths[1].write_text(json.dumps(merged, indent=1), "utf-8")


if __name__ == "__main__":
    main()
