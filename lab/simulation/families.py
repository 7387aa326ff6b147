"""Measure builds of every family as public recordings of real arrays were measured."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import Constants
from eskin.sim.sensor import FAMILIES, FLAWS, SensorBuild, draw_flawed_build, sense
from eskin.sim.sensor.flaws import RESISTIVE, Family
from eskin.sim.sensor.sensor import draw_reading_times
from eskin.skin import Skin, mount_skin
from lab.tables import format_head, format_row

PATCH = "forearm_front"
LOAD = 25.0
"""Pressure on the pressed block [kPa]."""
SIDE = 4
"""Rows and columns of the pressed block."""
REST = 60.0
HOLD = 66.0
PRESS = 0.6
PAUSE = 5.0
"""Seconds of rest, of the long hold, of each short press and of the pause after it."""
PRESSES = 8
CHIP = 405
"""Taxels of the array of which corrupt values were counted."""


@dataclass(frozen=True, eq=False)
class LoadRecording:
    """A load recording holds readings of one build under a known load."""

    build: SensorBuild
    """Build that was read."""
    level: Float[np.ndarray, "reading taxel"]
    """Counts by full scale; where a reading is lost, those of the one before."""
    received: Bool[np.ndarray, "reading taxel"]
    """Whether each count arrived."""
    block: Int[np.ndarray, "pressed"]
    """Pressed taxels."""
    skin: Skin
    """Skin of the taxels."""

    @property
    def rate(self) -> float:
        """Return the readings in a second."""
        return 1.0 / self.build.electronics.period

    @property
    def working(self) -> Int[np.ndarray, "some"]:
        """Return the taxels that are neither dead nor stuck nor intermittent."""
        defects = self.build.defects
        works = ~defects.dead & np.isnan(defects.stuck)
        if self.build.flaws:
            works[self.build.flaws.intermittent] = False
        return np.flatnonzero(works)

    @property
    def pressed(self) -> Int[np.ndarray, "some"]:
        """Return the pressed taxels that work."""
        return np.intersect1d(self.block, self.working)

    def sum_signal(self) -> Float[np.ndarray, "reading"]:
        """Return the summed conductance of the block."""
        return self.find_conductance().sum(axis=1)

    def find_conductance(self) -> Float[np.ndarray, "reading pressed"]:
        """Return the conductance of the pressed taxels, by the data sheet's curve."""
        level = self.level[:, self.pressed]
        above = level - np.median(level[: round(self.rate)], axis=0)
        plain = replace(self.build.calibration(self.skin), exponent=1.0, unfelt=0.0)
        full = self.build.electronics.full_scale
        plain = replace(plain, gain=np.ones(len(self.pressed)))
        return plain.compute_pressure(full * above)


def fill_lost(
    level: Float[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
) -> Float[np.ndarray, "reading taxel"]:
    """Return levels in which lost readings have the values of those before."""
    reading = np.arange(len(level))[:, None]
    last = np.maximum.accumulate(np.where(received, reading, 0), axis=0)
    return np.take_along_axis(level, last, axis=0)


def find_block(skin: Skin) -> Int[np.ndarray, "pressed"]:
    """Find the taxels of a square block in the middle of a patch."""
    taxels = np.asarray(skin.find_taxels(PATCH))
    rows, columns = skin.rows[taxels], skin.columns[taxels]
    first = [int(np.median(part)) - SIDE // 2 for part in (rows, columns)]
    inside = (rows >= first[0]) & (rows < first[0] + SIDE)
    return taxels[inside & (columns >= first[1]) & (columns < first[1] + SIDE)]


def record(
    build: SensorBuild, load: Float[np.ndarray, "time"], skin: Skin, seed: int
) -> LoadRecording:
    """Record a build under a load on a block of taxels [kPa], step by step."""
    block = find_block(skin)
    pressure = np.repeat(load[:, None], len(block), axis=1)
    counts, received = sense(pressure, block, build, skin, np.random.default_rng(seed))
    full = build.electronics.full_scale
    level = fill_lost(counts / full, received)
    return LoadRecording(build, level, received, block, skin)


def build_loads(step: float) -> dict[str, Float[np.ndarray, "time"]]:
    """Build the load of each recording: rest, a long hold, short presses [kPa]."""

    def hold(*parts: tuple[float, float]) -> Float[np.ndarray, "time"]:
        return np.concatenate([np.full(round(s / step), kpa) for s, kpa in parts])

    press = (PRESS, LOAD), (PAUSE, 0.0)
    return {
        "rest": hold((REST, 0.0)),
        "hold": hold((4.0, 0.0), (HOLD, LOAD)),
        "presses": hold((2.0, 0.0), *press * PRESSES),
    }


def measure_noise(rest: LoadRecording) -> Float[np.ndarray, "taxel"]:
    """Measure the noise of each taxel by successive differences."""
    level = rest.level
    return np.diff(level, axis=0).std(axis=0) / np.sqrt(2.0)


def measure_spectrum(rest: LoadRecording) -> float:
    """Measure the exponent of 1/f below 5 Hz, of the mean spectrum of taxels."""
    level = rest.level[:, rest.working]
    power = (abs(np.fft.rfft(level - level.mean(axis=0), axis=0)) ** 2).mean(axis=1)
    f = np.fft.rfftfreq(len(level), 1.0 / rest.rate)
    part = (f > 0.1) & (f < 5.0) & (power > 0.0)
    if not part.any():
        return 0.0
    return -float(np.polyfit(np.log(f[part]), np.log(power[part]), 1)[0])


def measure_shared(rest: LoadRecording) -> float:
    """Measure the share of the variance of differences that rows have in common."""
    patch = np.intersect1d(rest.skin.find_taxels(PATCH), rest.working)
    fast = np.diff(rest.level[:, patch], axis=0)
    spread = fast.std(axis=0)
    usual = (spread > 0.0) & (spread < 3.0 * np.median(spread) + 1e-9)
    fast = fast[:, usual] / spread[usual]
    rows = rest.skin.rows[patch[usual]]
    found = []
    for row in np.unique(rows):
        inside = fast[:, rows == row]
        if inside.shape[1] > 1:
            r = np.corrcoef(inside.T)
            found.append((r.sum() - len(r)) / (len(r) * (len(r) - 1)))
    return float(np.mean(found)) if found else 0.0


def measure_minutes(rest: LoadRecording) -> float:
    """Measure how far medians of 1 s move within the recording, at the 99th place."""
    second = round(rest.rate)
    whole = len(rest.level) // second * second
    level = rest.level[:whole, rest.working].reshape(-1, second, len(rest.working))
    return float(np.quantile(np.ptp(np.median(level, axis=1), axis=0), 0.99))


def measure_swinging(rest: LoadRecording) -> float:
    """Measure the share of taxels that swing by more than 16 % at rest."""
    level = rest.level
    return float(np.mean(np.ptp(level, axis=0) > 0.16))


def measure_touched_noise(hold: LoadRecording, rest: LoadRecording) -> float:
    """Measure the noise of pressed taxels by their own at rest."""
    first = round(10.0 * hold.rate)
    level = hold.level[first:, hold.pressed]
    touched = np.diff(level, axis=0).std(axis=0) / np.sqrt(2.0)
    own = measure_noise(rest)[hold.pressed]
    return float(np.median(touched) / max(np.median(own), 1e-9))


def measure_creep(hold: LoadRecording) -> float:
    """Measure the growth of the summed signal in a doubling of time, from 1 to 64 s."""
    signal = hold.sum_signal()
    start = round(4.0 * hold.rate)
    at = [start + round(2.0**n * hold.rate) for n in range(7)]
    smooth = [np.median(signal[place - 5 : place + 6]) for place in at]
    return float(np.mean(np.diff(np.log(smooth))))


def measure_gain(hold: LoadRecording) -> float:
    """Measure the deviation of ln conductance inside the contact."""
    part = slice(round(5.0 * hold.rate), round(6.0 * hold.rate))
    signal = np.median(hold.find_conductance()[part], axis=0)
    return float(np.log(signal[signal > 0.0]).std())


def measure_column_leak(hold: LoadRecording) -> float:
    """Measure what free taxels of pressed columns read, by the sum pressed there."""
    return measure_leak(hold, hold.skin.columns, hold.skin.rows)


def measure_row_leak(hold: LoadRecording) -> float:
    """Measure what free taxels of pressed rows read, by the sum pressed there."""
    return measure_leak(hold, hold.skin.rows, hold.skin.columns)


def measure_leak(hold: LoadRecording, line: np.ndarray, along: np.ndarray) -> float:
    """Measure leakage along lines, at least three taxels from the block."""
    rest = np.median(hold.level[: round(2.0 * hold.rate)], axis=0)
    first = slice(round(5.0 * hold.rate), round(15.0 * hold.rate))
    signal = hold.level[first].mean(axis=0) - rest
    patch = np.intersect1d(hold.skin.find_taxels(PATCH), hold.working)
    block = hold.pressed
    shares = []
    for number in np.unique(line[block]):
        inside = block[line[block] == number]
        others = patch[(line[patch] == number)]
        off = abs(along[others][:, None] - along[hold.block][None]).min(axis=1)
        far = others[off >= 3]
        shares += list(signal[far] / signal[inside].sum())
    return float(np.median(shares))


def measure_edges(presses: LoadRecording) -> tuple[float, float]:
    """Measure the medians of the time to rise 10-90 % and to fall 90-10 % [s]."""
    signal = presses.sum_signal()
    rises = []
    falls = []
    for press in range(PRESSES):
        start = round((2.0 + press * (PRESS + PAUSE)) * presses.rate)
        end = start + round(PRESS * presses.rate)
        part = signal[start - 5 : end + round(PAUSE * presses.rate) - 5]
        part = part / np.median(signal[end - 4 : end])
        peak = end - start + 5
        up = part[:peak]
        down = part[peak - 1 :]
        rises.append(np.argmax(up > 0.9) - np.argmax(up > 0.1))
        falls.append(find_last(down > 0.1) - find_last(down > 0.9))
    period = 1.0 / presses.rate
    return float(np.median(rises)) * period, float(np.median(falls)) * period


def find_last(flags: np.ndarray) -> int:
    """Return the last place of a first run of true flags."""
    return int(np.argmin(flags)) if not flags.all() else len(flags)


def measure_left(presses: LoadRecording, seconds: float) -> float:
    """Measure the share of the peak so long after a press, at the median."""
    signal = presses.sum_signal()
    left = []
    for press in range(PRESSES):
        end = round((2.0 + press * (PRESS + PAUSE) + PRESS) * presses.rate)
        after = end + round(seconds * presses.rate)
        before = np.median(signal[end - round((PRESS + 0.5) * presses.rate) :][:10])
        peak = np.median(signal[end - 4 : end]) - before
        left.append((np.median(signal[after - 2 : after + 3]) - before) / peak)
    return float(np.median(left))


def measure_shift(presses: LoadRecording) -> float:
    """Measure the share of pressed taxels off by more than 2 % after 1 s."""
    level = presses.level
    off = []
    for press in range(PRESSES):
        start = round((2.0 + press * (PRESS + PAUSE)) * presses.rate)
        end = start + round(PRESS * presses.rate)
        after = end + round(1.0 * presses.rate)
        before = np.median(level[start - 12 : start - 2, presses.pressed], axis=0)
        off.append(np.median(level[after : after + 10][:, presses.pressed], axis=0))
        off[-1] -= before
    return float(np.mean(abs(np.array(off)) > 0.02))


def measure_corrupt(rest: LoadRecording) -> float:
    """Measure the wrong values in a reading of an array of 405 taxels."""
    level = rest.level[:, rest.working]
    spike = abs(level[1:-1] - level[:-2]) > 0.3
    spike &= abs(level[1:-1] - level[2:]) > 0.3
    return float(CHIP * spike.mean())


def measure_repeated(rest: LoadRecording) -> float:
    """Measure the share of readings of a patch that are equal to the last."""
    patch = np.asarray(rest.skin.find_taxels(PATCH))
    level = rest.level[rest.received[:, patch[0]]][:, patch]
    return float(np.mean((np.diff(level, axis=0) == 0.0).all(axis=1)))


def measure_jitter(rest: LoadRecording) -> float:
    """Measure the deviation of stamps [ms]."""
    times = draw_reading_times(rest.build, 2000, np.random.default_rng(0))
    return 1e3 * float((times - np.arange(2000) / rest.rate).std())


Measure = Callable[[dict[str, LoadRecording]], float]
ROWS: tuple[tuple[str, str, float, float, Measure], ...] = (
    ("noise at rest, % of full scale", "S F C L: .02 to 1.7", 0.02, 1.7,
     lambda of: 100 * float(np.median(measure_noise(of["rest"])[of["rest"].working]))),
    ("taxels noisier than 3 x the median, %", "S F C L: 0 to 14", 0, 14,
     lambda of: 100 * count_noisy(of["rest"], 3.0)),
    ("noisier than 10 x, %", "S F C L: 0 to 2.7", 0, 2.7,
     lambda of: 100 * count_noisy(of["rest"], 10.0)),
    ("noise of touched taxels by that at rest", "S C: 1 to 10", 1, 10,
     lambda of: measure_touched_noise(of["hold"], of["rest"])),
    ("exponent of 1/f at rest", "S F V H: 0 to 1.9", -0.05, 1.9,
     lambda of: measure_spectrum(of["rest"])),
    ("variance at rest shared by a row", "L F: .01 to .23", -0.02, 0.23,
     lambda of: measure_shared(of["rest"])),
    ("1 s medians in a minute, p99 range, % of full scale", "S V: .05 to 5.2",
     0.05, 5.2, lambda of: 100 * measure_minutes(of["rest"])),
    ("reading at rest, median, % of full scale", "C M: 0 to 9", 0, 9,
     lambda of: 100 * float(np.median(of["rest"].level))),
    ("taxels that swing by > 16 % at rest, %", "L: 0 to .9", 0, 0.9,
     lambda of: 100 * measure_swinging(of["rest"])),
    ("deviation of ln conductance in a contact", "S V M: .15 to .9", 0.15, 0.9,
     lambda of: measure_gain(of["hold"])),
    ("creep in a doubling of time, %", "V S: 4 to 22 (resistive)", 4, 22,
     lambda of: 100 * measure_creep(of["hold"])),
    ("rise from 10 to 90 %, s", "V H: .01 to .61", 0.0, 0.61,
     lambda of: measure_edges(of["presses"])[0]),
    ("fall from 90 to 10 %, s", "V H: .01 to 1.12", 0.01, 1.12,
     lambda of: measure_edges(of["presses"])[1]),
    ("left of the peak after .1 s, %", "V C H: -1.8 to 12", -1.8, 12,
     lambda of: 100 * measure_left(of["presses"], 0.1)),
    ("left of the peak after .5 s, %", "V C H: -1.8 to 11", -1.8, 11,
     lambda of: 100 * measure_left(of["presses"], 0.5)),
    ("pressed taxels off by > 2 % after 1 s, %", "L: 0 to 50", 0, 50,
     lambda of: 100 * measure_shift(of["presses"])),
    ("column, by the sum pressed in it", "S C F L: .0001 to .05", -0.0005, 0.05,
     lambda of: measure_column_leak(of["hold"])),
    ("row, by the sum pressed in it", "F C L: -.013 to .02", -0.013, 0.02,
     lambda of: measure_row_leak(of["hold"])),
    ("lost readings, %", "V F C: .02 to 8", 0.02, 8,
     lambda of: 100 * float(1.0 - of["rest"].received.mean())),
    ("repeated readings, %", "F: 0 to 18", 0, 18,
     lambda of: 100 * measure_repeated(of["rest"])),
    ("corrupt values in a reading of 405", "F: 0 to .3", 0, 0.3,
     lambda of: measure_corrupt(of["rest"])),
    ("jitter of stamps, ms", "V S C F: .1 to 2.6", 0.1, 2.6,
     lambda of: measure_jitter(of["rest"])),
)  # fmt: skip
"""Rows of the table: quantity, measured range with its recordings, how to measure."""


def count_noisy(rest: LoadRecording, factor: float) -> float:
    """Return the share of working taxels so much noisier than the median."""
    noise = measure_noise(rest)[rest.working]
    return float(np.mean(noise > factor * max(np.median(noise), 1e-9)))


def measure_family(
    family: Family, builds: int, seed: int, skin: Skin, constants: Constants
) -> list[float]:
    """Measure builds of a family with all flaws typical; return medians over builds."""
    flaws = dict.fromkeys(FLAWS, "typical")
    found = []
    for number in range(builds):
        rng = np.random.default_rng([seed, number])
        build = draw_flawed_build("b", family, flaws, skin, constants, rng)
        loads = build_loads(build.electronics.step)
        of = {
            name: record(build, load, skin, seed + number)
            for name, load in loads.items()
        }
        found.append([measure(of) for *_, measure in ROWS])
    return np.median(found, axis=0).tolist()


def family_table(constants: Constants, builds: int, seed: int) -> str:
    """Return a table of what typical builds of each family show beside real arrays."""
    skin = mount_skin("ur5").skin
    columns = {
        family: measure_family(family, builds, seed, skin, constants)
        for family in FAMILIES
    }
    rows = [
        f"\n**Families, {builds} builds each with all flaws typical**\n",
        format_head(["quantity", "real arrays", *FAMILIES]),
    ]
    for number, (name, source, low, high, _) in enumerate(ROWS):
        cells = []
        for family, measured in columns.items():
            value = measured[number]
            applies = family in RESISTIVE or "(resistive)" not in source
            mark = " *" if applies and not low <= value <= high else ""
            cells.append(f"{value:.3g}{mark}")
        rows.append(format_row([name, source, *cells]))
    return "\n".join([*rows, "", "Values marked * lie outside what was measured."])
