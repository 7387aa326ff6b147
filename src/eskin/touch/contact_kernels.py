"""Compiled kernels that find the active taxels and the contacts of a reading."""
# The types of compiled code are those that numba infers.
# pyright: reportAttributeAccessIssue=false

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.calibration_kernels import SHORTEST_PRESS
from eskin.touch.records import (
    CONTACT,
    LATCHED,
    LOAD,
    KernelReading,
    TrackerContext,
    TrackerState,
)

PA_PER_KPA = 1000.0
LATCHED_FLOOR = 0.75
"""Floor of the noise of a taxel that is active, or beside one that rises, in units of
that of others."""
Vector = Float[np.ndarray, "3"]
Indices = Int[np.ndarray, "active"]
Points = Float[np.ndarray, "point 3"]
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
def distance_to_link_point(
    T_world_link: Transform, p_link: Vector, p_world: Vector
) -> float:
    """Return the distance between a point on a link and one in the world [m]."""
    squared = 0.0
    for r in range(3):
        T = T_world_link[r]
        here = T[0] * p_link[0] + T[1] * p_link[1] + T[2] * p_link[2] + T[3]
        squared += (p_world[r] - here) ** 2
    return np.sqrt(squared)


@compiled
def distance(one: Vector, other: Vector) -> float:
    """Return the distance between two points [m]."""
    squared = 0.0
    for r in range(3):
        squared += (one[r] - other[r]) ** 2
    return np.sqrt(squared)


@compiled
def compute_box(points: Points, box: Box) -> None:
    """Write the bounding box of points: smallest, then largest coordinates."""
    for r in range(3):
        low, high = np.inf, -np.inf
        for a in range(len(points)):
            low, high = min(low, points[a, r]), max(high, points[a, r])
        box[0, r], box[1, r] = low, high


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
def select_active(
    candidates: Indices, reading: KernelReading, context: TrackerContext
) -> Indices:
    """Select the active taxels among candidates, in their order.

    For a taxel that is latched, which was active and has not been released, the
    threshold is the lower one. A taxel that is not received stays latched for a short
    time. Both thresholds rise with the noise of the taxel, and with the recent peak of
    it and its neighbours, so that the residual of a sensor after a release is no
    contact. A taxel that rises alone becomes active with the next reading that confirms
    it, since corrupt values last for one; not so in readings without noise.
    """
    parameters, state = context.parameters, context.state
    chosen = np.empty(len(candidates), np.int64)
    count, now = 0, reading.now
    since = min(reading.previous, now - parameters.dropout_seconds)
    for i in candidates:
        if not reading.valid[i]:
            continue
        taxel, pressure = state.taxels[i], reading.pressure[i]
        recent = compute_recent_peak(taxel, now, parameters.fade_seconds)
        if taxel.latched and taxel.active_at >= since:
            least = max(parameters.off, LATCHED_FLOOR * reading.floor[i])
            enough = pressure >= max(least, parameters.off_share * recent)
        else:
            least = max(parameters.on, reading.floor[i])
            enough = pressure >= max(least, parameters.on_share * recent)
            is_new = taxel.risen_at < since and reading.floor[i] > 0.0
            if enough and is_new and rises_alone(i, reading, context):
                taxel.risen_at, taxel.highest, taxel.moved = now, pressure, 1
                taxel.onset = reading.stamp
                enough = False
        if enough:
            chosen[count] = i
            count += 1
    return chosen[:count]


@compiled
def rises_alone(i: int, reading: KernelReading, context: TrackerContext) -> bool:
    """Return whether no neighbour of a taxel is pressed."""
    span = context.geometry[i].neighbours
    for k in range(span[0], span[1]):
        j = context.neighbours[k]
        least = max(context.parameters.off, LATCHED_FLOOR * reading.floor[j])
        if reading.valid[j] and reading.pressure[j] >= least:
            return False
    return True


@compiled
def compute_recent_peak(taxel: np.void, now: float, fade_seconds: float) -> float:
    """Return the recent peak of a taxel and its neighbours, which fades [kPa]."""
    return taxel.peak * fade_seconds / (fade_seconds + now - taxel.peak_at)


@compiled
def update_active(
    active: Indices, reading: KernelReading, context: TrackerContext
) -> None:
    """Update the states of the active taxels and of their neighbours."""
    parameters, state, now = context.parameters, context.state, reading.now
    since = min(reading.previous, now - parameters.dropout_seconds)
    for i in active:
        taxel, pressure = state.taxels[i], reading.pressure[i]
        if max(taxel.active_at, taxel.risen_at) != reading.previous:
            taxel.onset = reading.stamp
        if max(taxel.active_at, taxel.risen_at) < since:
            taxel.highest, taxel.moved = 0.0, 0
        change = pressure - taxel.highest
        least = max(parameters.min_rise * pressure, reading.floor[i])
        taxel.changed, taxel.moved = taxel.moved, change >= least
        taxel.highest = max(taxel.highest, pressure)
        # Corrupt values are of one reading, a press of more.
        peak = pressure
        if reading.floor[i] > 0.0 and now - reading.previous <= SHORTEST_PRESS:
            peak = min(pressure, taxel.pressure) if taxel.active_at >= since else 0.0
        taxel.active_at, taxel.pressure = now, pressure
        raise_peak(taxel, peak, now, parameters.fade_seconds)
        span = context.geometry[i].neighbours
        for k in range(span[0], span[1]):
            near = state.taxels[context.neighbours[k]]
            raise_peak(near, peak, now, parameters.fade_seconds)
    update_latched(active, reading.valid, since, state)


@compiled
def raise_peak(
    taxel: np.void, pressure: float, now: float, fade_seconds: float
) -> None:
    """Set the recent peak of a taxel to a pressure [kPa] that exceeds it."""
    if pressure >= compute_recent_peak(taxel, now, fade_seconds):
        taxel.peak, taxel.peak_at = pressure, now


@compiled
def update_latched(
    active: Indices, valid: Bool[np.ndarray, "taxel"], since: float, state: TrackerState
) -> None:
    """Hold the active taxels, and keep those not received that were active recently."""
    taxels, latched, count = state.taxels, state.latched, 0
    for k in range(state.counts[LATCHED]):
        i = latched[k]
        if valid[i] or taxels[i].active_at < since:
            taxels[i].latched = 0
        else:
            latched[count] = i
            count += 1
    for i in active:
        taxels[i].latched = 1
        latched[count] = i
        count += 1
    state.counts[LATCHED] = count


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
    a, b = find_root(parents, i), find_root(parents, j)
    if a != b:
        parents[max(a, b)] = min(a, b)


@compiled
def label_components(
    active: Indices, p_world: Points, context: TrackerContext
) -> Indices:
    """Label the connected sets of active taxels in the order of their first taxel."""
    geometry, neighbours = context.geometry, context.neighbours
    taxels, count = context.state.taxels, len(active)
    parents = np.arange(count)
    for a in range(count):
        taxels[active[a]].scratch_index = a
    for a in range(count):
        span = geometry[active[a]].neighbours
        for k in range(span[0], span[1]):
            b = taxels[neighbours[k]].scratch_index
            if b > a:
                join_sets(parents, a, b)
    for a in range(count):
        taxels[active[a]].scratch_index = -1
    join_links(active, p_world, geometry, parents)
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
    active: Indices, labels: Indices, reading: KernelReading, share: float
) -> Indices:
    """Select the taxels that reach a fraction of the peak of their connected set."""
    peaks, strong, count = np.zeros(len(active)), np.empty_like(active), 0
    for a in range(len(active)):
        label = labels[a]
        peaks[label] = max(peaks[label], reading.pressure[active[a]])
    for a in range(len(active)):
        if reading.pressure[active[a]] >= share * peaks[labels[a]]:
            strong[count] = active[a]
            count += 1
    return strong[:count]


@compiled
def join_links(
    active: Indices, p_world: Points, geometry: np.ndarray, parents: Indices
) -> None:
    """Join taxels of different links that are within reach in this pose.

    Consecutive taxels of one link form a run; the boxes of runs are compared first.
    """
    ends, runs, widest = np.zeros(len(active) + 1, np.int64), 0, 0.0
    for a in range(len(active)):
        taxel = geometry[active[a]]
        if a == 0 or taxel.link != geometry[active[a - 1]].link:
            runs += 1
        ends[runs] = a + 1
        widest = max(widest, taxel.reach)
    if runs < 2:
        return
    boxes = np.empty((runs, 2, 3))
    for r in range(runs):
        compute_box(p_world[ends[r] : ends[r + 1]], boxes[r])
    for r in range(runs):
        for s in range(r + 1, runs):
            if box_gap(boxes[r], boxes[s]) > widest:
                continue
            if geometry[active[ends[r]]].link == geometry[active[ends[s]]].link:
                continue
            for a in range(ends[r], ends[r + 1]):
                if point_gap(p_world[a], boxes[s]) <= widest:
                    others = range(ends[s], ends[s + 1])
                    join_near(a, others, active, p_world, geometry, parents)


@compiled
def join_near(
    a: int,
    others: range,
    active: Indices,
    p_world: Points,
    geometry: np.ndarray,
    parents: Indices,
) -> None:
    """Join one taxel with those of the others that are within the larger reach."""
    for b in others:
        reach = max(geometry[active[a]].reach, geometry[active[b]].reach)
        d0 = p_world[a, 0] - p_world[b, 0]
        d1 = p_world[a, 1] - p_world[b, 1]
        d2 = p_world[a, 2] - p_world[b, 2]
        if d0 * d0 + d1 * d1 + d2 * d2 <= reach * reach:
            join_sets(parents, a, b)


@compiled
def find_contacts(
    candidates: Indices, reading: KernelReading, context: TrackerContext
) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, "load 3"]]:
    """Find the contacts of a reading, their loads, and the positions of the loads.

    Returns:
        CONTACT and LOAD records, the loads of a contact sorted by patch, row and
        column; and the position of each load in the world [m].
    """
    geometry, state = context.geometry, context.state
    links, T_world_link = geometry.link, reading.T_world_link
    active = select_active(candidates, reading, context)
    p_world = transform_to_world(active, geometry.position, links, T_world_link, 1.0)
    labels = label_components(active, p_world, context)
    strong = select_strong(active, labels, reading, context.parameters.peak_share)
    if len(strong) < len(active):
        active, position = strong, geometry.position
        p_world = transform_to_world(active, position, links, T_world_link, 1.0)
        labels = label_components(active, p_world, context)
    n_world = transform_to_world(active, geometry.normal, links, T_world_link, 0.0)
    update_active(active, reading, context)
    contacts = allocate_contacts(labels, reading.stamp)
    loads, points = np.empty(len(active), LOAD), np.empty((len(active), 3))
    largest = np.zeros(len(contacts))
    for a in range(len(active)):
        i, contact = active[a], contacts[labels[a]]
        k = contact.loads[1]
        contact.loads[1] += 1
        pressure = reading.pressure[i]
        loads[k].taxel, loads[k].pressure = i, pressure
        loads[k].onset = state.taxels[i].onset
        force = PA_PER_KPA * pressure * geometry[i].area
        contact.force += force
        contact.area += geometry[i].area
        contact.peak = max(contact.peak, pressure)
        for r in range(3):
            points[k, r] = p_world[a, r]
            contact.p_world[r] += force * p_world[a, r]
            contact.n_world[r] += force * n_world[a, r]
        if force > largest[labels[a]] or k == contact.loads[0]:
            largest[labels[a]] = force
            contact.link, contact.patch = geometry[i].link, geometry[i].patch
    for n in range(len(contacts)):
        normalise_sums(contacts[n], T_world_link)
    return contacts, loads, points


@compiled
def allocate_contacts(labels: Indices, stamp: int) -> np.ndarray:
    """Build a contact for each label, with an empty span where its loads will begin."""
    count = 0
    for label in labels:
        count = max(count, label + 1)
    contacts = np.zeros(count, CONTACT)
    for label in labels:
        contacts[label].loads[1] += 1
    end = 0
    for n in range(len(contacts)):
        contacts[n].stamp = stamp
        span = contacts[n].loads
        size = span[1]
        span[0] = span[1] = end
        end += size
    return contacts


@compiled
def normalise_sums(
    contact: np.void, T_world_link: Float[np.ndarray, "link 4 4"]
) -> None:
    """Turn the sums of a contact into its centre and its unit normal."""
    n_world = contact.n_world
    length = np.sqrt(n_world[0] ** 2 + n_world[1] ** 2 + n_world[2] ** 2)
    for r in range(3):
        contact.p_world[r] /= contact.force
        if length > 0.0:
            n_world[r] /= length
    transform_to_link(T_world_link[contact.link], contact.p_world, contact.p_link)
