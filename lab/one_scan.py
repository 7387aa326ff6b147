"""Put one scan of anything into a quiet stream, and press one second later.

    python -m lab.one_scan                  # 1,000 draws a skin
    python -m lab.one_scan --draws 50       # a quick look

A draw is a skin, a patch of it, a time and a scan of `SCANS`, in which the counts of
the patch, or of the whole skin, are wrong. One second later begins a poke of 5 N with
0.25 s on a random taxel of the patch; half of the draws also have one that the scan
falls into. The press is a Gaussian of 6 mm, noise is 1.5 counts, rest 200 of 4095.

A poke is felt if a touch opens while it lasts, and recognised if a detection follows
that says so. Where it is not felt, the patch has to be reported: an event names it, and
the policy holds the arm (`eskin.command.SkinMonitor`). The law:
99 % are felt or reported; at most 5 % of draws are reported, for at most 2 s.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eskin import MountedSkin, Recognizer, load_model, load_robot, load_skin
from eskin.app import nominal_calibration
from eskin.robot import Link, Robot
from eskin.skin import Patch, Plane, Skin, TaxelGrid, build_skin
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

RATE = 50
NOISE = 1.5
REST = 200
FORCE = 5.0
DURATION = 0.25
WIDTH = 0.006
"""Force [N], duration [s] and standard deviation [m] of a poke."""
BEFORE = (0.0, 8.0)
AFTER = 1.0
WATCHED = 1.5
"""Time of the scan, from it to the poke, and that a detection may take [s]."""

Counts = np.ndarray
"""(some) counts."""


def set_value(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return one value for all."""
    return np.full(len(counts), rng.choice([full, 0, -1, rng.integers(full)]))


def set_random(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return random values."""
    return rng.integers(0, full + 1, len(counts))


def set_part(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return the counts with a random share at one value."""
    chosen = rng.random(len(counts)) < rng.random()
    return np.where(chosen, set_value(rng, counts, full), counts)


def set_block(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return the counts with a run of them at one value, or at random ones."""
    start, end = np.sort(rng.integers(0, len(counts) + 1, 2))
    value = (set_value, set_random)[rng.integers(2)](rng, counts, full)
    return np.where((np.arange(len(counts)) - start) % len(counts) < end, value, counts)


def shift(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return the counts, moved up or down by the same."""
    return np.clip(counts + rng.integers(-full, full), 0, full)


def flip_bit(rng: np.random.Generator, counts: Counts, full: int) -> Counts:
    """Return the counts with one bit inverted."""
    return counts ^ (1 << int(rng.integers(12)))


SCANS: dict[str, Callable[[np.random.Generator, Counts, int], Counts]] = {
    "one value": set_value,
    "random": set_random,
    "part at one value": set_part,
    "block": set_block,
    "shifted": shift,
    "one bit": flip_bit,
}


@dataclass
class Outcome:
    """An outcome tells what a draw showed."""

    kind: str
    """Name of the scan."""
    felt: bool
    """Whether a touch opened during the poke."""
    gesture: str
    """Gestures that were detected after it began."""
    reported: float
    """Time for which a fault of the whole patch was reported [s]."""
    held: bool
    """Whether it was at the time of the poke."""
    false: int
    """Number of gestures detected between the scan and the poke, if none was made."""
    at: float
    """Time of the scan [s]."""


def build_panel(rows: int, columns: int) -> MountedSkin:
    """Build one flat patch with taxels 10 mm apart, which stands on the ground."""
    top = Patch("top", link="panel", address=1, rows=rows, columns=columns)
    grid = TaxelGrid(rows, columns, row_pitch=0.01, column_pitch=0.01)
    skin = build_skin("panel", [(top, grid, Plane(np.eye(4)))])
    return MountedSkin(skin, Robot("panel", (Link("panel", ()),), ()))


SKINS: dict[str, Callable[[], MountedSkin]] = {
    "ur5": lambda: MountedSkin(load_skin("ur5"), load_robot("ur5")),
    "panel of 120": lambda: build_panel(10, 12),
    "patch of 16": lambda: build_panel(4, 4),
}


def press(skin: Skin, taxel: int) -> np.ndarray:
    """Return the pressure (taxel) of a poke at its peak on one taxel [kPa]."""
    distance = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
    distance[skin.patch_index != skin.patch_index[taxel]] = 1.0
    spread = np.exp(-0.5 * (distance / WIDTH) ** 2)
    return FORCE * spread / (spread * skin.areas).sum() / 1e3


def draw(
    mounted: MountedSkin, recognizer: Recognizer, rng: np.random.Generator, kind: str
) -> Outcome:
    """Stream one draw, and return what it showed."""
    skin = mounted.skin
    calibration = nominal_calibration(mounted.skin)
    own = np.flatnonzero(skin.patch_index == rng.integers(len(skin.patches)))
    struck = own if rng.random() < 0.8 else np.arange(skin.count)
    at = round(rng.uniform(*BEFORE) * RATE)
    pokes = [at + round(AFTER * RATE)]
    if at > RATE and rng.random() < 0.5:
        pokes.append(at - int(rng.integers(1, round(DURATION * RATE))))
    profiles = [press(skin, rng.choice(own)) for _ in pokes]
    patch = skin.patches[skin.patch_index[own[0]]].id
    felt = False
    reported = 0
    held = False
    gestures = []
    false = 0
    for k in range(pokes[0] + round((DURATION + WATCHED) * RATE)):
        pressure = np.zeros(skin.count)
        for start, profile in zip(pokes, profiles, strict=True):
            phase = (k - start + 0.5) / (DURATION * RATE)
            if 0.0 < phase < 1.0:
                pressure += profile * np.sin(np.pi * phase) ** 0.5
        counts = REST + rng.normal(0.0, NOISE, skin.count)
        counts += calibration.compute_counts(pressure)
        counts = np.clip(np.round(counts), 0, calibration.full_scale).astype(np.int32)
        if k == at:
            counts[struck] = SCANS[kind](rng, counts[struck], calibration.full_scale)
        q = np.zeros(len(mounted.robot.joint_names))
        stamp = round((k + 1) * NS_PER_S / RATE)
        found = recognizer.push(Scan(stamp, counts, np.ones(skin.count, bool), q))
        state = recognizer.state
        assert state is not None
        out = any(f.patch == patch and f.kind == "patch" for f in state.faults)
        reported += out and k >= at
        if k >= pokes[0]:
            ends = pokes[0] + round(DURATION * RATE)
            began = round((pokes[0] - 1) * NS_PER_S / RATE)
            felt |= k < ends and any(touch.onset >= began for touch in state.open)
            held |= k < ends and out
            gestures += [detection.gesture for detection in found]
        elif k >= at and len(pokes) == 1:
            false += len(found)
    gestures += [detection.gesture for detection in recognizer.finish()]
    gesture = "+".join(sorted(set(gestures))) or "nothing"
    return Outcome(kind, felt, gesture, reported / RATE, held, false, at / RATE)


def main() -> None:
    """Draw, and print a table a skin."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=1000, help="draws a skin")
    parser.add_argument("--skins", nargs="+", choices=SKINS, default=list(SKINS))
    parser.add_argument("--seed", type=int, default=57)
    options = parser.parse_args()
    model = load_model("ur5")
    for name in options.skins:
        mounted = SKINS[name]()
        rng = np.random.default_rng(options.seed)
        calibration = nominal_calibration(mounted.skin)
        kinds = list(SCANS)
        outcomes = [
            draw(mounted, Recognizer(model, mounted, calibration), rng, kinds[n % 6])
            for n in range(options.draws)
        ]
        print(f"\n{name}, {options.draws} draws\n")
        print(format_head(("scan", "draws", "felt or held", "felt", "poke", "reported",
                           "longest [s]", "false gestures")))  # fmt: skip
        for kind in (*kinds, "all"):
            own = [each for each in outcomes if kind in (each.kind, "all")]
            print(format_row((kind, str(len(own)), *describe(own))))
        print(Counter(each.gesture for each in outcomes if each.gesture != "poke"))
        missed = [each for each in outcomes if not each.felt and not each.held]
        print("\n".join(map(str, missed[:10])))


def describe(outcomes: list[Outcome]) -> list[str]:
    """Return the cells of a row."""
    shares = [
        np.mean([each.felt or each.held for each in outcomes]),
        np.mean([each.felt for each in outcomes]),
        np.mean(["poke" in each.gesture for each in outcomes]),
        np.mean([each.reported > 0.0 for each in outcomes]),
    ]
    longest = max(each.reported for each in outcomes)
    false = sum(each.false for each in outcomes)
    return [*(f"{100 * share:.1f} %" for share in shares), f"{longest:.2f}", str(false)]


if __name__ == "__main__":
    main()
