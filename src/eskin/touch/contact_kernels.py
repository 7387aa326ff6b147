"""Compiled kernels that find the active taxels and the contacts of a reading."""
# The types of compiled code are those that numba infers.
# pyright: reportAttributeAccessIssue=false

import math
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import Packed, compiled
from eskin.touch.noise_kernels import BAND
from eskin.touch.records import (
    FINGERTIP,
    KernelReading,
    TrackerContext,
    TrackingParameters,
)
from eskin.touch.taxel_kernels import SHORTEST_PRESS, find_near, select
from eskin.touch.taxels import Instant

PA_PER_KPA = 1000.0
PRESSED_FLOOR = 0.75
"""Floor of the noise of a taxel that is pressed, or beside one that rises, in units of
the floor of others."""
MIN_NOISE = 0.1
"""Smallest pressure that is taken for noise [kPa]."""


@final
class PressEnd(NamedTuple):
    """A press ends on a taxel whose pressure falls as fast as its sensor lets it."""

    fall_seconds: float = 0.1
    """Time over which the fall of a pressure is looked at [s]."""
    max_fall_seconds: float = 0.25
    """Time over which a fall tells nothing, as after counts that repeat [s]."""
    min_slot_seconds: float = 0.0125
    """Time between two pressures that are kept to see a fall [s]."""
    fall_rate: float = 0.3
    """Rate of such a fall from which nothing holds a taxel any more, in units of the
    rate at which its sensor falls by itself."""
    hand_seconds: float = 0.08
    """Time constant with which the pressure of a hand that lifts falls [s]: no sensor
    is seen to fall faster."""
    max_release_seconds: float = 0.5
    """Largest time constant of a sensor [s]: what falls more slowly is a hand."""
    again_share: float = 0.25
    """Rise after such a fall that is contact again, in units of the lowest pressure."""
    clear_press: float = 4.0
    """Smallest pressure whose fall tells that a hand lifts, and how fast the sensor
    falls, in units of the pressure at which it is at rest."""
    peak_seconds: float = 20.0
    """Time constant with which the greatest pressure of a press counts for less [s]."""
    smooth_seconds: float = 0.03
    """Time constant with which the noise of a pressed taxel is averaged [s]."""
    rest_seconds: float = 1.0
    """Time at rest after which nothing is left of a press [s]."""


PRESS_END = PressEnd()
BEGIN, END, LINK, PATCH, AGE, FORCE, AREA, PEAK, EVIDENCE = range(9)
P_WORLD = 9
N_WORLD = 12
P_LINK = 15
NEAR = 18
"""Columns of a row for each contact: the span of its taxels; link and patch of the most
loaded one; the longest time for which one is active [ns]; values of `ContactRecord`,
the first column of three for vectors; and for each contact whether the two are near."""
Vector = Float[np.ndarray, "3"]
Indices = Int[np.ndarray, "active"]
Points = Float[np.ndarray, "point 3"]
Rows = Float[np.ndarray, "contact column"]
Box = Float[np.ndarray, "2 3"]
Transform = Float[np.ndarray, "4 4"]


@compiled
def transform_to_world(
    taxels: Int[np.ndarray, "selected"],
    vectors: Float[np.ndarray, "taxel 3"],
    links: Int[np.ndarray, "taxel"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    w: float,
) -> Float[np.ndarray, "selected 3"]:
    """Transform vectors of taxels to the world: points if w is 1, directions if 0."""
    result = np.empty((len(taxels), 3))
    for a in range(len(taxels)):
        i = taxels[a]
        T = T_world_link[links[i]]
        for r in range(3):
            result[a, r] = w * T[r, 3] + (
                T[r, 0] * vectors[i, 0]
                + T[r, 1] * vectors[i, 1]
                + T[r, 2] * vectors[i, 2]
            )
    return result


@compiled
def transform_to_link(T_world_link: Transform, p_world: Vector, out: Vector) -> None:
    """Transform a point in the world to the frame of a link [m]."""
    for c in range(3):
        total = 0.0
        for r in range(3):
            total += (p_world[r] - T_world_link[r, 3]) * T_world_link[r, c]
        out[c] = total


@compiled
def distance(one: Vector, other: Vector) -> float:
    """Return the distance between two points [m]."""
    squared = 0.0
    for r in range(3):
        squared += (one[r] - other[r]) ** 2
    return math.sqrt(squared)


@compiled
def compute_box(points: Points, box: Box) -> None:
    """Write the bounding box of points: smallest, then largest coordinates."""
    for r in range(3):
        low, high = np.inf, -np.inf
        for a in range(len(points)):
            low, high = min(low, points[a, r]), max(high, points[a, r])
        box[0, r] = low
        box[1, r] = high


@compiled
def box_gap(one: Box, other: Box) -> float:
    """Return the largest gap of two boxes along an axis, a bound of their distance."""
    gap = 0.0
    for r in range(3):
        gap = max(gap, one[0, r] - other[1, r], other[0, r] - one[1, r])
    return gap


@compiled
def point_gap(point: Vector, box: Box) -> float:
    """Return the largest gap of a point and a box along an axis."""
    gap = 0.0
    for r in range(3):
        gap = max(gap, box[0, r] - point[r], point[r] - box[1, r])
    return gap


@compiled
def find_candidates(
    pressure: Float[np.ndarray, "taxel"],
    least: float,
    order: Int[np.ndarray, "taxel"],
    out: Int[np.ndarray, "taxel"],
) -> int:
    """Write the taxels of at least a pressure [kPa] in an order; return their number.

    This is the only kernel of the tracker that visits all taxels of the skin.
    """
    count = 0
    for i in order:
        if pressure[i] >= least:
            out[count] = i
            count += 1
    return count


@compiled
def raise_limit(limit: float, floor: float, share: float = 1.0) -> float:
    """Return a limit of pressure that is no less than a share of the noise [kPa].

    The share is 1 where a taxel must stand out of the noise by itself. Beside what is
    known of it already, that something presses it or a neighbour, it is less.

    Args:
        limit: the limit of a taxel without noise [kPa].
        floor: pressure up to which the taxel may be noise [kPa].
        share: the share of that.
    """
    return max(limit, share * floor)


@compiled
def is_clear(pressure: float, floor: float) -> bool:
    """Return whether a pressure is clearly above what may be noise [kPa]."""
    return pressure >= BAND.clear_factor * raise_limit(MIN_NOISE, floor)


@compiled
def still_pressed_since(instant: Instant, context: TrackerContext) -> float:
    """Return the time of the oldest press that goes on [s].

    A press goes on from reading to reading, and for a short time without data.
    """
    return min(instant.previous, instant.now - context.parameters.dropout_seconds)


@compiled
def select_pressed(
    candidates: Indices, reading: KernelReading, context: TrackerContext
) -> Indices:
    """Select the taxels that something presses among candidates, in their order.

    For a taxel that was pressed and has not come to rest since, the threshold is the
    lower one. A taxel that is not received stays pressed for a short time. Both
    thresholds rise with the noise of the taxel. A taxel that rises alone is pressed
    with the next reading that confirms it, since corrupt values last for one; not so in
    readings without noise.
    """
    parameters = context.parameters
    instant = reading.instant
    since = still_pressed_since(instant, context)
    chosen = np.empty(len(candidates), np.int64)
    count = 0
    for i in candidates:
        if not reading.valid[i]:
            continue
        taxel = context.taxels[i]
        pressure = reading.pressure[i]
        if taxel.pressed and taxel.pressed_at >= since:
            least = raise_limit(parameters.off, taxel.floor, PRESSED_FLOOR)
            enough = pressure >= least
        else:
            enough = pressure >= raise_limit(parameters.on, taxel.floor)
            is_new = taxel.risen_at < since and taxel.floor > 0.0
            if enough and is_new and rises_alone(i, reading, context):
                taxel.risen_at = instant.now
                taxel.highest = pressure
                taxel.moved = 1
                taxel.onset = instant.stamp
                enough = False
        if enough:
            chosen[count] = i
            count += 1
    return chosen[:count]


@compiled
def rises_alone(i: int, reading: KernelReading, context: TrackerContext) -> bool:
    """Return whether no neighbour of a taxel is pressed."""
    for j in find_near(i, context.places.adjacency):
        floor = context.taxels[j].floor
        least = raise_limit(context.parameters.off, floor, PRESSED_FLOOR)
        if reading.valid[j] and reading.pressure[j] >= least:
            return False
    return True


@compiled
def update_pressed(
    pressed: Indices, reading: KernelReading, context: TrackerContext
) -> Indices:
    """Update the states of the pressed taxels, and return those in contact.

    A reading that repeats the one before changes no contact.
    """
    is_repeated = True
    for i in pressed:
        taxel = context.taxels[i]
        is_repeated &= taxel.pressed != 0 and reading.pressure[i] == taxel.latest
    for i in pressed:
        note_press(i, reading, context)
    slot = context.slot[0]
    now = reading.instant.now
    before = find_slot(
        now - PRESS_END.fall_seconds + PRESS_END.min_slot_seconds / 2, context
    )
    if not is_repeated:
        slot = advance_slot(now, context)
        follow_falls(pressed, slot, before, reading, context)
    keep_pressed(pressed, before, reading, context)
    active = np.empty_like(pressed)
    count = 0
    for i in pressed:
        if not context.taxels[i].released:
            active[count] = i
            count += 1
    return active[:count]


@compiled
def note_press(i: int, reading: KernelReading, context: TrackerContext) -> None:
    """Update since when a taxel is pressed, and whether its pressure rises."""
    instant = reading.instant
    taxel = context.taxels[i]
    pressure = reading.pressure[i]
    since = still_pressed_since(instant, context)
    last = max(taxel.pressed_at, taxel.risen_at)
    if last != instant.previous:
        taxel.onset = instant.stamp
    if last < since:
        taxel.highest = 0.0
        taxel.moved = 0
    if instant.now - taxel.pressed_at > PRESS_END.rest_seconds:
        taxel.released = 0
    if taxel.pressed_at < since or not taxel.pressed:
        taxel.fastest = 0.0
        taxel.latest = 0.0
        taxel.smooth = 0.0
        if taxel.released:
            taxel.smooth = min(taxel.lowest, pressure)
        else:
            taxel.strongest = 0.0
        context.recent[:, i] = 0.0
    change = pressure - taxel.highest
    taxel.changed = taxel.moved
    taxel.moved = change >= max(context.parameters.min_rise * pressure, taxel.floor)
    taxel.highest = max(taxel.highest, pressure)
    taxel.pressed_at = instant.now


@compiled
def follow_falls(
    pressed: Indices,
    slot: int,
    before: int,
    reading: KernelReading,
    context: TrackerContext,
) -> None:
    """End and begin the contacts of pressed taxels by how their pressures change.

    The contact of a taxel ends where its pressure falls nearly as fast as its sensor
    does once a hand lifts, and begins again where it has risen by more than noise
    since.

    Args:
        pressed: the pressed taxels.
        slot: slot of the pressures of this reading.
        before: slot of those with which they are compared, -1 for none.
        reading: the reading.
        context: what is kept between readings.
    """
    parameters = context.parameters
    now = reading.instant.now
    sensor_rate = min(context.release_rate[0], 1.0 / PRESS_END.hand_seconds)
    limit = PRESS_END.fall_rate * sensor_rate
    elapsed = now - context.measured_at[0]
    context.measured_at[0] = now
    weight = 1.0
    if elapsed > 0.0:
        weight = 1.0 - math.exp(-elapsed / PRESS_END.smooth_seconds)
    fade = math.exp(-elapsed / PRESS_END.peak_seconds)
    is_fast = 0.0 < reading.instant.elapsed <= SHORTEST_PRESS
    for i in pressed:
        taxel = context.taxels[i]
        # Corrupt values are of one reading, a press of more.
        lasting = reading.pressure[i]
        if is_fast:
            low = min(lasting, taxel.latest)
            high = max(lasting, taxel.latest)
            lasting = min(max(taxel.smooth, low), high)
        taxel.smooth += weight * (lasting - taxel.smooth)
        taxel.latest = reading.pressure[i]
        taxel.strongest = max(fade * taxel.strongest, taxel.smooth)
        context.recent[slot, i] = taxel.smooth
        rate = compute_fall(i, taxel.smooth, before, now, context)
        clear = PRESS_END.clear_press * raise_limit(parameters.off, taxel.floor)
        if taxel.smooth >= clear:
            taxel.fastest = max(taxel.fastest, rate)
        if not taxel.released and rate >= limit and taxel.strongest >= clear:
            taxel.released = 1
            taxel.lowest = taxel.smooth
        elif taxel.released:
            taxel.lowest = min(taxel.lowest, taxel.smooth)
            rise = PRESS_END.again_share * taxel.lowest
            rise = max(rise, raise_limit(parameters.on, taxel.floor))
            if taxel.smooth >= taxel.lowest + rise:
                taxel.released = 0
                taxel.onset = reading.instant.stamp
                context.recent[:, i] = 0.0
                context.recent[slot, i] = taxel.smooth


@compiled
def compute_fall(
    i: int, pressure: float, before: int, now: float, context: TrackerContext
) -> float:
    """Return the rate at which the pressure of a taxel has fallen lately [1/s].

    It is that of the logarithm, from its pressure in the slot before; 0 where there is
    none.
    """
    if before < 0:
        return 0.0
    earlier = context.recent[before, i]
    elapsed = now - context.recent_times[before]
    if earlier <= pressure or elapsed > PRESS_END.max_fall_seconds:
        return 0.0
    return math.log(earlier / pressure) / elapsed


@compiled
def advance_slot(now: float, context: TrackerContext) -> int:
    """Return the slot of the pressures of a reading, a new one after some time."""
    times = context.recent_times
    slot = context.slot[0]
    if now - times[slot] >= PRESS_END.min_slot_seconds:
        slot = (slot + 1) % len(times)
        context.slot[0] = slot
        times[slot] = now
        context.recent[slot, :] = 0.0
    return slot


@compiled
def find_slot(latest: float, context: TrackerContext) -> int:
    """Return the slot of the latest pressures until a time [s]; -1 for none."""
    found = -1
    best = -np.inf
    for slot in range(len(context.recent_times)):
        time = context.recent_times[slot]
        if best < time <= latest:
            found = slot
            best = time
    return found


@compiled
def keep_pressed(
    pressed: Indices,
    before: int,
    reading: KernelReading,
    context: TrackerContext,
) -> None:
    """Keep the pressed taxels, and those not received that were so recently.

    What has come to rest after a clear press tells how fast the sensor falls.
    """
    taxels = context.taxels
    kept = context.pressed
    instant = reading.instant
    since = still_pressed_since(instant, context)
    count = 0
    fastest = 0.0
    for k in range(context.pressed_count[0]):
        i = kept[k]
        if taxels[i].pressed_at == instant.now:
            continue
        taxels[i].clear = 0
        if reading.valid[i]:
            least = raise_limit(context.parameters.off, taxels[i].floor)
            rate = taxels[i].fastest
            clear = PRESS_END.clear_press * least
            if before >= 0 and context.recent[before, i] >= clear:
                # It fell faster than could be followed.
                fall = compute_fall(i, least, before, instant.now, context)
                rate = max(rate, fall)
            fastest = max(fastest, rate)
        if reading.valid[i] or taxels[i].pressed_at < since:
            taxels[i].pressed = 0
        else:
            kept[count] = i
            count += 1
    for i in pressed:
        taxels[i].pressed = 1
        taxels[i].clear = is_clear(reading.pressure[i], taxels[i].floor)
        kept[count] = i
        count += 1
    context.pressed_count[0] = count
    if fastest > 0.0:
        add_release(fastest, context)


@compiled
def add_release(rate: float, context: TrackerContext) -> None:
    """Add the rate of a release [1/s] to those that tell how fast the sensor falls."""
    rates = context.release_rates
    rates[context.releases[0] % len(rates)] = rate
    context.releases[0] += 1
    usual = select(rates.copy(), len(rates) // 2)
    context.release_rate[0] = max(usual, 1.0 / PRESS_END.max_release_seconds)


@compiled
def find_root(parents: Indices, i: int) -> int:
    """Return the representative of an element's set (union-find)."""
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled
def join_sets(parents: Indices, i: int, j: int) -> None:
    """Join the sets of two elements; the earlier one represents both."""
    a = find_root(parents, i)
    b = find_root(parents, j)
    if a != b:
        parents[max(a, b)] = min(a, b)


@compiled
def label_components(
    active: Indices, p_world: Points, context: TrackerContext
) -> Indices:
    """Label the connected sets of active taxels in the order of their first taxel."""
    taxels = context.taxels
    count = len(active)
    parents = np.arange(count)
    for a in range(count):
        taxels[active[a]].scratch_index = a
    for a in range(count):
        for j in find_near(active[a], context.places.adjacency):
            b = taxels[j].scratch_index
            if b > a:
                join_sets(parents, a, b)
    for a in range(count):
        taxels[active[a]].scratch_index = -1
    join_links(active, p_world, context, parents)
    labels = np.empty(count, np.int64)
    found = 0
    for a in range(count):
        if parents[a] == a:
            labels[a] = found
            found += 1
        else:
            labels[a] = labels[find_root(parents, a)]
    return labels


@compiled
def select_strong(
    active: Indices, labels: Indices, reading: KernelReading, context: TrackerContext
) -> Indices:
    """Select the taxels that reach a fraction of the peak of their connected set.

    The peak may also be of taxels beside it whose contact has just ended. The others
    are in contact once they rise: what is weak beside a press may be the residual of
    one, crosstalk, or a hand that hovers, and stays as the press ends.
    """
    share = context.parameters.peak_share
    peaks = np.zeros(len(active))
    strong = np.empty_like(active)
    count = 0
    for a in range(len(active)):
        label = labels[a]
        peak = find_peak(active[a], reading, context)
        peaks[label] = max(peaks[label], peak)
    for a in range(len(active)):
        i = active[a]
        if reading.pressure[i] >= share * peaks[labels[a]]:
            strong[count] = i
            count += 1
        else:
            context.taxels[i].released = 1
            context.taxels[i].lowest = context.taxels[i].smooth
    return strong[:count]


@compiled
def find_peak(i: int, reading: KernelReading, context: TrackerContext) -> float:
    """Return the pressure of a taxel, or of a press beside it that has ended."""
    peak = float(reading.pressure[i])
    for j in find_near(i, context.places.adjacency):
        near = context.taxels[j]
        rested = reading.instant.now - near.pressed_at
        if near.released and rested <= PRESS_END.rest_seconds:
            peak = max(peak, near.strongest)
    return peak


@compiled
def join_links(
    active: Indices, p_world: Points, context: TrackerContext, parents: Indices
) -> None:
    """Join taxels of different links that are within reach in this pose.

    Consecutive taxels of one link form a run; the boxes of runs are compared first.
    """
    links = context.links
    reach = context.places.adjacency.reach
    ends = np.zeros(len(active) + 1, np.int64)
    runs = 0
    widest = 0.0
    for a in range(len(active)):
        if a == 0 or links[active[a]] != links[active[a - 1]]:
            runs += 1
        ends[runs] = a + 1
        widest = max(widest, reach[active[a]])
    if runs < 2:
        return
    boxes = np.empty((runs, 2, 3))
    for r in range(runs):
        compute_box(p_world[ends[r] : ends[r + 1]], boxes[r])
    for r in range(runs):
        for s in range(r + 1, runs):
            if box_gap(boxes[r], boxes[s]) > widest:
                continue
            if links[active[ends[r]]] == links[active[ends[s]]]:
                continue
            for a in range(ends[r], ends[r + 1]):
                if point_gap(p_world[a], boxes[s]) <= widest:
                    others = range(ends[s], ends[s + 1])
                    join_near(a, others, active, p_world, reach, parents)


@compiled
def join_near(
    a: int,
    others: range,
    active: Indices,
    p_world: Points,
    reach: Float[np.ndarray, "taxel"],
    parents: Indices,
) -> None:
    """Join one taxel with others that are within the larger reach."""
    for b in others:
        larger = max(reach[active[a]], reach[active[b]])
        d0 = p_world[a, 0] - p_world[b, 0]
        d1 = p_world[a, 1] - p_world[b, 1]
        d2 = p_world[a, 2] - p_world[b, 2]
        if d0 * d0 + d1 * d1 + d2 * d2 <= larger * larger:
            join_sets(parents, a, b)


@compiled
def find_contacts(
    candidates: Indices, reading: KernelReading, packed_context: Packed
) -> tuple[Rows, Indices]:
    """Find the contacts of a reading.

    `candidates` are all taxels of enough pressure to be active, by patch, row and
    column; the context is a `TrackerContext`.

    Returns:
        A row for each contact, and the taxels of all contacts, one contact after the
        other, each in the order of the candidates.
    """
    context = packed_context.fields
    places = context.places
    patches = places.patches
    taxel_states = context.taxels
    links = context.links
    T_world_link = reading.T_world_link
    pressed = select_pressed(candidates, reading, context)
    active = update_pressed(pressed, reading, context)
    positions = places.positions
    p_world = transform_to_world(active, positions, links, T_world_link, 1.0)
    labels = label_components(active, p_world, context)
    strong = select_strong(active, labels, reading, context)
    if len(strong) < len(active):
        active = strong
        p_world = transform_to_world(active, positions, links, T_world_link, 1.0)
        labels = label_components(active, p_world, context)
    n_world = transform_to_world(active, places.normals, links, T_world_link, 0.0)
    rows = allocate_rows(labels)
    taxels = np.empty(len(active), np.int64)
    points = np.empty((len(active), 3))
    largest = np.zeros(len(rows))
    for a in range(len(active)):
        i = active[a]
        row = rows[labels[a]]
        k = int(row[END])
        pressure = reading.pressure[i]
        row[END] += 1
        row[AGE] = max(row[AGE], float(reading.instant.stamp - taxel_states[i].onset))
        taxels[k] = i
        force = PA_PER_KPA * pressure * places.areas[i]
        row[FORCE] += force
        row[AREA] += places.areas[i]
        row[PEAK] = max(row[PEAK], pressure)
        for r in range(3):
            points[k, r] = p_world[a, r]
            row[P_WORLD + r] += force * p_world[a, r]
            row[N_WORLD + r] += force * n_world[a, r]
        if force > largest[labels[a]] or k == row[BEGIN]:
            largest[labels[a]] = force
            row[LINK] = links[i]
            row[PATCH] = patches.numbers[patches.group_index[i]]
    for row in rows:
        own = taxels[int(row[BEGIN]) : int(row[END])]
        row[EVIDENCE] = weigh_contact(own, reading, context)
        normalise_sums(row, T_world_link[int(row[LINK])])
    if len(rows) > 1:
        write_near(points, rows, context.parameters)
    return rows, taxels


@compiled
def allocate_rows(labels: Indices) -> Rows:
    """Allocate a row for each label, whose span is empty and begins at its taxels."""
    count = 0
    for label in labels:
        count = max(count, label + 1)
    rows = np.zeros((count, NEAR + count))
    for label in labels:
        rows[label, END] += 1.0
    end = 0.0
    for row in rows:
        begin = end
        end = end + row[END]
        row[BEGIN] = row[END] = begin
    return rows


@compiled
def weigh_contact(
    taxels: Indices, reading: KernelReading, context: TrackerContext
) -> float:
    """Return the evidence of a contact in one reading that it is no noise.

    Each taxel adds the logarithm of its pressure in units of its noise, within limits.
    Where only one of them is well above its noise, that counts only while its pressure
    rises above what it was before, since the offset of a taxel may jump, and then stays
    or swings. In readings without noise every contact is evidence enough.
    """
    most = context.parameters.max_taxel_llr
    evidence = 0.0
    clear = 0
    strongest = 0.0
    changed = False
    for i in taxels:
        taxel = context.taxels[i]
        if taxel.floor == 0.0:
            return np.inf
        noise = raise_limit(MIN_NOISE, taxel.floor)
        strength = math.log(max(reading.pressure[i] / noise, 1.0))
        strength = min(strength, most)
        evidence += strength
        clear += taxel.clear
        if strength > strongest:
            strongest = strength
            changed = taxel.changed != 0
    return evidence if clear > 1 or changed else 0.0


@compiled
def normalise_sums(row: Float[np.ndarray, "column"], T_world_link: Transform) -> None:
    """Turn the sums of a contact into its centre and its unit normal."""
    p_world = row[P_WORLD:N_WORLD]
    n_world = row[N_WORLD:P_LINK]
    length = math.sqrt(n_world[0] ** 2 + n_world[1] ** 2 + n_world[2] ** 2)
    for r in range(3):
        p_world[r] /= row[FORCE]
        if length > 0.0:
            n_world[r] /= length
    transform_to_link(T_world_link, p_world, row[P_LINK:NEAR])


@compiled
def write_near(points: Points, rows: Rows, parameters: TrackingParameters) -> None:
    """Write whether the nearest taxels of two contacts are within reach."""
    boxes = np.empty((len(rows), 2, 3))
    cells = rows[:, AREA] / (rows[:, END] - rows[:, BEGIN])
    for n in range(len(rows)):
        own = points[int(rows[n, BEGIN]) : int(rows[n, END])]
        compute_box(own, boxes[n])
        for m in range(n):
            is_coarse = min(cells[m], cells[n]) >= FINGERTIP
            reach = parameters.max_separation
            if is_coarse:
                reach = max(reach, parameters.hand)
            others = points[int(rows[m, BEGIN]) : int(rows[m, END])]
            if box_gap(boxes[m], boxes[n]) <= reach:
                near = are_near(others, own, boxes[n], reach)
                rows[m, NEAR + n] = rows[n, NEAR + m] = near


@compiled
def are_near(points: Points, others: Points, box: Box, reach: float) -> bool:
    """Return whether any two points of two sets are within reach [m].

    `box` is the bounding box of the others.
    """
    for m in range(len(points)):
        if point_gap(points[m], box) <= reach:
            for n in range(len(others)):
                if distance(points[m], others[n]) <= reach:
                    return True
    return False
