"""Compiled kernels that turn counts into pressure and compensate crosstalk."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled


class Rates(NamedTuple):
    """Time constants [s] and fractions of `calibrate`; see `CalibrationConfig`."""

    tare_step: float
    tare_rank: float
    drift: float
    low: float
    freeze: float
    longest: float
    stale: float
    fade: float
    after: float
    relearn: float
    silence: float
    steady: float
    still: float
    kept: float
    settle: float


class PressureCurve(NamedTuple):
    """How pressure grows with counts."""

    full: float
    """Counts at which a divider saturates, infinite where there is none."""
    power: float
    """Power of conductance that pressure is."""
    unfelt: float
    """Pressure that closes the sensor [kPa]."""


class Memory(NamedTuple):
    """What `calibrate` remembers of each taxel; counts and seconds."""

    baseline: np.ndarray
    """Counts at rest."""
    peak: np.ndarray
    """Fading largest counts above the baseline."""
    low: np.ndarray
    """Counts of the last scan if they were too low, else infinite."""
    heard: np.ndarray
    """When the taxel was last received."""
    since: np.ndarray
    """When it began to be touched, infinite while it is not."""
    held: np.ndarray
    """When it or a neighbour was last touched."""
    steady: np.ndarray
    """Counts about which it has been steady."""
    steady_at: np.ndarray
    """Since when."""
    due: np.ndarray
    """When the next sample of the tare is taken."""
    filled: np.ndarray
    """How many samples the tare has."""
    samples: np.ndarray
    """The samples of the tare, ascending (taxel, sample)."""


SURE = 4

MOST = 0.999
"""Part of a divider's full scale above which pressure is not told apart."""


@compiled
@no_type_check
def linearise_counts(above: float, bend: PressureCurve) -> float:
    """Counts above rest as a linear device with the same gain would give them."""
    if above <= 0.0 or bend.full == np.inf:
        return max(above, 0.0)
    share = min(above / bend.full, MOST)
    conductance = share / (1.0 - share)
    if bend.power != 1.0:
        conductance **= bend.power
    return bend.full * conductance


@compiled
@no_type_check
def calibrate(
    counts: Int[np.ndarray, "taxel"],
    use: Bool[np.ndarray, "taxel"],
    now: float,
    gain: Float[np.ndarray, "taxel"],
    bend: PressureCurve,
    margin: Float[np.ndarray, "taxel"],
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    memory: Memory,
    rates: Rates,
    out: Float[np.ndarray, "taxel"],
) -> None:
    """Advance the baselines by one scan and write the pressures [kPa] to `out`."""
    # Arrays are taken out of the tuples first: the compiled loops are faster so.
    baseline, peak, heard, filled = (
        memory.baseline,
        memory.peak,
        memory.heard,
        memory.filled,
    )
    since, held = memory.since, memory.held
    after, silence, size = rates.after, rates.silence, memory.samples.shape[1]
    for i in range(len(counts)):
        if not use[i]:
            out[i] = 0.0
            continue
        if filled[i] < size or now - heard[i] > silence:
            hear(i, counts[i], now, margin[i], memory, rates)
        above = counts[i] - baseline[i]
        felt = linearise_counts(above, bend) * gain[i]
        out[i] = felt + min(felt, bend.unfelt)
        if above > margin[i] and above > after * peak[i]:
            if since[i] == np.inf:
                since[i] = now
            if not is_kept(i, above, now, margin, memory, rates):
                held[i] = now
                for k in range(starts[i], starts[i + 1]):
                    held[neighbours[k]] = now
        else:
            since[i] = np.inf
    follow(counts, use, now, margin, memory, rates)


@compiled
@no_type_check
def hear(
    i: int, count: int, now: float, margin: float, memory: Memory, rates: Rates
) -> None:
    """Take a sample for the tare if one is due; start anew after long silence."""
    if now - memory.heard[i] > rates.silence:
        memory.filled[i] = 0
        memory.due[i] = now
        memory.peak[i] = 0.0
        memory.since[i] = np.inf
        memory.low[i] = np.inf
    filled = memory.filled[i]
    if now < memory.due[i]:
        return
    sample = float(count)
    if filled >= SURE and sample > memory.baseline[i] + margin:
        sample = memory.baseline[i]
    k = filled
    while k > 0 and memory.samples[i, k - 1] > sample:
        memory.samples[i, k] = memory.samples[i, k - 1]
        k -= 1
    memory.samples[i, k] = sample
    memory.filled[i] = filled + 1
    memory.baseline[i] = memory.samples[i, int(rates.tare_rank * (filled + 1))]
    memory.due[i] = now + rates.tare_step


@compiled
@no_type_check
def is_kept(
    i: int,
    above: float,
    now: float,
    margin: Float[np.ndarray, "taxel"],
    memory: Memory,
    rates: Rates,
) -> bool:
    """Whether a taxel shows no touch, but what it has kept of one."""
    if now - memory.steady_at[i] <= rates.steady:
        return False
    return rates.still * margin[i] < above < rates.kept * margin[i]


@compiled
@no_type_check
def follow(
    counts: Int[np.ndarray, "taxel"],
    use: Bool[np.ndarray, "taxel"],
    now: float,
    margin: Float[np.ndarray, "taxel"],
    memory: Memory,
    rates: Rates,
) -> None:
    """Let each baseline follow the counts as far as nobody touches the taxel."""
    baseline, peak, heard, filled = (
        memory.baseline,
        memory.peak,
        memory.heard,
        memory.filled,
    )
    since, held, low = memory.since, memory.held, memory.low
    steady, steady_at = memory.steady, memory.steady_at
    drift, relearn, freeze, fade = rates.drift, rates.relearn, rates.freeze, rates.fade
    size = memory.samples.shape[1]
    dt, drifting, fading = 0.0, 0.0, 1.0
    for i in range(len(counts)):
        if not use[i]:
            continue
        if now - heard[i] != dt:
            # Taxels of one patch have the same dt, and dividing is what costs.
            dt = now - heard[i]
            drifting, fading = dt / (drift + dt), fade / (fade + dt)
        heard[i] = now
        if filled[i] < size:
            continue
        above = counts[i] - baseline[i]
        if abs(counts[i] - steady[i]) > rates.still * margin[i]:
            steady[i], steady_at[i] = counts[i], now
        was_low = low[i]
        low[i] = np.inf
        part = 0.0
        if above < -margin[i] or (was_low < np.inf and above < 0.0):
            low[i] = counts[i]
            if was_low < np.inf:
                above = max(above, was_low - baseline[i])
                part = dt / (rates.low + dt)
        elif held[i] < now and is_kept(i, above, now, margin, memory, rates):
            part = dt / (rates.settle + dt)
        elif since[i] < np.inf:
            if now - since[i] > rates.longest:
                part = dt / (rates.stale + dt)
        elif now - held[i] > freeze:
            part = drifting if above <= margin[i] else dt / (relearn + dt)
        baseline[i] += part * above
        peak[i] *= fading
        if above > margin[i]:
            peak[i] = max(peak[i], above)
        elif peak[i] < margin[i]:
            peak[i] = 0.0


VISIBLE = 0.3
"""Conductance of others, by that at half scale, of which a part stands out of noise."""

DIRECT = 0.02
"""A taxel whose detours conduct less than this by its lines tells of leak alone."""

SATURATED = 6.0
"""Conductance by that at half scale that a converter does not tell well."""

FEWEST = 8
"""Taxels of a patch that it takes to tell."""

WIDEST = 0.25
"""Share of a patch that may be touched while it is learned from."""

FAINT = 0.1
"""Conductance by the largest of the patch that is not called touched there."""

CAUTION = 2.5
"""How many times what was learned is taken off. Taxels that the bend of the skin
presses at rest lend themselves to detours, too, and rest does not show; from what is
truly touched this takes little."""

TINY = 1e-9
"""Conductance that is none."""

LEAK, GHOST = 0, 1
"""The two parts that are learned: what leaks along lines, what comes by detours."""

LARGEST = (0.03, 0.15)
"""Of either, above which a taxel is touched itself, and nothing is learned."""

RANK = (0.4, 0.25)
"""Which of the sorted shares that taxels show at one instant is believed."""


class Law(NamedTuple):
    """How conductance grows with pressure; see `Calibration`."""

    power: float
    """Its exponent; 1 for a linear device."""
    unfelt: float
    """Pressure that closes the sensor [kPa]."""


class Cells(NamedTuple):
    """One patch as its rows and columns, and room to work in."""

    taxels: np.ndarray
    """(taxel) its taxels in the skin."""
    rows: np.ndarray
    """(taxel) row of each, from 0."""
    columns: np.ndarray
    """(taxel) column of each, from 0."""
    half: np.ndarray
    """(taxel) pressure at half scale, of a linear device at full scale [kPa]."""
    shown: np.ndarray
    """(row, column) conductance by that at half scale; zero without a taxel."""
    own: np.ndarray
    """(row, column) the same without what leaked."""
    along: np.ndarray
    """(row) sums."""
    across: np.ndarray
    """(column) sums."""
    lines: np.ndarray
    """(taxel) what the others of its lines let through."""
    detours: np.ndarray
    """(taxel) what the ways over three others let through."""
    shares: np.ndarray
    """(taxel) what it shows by what it may be a part of."""


class Learned(NamedTuple):
    """What a device shows of others, and what it was learned from."""

    value: np.ndarray
    """(part) the shares."""
    seen: np.ndarray
    """(part) how many observations there were."""
    observed: np.ndarray
    """(part, observation) the latest of them, in turn."""


@compiled
@no_type_check
def take_off(
    pressure: Float[np.ndarray, "skin"],
    valid: Bool[np.ndarray, "skin"],
    law: Law,
    cells: Cells,
    learned: Learned,
) -> None:
    """Learn from one patch, and take off its pressures what is not their own.

    Args:
        pressure: of the skin, zero where it does not count [kPa].
        valid: which of it counts.
        law: of the device.
        cells: of the patch.
        learned: of the device.
    """
    largest = read(pressure, law, cells)
    cells.own[:] = cells.shown
    look_around(cells)
    # What others show has leaked into them, too; the second look is without that.
    leak = learned.value[LEAK]
    for k in range(len(cells.taxels)):
        i, j = cells.rows[k], cells.columns[k]
        cells.own[i, j] = max(cells.shown[i, j] - leak * cells.lines[k], 0.0)
    look_around(cells)
    if largest < SATURATED and touched(cells, largest) <= WIDEST:
        learn(valid, cells, learned)
    leak, ghost = learned.value[LEAK], learned.value[GHOST]
    for k in range(len(cells.taxels)):
        foreign = leak * cells.lines[k] + ghost * cells.detours[k]
        shown = cells.shown[cells.rows[k], cells.columns[k]]
        felt = max(shown - CAUTION * foreign, 0.0) ** (1.0 / law.power) * cells.half[k]
        pressure[cells.taxels[k]] = felt + min(felt, law.unfelt)


@compiled
@no_type_check
def read(pressure: Float[np.ndarray, "skin"], law: Law, cells: Cells) -> float:
    """Write what each cell lets through, and return the largest."""
    largest = 0.0
    for k in range(len(cells.taxels)):
        taxel = cells.taxels[k]
        p = np.float64(pressure[taxel])
        felt = max(p - law.unfelt, 0.5 * p)
        conductance = (felt / cells.half[k]) ** law.power if felt > 0.0 else 0.0
        cells.shown[cells.rows[k], cells.columns[k]] = conductance
        largest = max(largest, conductance)
    return largest


@compiled
@no_type_check
def look_around(cells: Cells) -> None:
    """Write what the others of each taxel's lines let through, and detours past it."""
    own, along, across = cells.own, cells.along, cells.across
    along[:] = 0.0
    across[:] = 0.0
    total = 0.0
    for k in range(len(cells.taxels)):
        i, j = cells.rows[k], cells.columns[k]
        along[i] += own[i, j]
        across[j] += own[i, j]
        total += own[i, j]
    for k in range(len(cells.taxels)):
        i, j = cells.rows[k], cells.columns[k]
        row, column = along[i] - own[i, j], across[j] - own[i, j]
        beyond = max(total - row - column - own[i, j], 0.0)
        series = 1.0 / (row + TINY) + 1.0 / (beyond + TINY) + 1.0 / (column + TINY)
        cells.lines[k] = row + column
        cells.detours[k] = 1.0 / series


@compiled
@no_type_check
def touched(cells: Cells, largest: float) -> float:
    """Share of the patch that lets through more than a little."""
    count = 0
    for k in range(len(cells.taxels)):
        count += cells.shown[cells.rows[k], cells.columns[k]] > FAINT * largest
    return count / len(cells.taxels)


@compiled
@no_type_check
def learn(valid: Bool[np.ndarray, "skin"], cells: Cells, learned: Learned) -> None:
    """Observe the leak where there are no detours, then ghosts where there are."""
    lines, detours, count = cells.lines, cells.detours, 0
    for k in range(len(cells.taxels)):
        direct = lines[k] > VISIBLE and detours[k] < DIRECT * lines[k]
        if direct and valid[cells.taxels[k]]:
            shown = cells.shown[cells.rows[k], cells.columns[k]]
            cells.shares[count] = shown / lines[k]
            count += 1
    observe(LEAK, cells.shares[:count], learned)
    leak, count = learned.value[LEAK], 0
    for k in range(len(cells.taxels)):
        if detours[k] > 0.5 * VISIBLE and valid[cells.taxels[k]]:
            shown = cells.shown[cells.rows[k], cells.columns[k]]
            cells.shares[count] = (shown - leak * lines[k]) / detours[k]
            count += 1
    observe(GHOST, cells.shares[:count], learned)


@compiled
@no_type_check
def observe(part: int, shares: Float[np.ndarray, "some"], learned: Learned) -> None:
    """Believe a low one of the shares that taxels show, if it is no touch."""
    if len(shares) < FEWEST:
        return
    place = int(RANK[part] * (len(shares) - 1))
    observed = np.partition(shares, place)[place]
    if observed > LARGEST[part]:
        return
    ring = learned.observed[part]
    ring[learned.seen[part] % len(ring)] = max(observed, 0.0)
    learned.seen[part] += 1
    learned.value[part] = np.median(ring[: min(learned.seen[part], len(ring))])
