"""Compiled search for the contacts of a reading: its cost follows the touch."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.touch.active_kernels import activate, by_rank
from eskin.touch.geometry_kernels import box_gap, box_of, place, point_gap, to_link
from eskin.touch.memory import Memory
from eskin.touch.records import CONTACT, LOAD
from eskin.touch.rules import Instant, Rules

PASCAL = 1000.0


@compiled
@no_type_check
def root_of(parents: Int[np.ndarray, "active"], i: int) -> int:
    """The representative of an element's set."""
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled
@no_type_check
def join(parents: Int[np.ndarray, "active"], i: int, j: int) -> None:
    """Join the sets of two elements; the earlier one represents both."""
    a, b = root_of(parents, i), root_of(parents, j)
    if a != b:
        parents[max(a, b)] = min(a, b)


@compiled
@no_type_check
def connect(
    active: Int[np.ndarray, "active"],
    p_world: Float[np.ndarray, "active 3"],
    sites: np.ndarray,
    neighbours: Int[np.ndarray, "pair"],
    taxels: np.ndarray,
) -> Int[np.ndarray, "active"]:
    """Number the connected sets of active taxels, in the order of their first taxel."""
    count = len(active)
    parents = np.arange(count)
    for a in range(count):
        taxels[active[a]].place = a
    for a in range(count):
        span = sites[active[a]].neighbours
        for k in range(span[0], span[1]):
            b = taxels[neighbours[k]].place
            if b > a:
                join(parents, a, b)
    for a in range(count):
        taxels[active[a]].place = -1
    connect_links(active, p_world, sites, parents)
    labels = np.empty(count, np.int64)
    found = 0
    for a in range(count):
        if parents[a] == a:
            labels[a] = found
            found += 1
        else:
            labels[a] = labels[root_of(parents, a)]
    return labels


@compiled
@no_type_check
def connect_links(
    active: Int[np.ndarray, "active"],
    p_world: Float[np.ndarray, "active 3"],
    sites: np.ndarray,
    parents: Int[np.ndarray, "active"],
) -> None:
    """Join taxels of different links that are within reach in this pose.

    Taxels of one link come in runs; runs are compared by their boxes first.
    """
    ends, runs, widest = np.zeros(len(active) + 1, np.int64), 0, 0.0
    for a in range(len(active)):
        site = sites[active[a]]
        if a == 0 or site.link != sites[active[a - 1]].link:
            runs += 1
        ends[runs] = a + 1
        widest = max(widest, site.reach)
    if runs < 2:
        return
    boxes = np.empty((runs, 2, 3))
    for r in range(runs):
        box_of(p_world[ends[r] : ends[r + 1]], boxes[r])
    for r in range(runs):
        for s in range(r + 1, runs):
            if box_gap(boxes[r], boxes[s]) > widest:
                continue
            if sites[active[ends[r]]].link == sites[active[ends[s]]].link:
                continue
            for a in range(ends[r], ends[r + 1]):
                if point_gap(p_world[a], boxes[s]) <= widest:
                    others = range(ends[s], ends[s + 1])
                    join_near(a, others, active, p_world, sites, parents)


@compiled
@no_type_check
def join_near(
    a: int,
    others: range,
    active: Int[np.ndarray, "active"],
    p_world: Float[np.ndarray, "active 3"],
    sites: np.ndarray,
    parents: Int[np.ndarray, "active"],
) -> None:
    """Join one taxel and those of the others that are within the larger reach."""
    for b in others:
        far = max(sites[active[a]].reach, sites[active[b]].reach)
        d0 = p_world[a, 0] - p_world[b, 0]
        d1 = p_world[a, 1] - p_world[b, 1]
        d2 = p_world[a, 2] - p_world[b, 2]
        if d0 * d0 + d1 * d1 + d2 * d2 <= far * far:
            join(parents, a, b)


@compiled
@no_type_check
def find_contacts(
    candidates: Int[np.ndarray, "candidate"],
    reading: Instant,
    rules: Rules,
    sites: np.ndarray,
    neighbours: Int[np.ndarray, "pair"],
    memory: Memory,
) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, "load 3"]]:
    """The contacts of a reading, their loads, and where those are.

    Returns:
        CONTACT and LOAD records, each contact's loads ordered by patch, row and column;
        and the position of each load in the world [m].
    """
    active = by_rank(activate(candidates, reading, rules, memory), sites)
    T_world_link = reading.T_world_link
    p_world = place(active, sites.position, sites.link, T_world_link, 1.0)
    n_world = place(active, sites.normal, sites.link, T_world_link, 0.0)
    labels = connect(active, p_world, sites, neighbours, memory.taxels)
    contacts = lay_out(labels, reading.stamp)
    loads, points = np.empty(len(active), LOAD), np.empty((len(active), 3))
    most = np.full(len(contacts), -1.0)
    for a in range(len(active)):
        i, contact = active[a], contacts[labels[a]]
        k = contact.loads[1]
        contact.loads[1] += 1
        pressure = reading.pressure[i]
        loads[k].taxel, loads[k].pressure = i, pressure
        loads[k].onset = memory.taxels[i].onset
        points[k] = p_world[a]
        force = PASCAL * pressure * sites[i].area
        add_load(contact, force, pressure, sites[i].area, p_world[a], n_world[a])
        if force > most[labels[a]]:
            most[labels[a]] = force
            contact.link, contact.patch = sites[i].link, sites[i].patch
    for n in range(len(contacts)):
        finish_sums(contacts[n], T_world_link)
    return contacts, loads, points


@compiled
@no_type_check
def lay_out(labels: Int[np.ndarray, "active"], stamp: int) -> np.ndarray:
    """A contact for each label; its loads end where the next is to be written."""
    contacts = np.zeros(labels.max() + 1 if len(labels) else 0, CONTACT)
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
@no_type_check
def add_load(
    contact: np.void,
    force: float,
    pressure: float,
    area: float,
    p_world: Float[np.ndarray, "3"],
    n_world: Float[np.ndarray, "3"],
) -> None:
    """Add a taxel to the sums of its contact."""
    contact.force += force
    contact.area += area
    contact.peak = max(contact.peak, pressure)
    for r in range(3):
        contact.p_world[r] += force * p_world[r]
        contact.n_world[r] += force * n_world[r]


@compiled
@no_type_check
def finish_sums(contact: np.void, T_world_link: Float[np.ndarray, "link 4 4"]) -> None:
    """Turn the sums of a contact into its centre and its unit normal."""
    n_world = contact.n_world
    length = np.sqrt(n_world[0] ** 2 + n_world[1] ** 2 + n_world[2] ** 2)
    for r in range(3):
        contact.p_world[r] /= contact.force
        if length > 0.0:
            n_world[r] /= length
    to_link(T_world_link[contact.link], contact.p_world, contact.p_link)
