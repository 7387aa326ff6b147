"""Compiled loops over taxels. `no_type_check` keeps the tests' hooks off them."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit


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
    due: np.ndarray
    """When the next sample of the tare is taken."""
    filled: np.ndarray
    """How many samples the tare has."""
    samples: np.ndarray
    """The samples of the tare, ascending (taxel, sample)."""


SURE = 4


@njit(cache=True)
@no_type_check
def calibrate(
    counts: Int[np.ndarray, "taxel"],
    use: Bool[np.ndarray, "taxel"],
    now: float,
    gain: Float[np.ndarray, "taxel"],
    margin: Float[np.ndarray, "taxel"],
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    memory: Memory,
    rates: Rates,
    out: Float[np.ndarray, "taxel"],
) -> None:
    """Advance the baselines by one scan and write the pressures [kPa] to `out`."""
    for i in range(len(counts)):
        if use[i]:
            hear(i, counts[i], now, margin[i], memory, rates)
            if counts[i] - memory.baseline[i] > touch_margin(
                margin[i], memory.peak[i], rates
            ):
                memory.since[i] = min(memory.since[i], now)
                memory.held[i] = now
                for k in range(starts[i], starts[i + 1]):
                    memory.held[neighbours[k]] = now
            else:
                memory.since[i] = np.inf
    for i in range(len(counts)):
        out[i] = 0.0
        if use[i]:
            out[i] = max(counts[i] - memory.baseline[i], 0.0) * gain[i]
            follow(i, counts[i], now, margin[i], memory, rates)
            memory.heard[i] = now


@njit(cache=True)
@no_type_check
def touch_margin(margin: float, peak: float, rates: Rates) -> float:
    """Counts above the baseline up to which a taxel counts as untouched."""
    return max(margin, rates.after * peak)


@njit(cache=True)
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
    size = memory.samples.shape[1]
    filled = memory.filled[i]
    if filled >= size or now < memory.due[i]:
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


@njit(cache=True)
@no_type_check
def follow(
    i: int, count: int, now: float, margin: float, memory: Memory, rates: Rates
) -> None:
    """Let the baseline follow the counts as far as nobody touches the taxel."""
    if memory.filled[i] < memory.samples.shape[1]:
        return
    dt = now - memory.heard[i]
    above = count - memory.baseline[i]
    was_low = memory.low[i]
    memory.low[i] = np.inf
    tau = np.inf
    if above < -margin or (above < 0 and was_low < np.inf):
        memory.low[i] = count
        if was_low < np.inf:
            above = max(above, was_low - memory.baseline[i])
            tau = rates.low
    elif memory.since[i] < np.inf:
        if now - memory.since[i] > rates.longest:
            tau = rates.stale
    elif now - memory.held[i] > rates.freeze:
        tau = rates.drift if above <= margin else rates.relearn
    if tau < np.inf:
        memory.baseline[i] += above * dt / (tau + dt)
    memory.peak[i] = max(memory.peak[i] * rates.fade / (rates.fade + dt), above)
