"""Compiled loops over taxels. `no_type_check` keeps the tests' hooks off them."""

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


class Bend(NamedTuple):
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
def undo(above: float, bend: Bend) -> float:
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
    bend: Bend,
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
        felt = undo(above, bend) * gain[i]
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
