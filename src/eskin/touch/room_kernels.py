"""The contacts and loads of a reading while they are written, older ones included."""

from typing import NamedTuple, no_type_check

import numpy as np

from eskin.compiled import compiled
from eskin.touch.records import CONTACT, LOAD, TouchRecords

CONTACTS, LOADS = 0, 1
"""What `Room.used` counts."""

NOWHERE = -1


class Room(NamedTuple):
    """Room for contacts and loads, large enough for one reading."""

    contacts: np.ndarray
    """(room) CONTACT."""
    loads: np.ndarray
    """(room) LOAD."""
    places: np.ndarray
    """(contact before) where it is kept, or `NOWHERE`."""
    used: np.ndarray
    """(2) how much is written."""


@compiled
@no_type_check
def make_room(contacts: np.ndarray, loads: np.ndarray, before: TouchRecords) -> Room:
    """Room that begins with the contacts and loads of a reading.

    It may come to hold all that there was before, and once more the loads of every
    touch, of this reading and of the one before.
    """
    older = len(before.contacts)
    room = Room(
        np.empty(len(contacts) + older, CONTACT),
        np.empty(2 * (len(loads) + len(before.loads)), LOAD),
        np.full(older, NOWHERE),
        np.array([len(contacts), len(loads)]),
    )
    room.contacts[: len(contacts)] = contacts
    room.loads[: len(loads)] = loads
    return room


@compiled
@no_type_check
def keep(old: int, before: TouchRecords, room: Room) -> int:
    """Keep a contact of the reading before with its loads; return its new place."""
    place = keep_place(old, before, room)
    span = room.contacts[place].loads
    if span[0] == span[1]:
        had = before.contacts[old].loads
        span[0] = room.used[LOADS]
        span[1] = add_loads(before.loads[had[0] : had[1]], room)
    return place


@compiled
@no_type_check
def keep_place(old: int, before: TouchRecords, room: Room) -> int:
    """Keep where a contact of the reading before was; return its new place."""
    if room.places[old] == NOWHERE:
        place = room.used[CONTACTS]
        room.used[CONTACTS] += 1
        room.places[old] = place
        room.contacts[place] = before.contacts[old]
        room.contacts[place].loads[0] = room.contacts[place].loads[1] = 0
    return room.places[old]


@compiled
@no_type_check
def add_loads(loads: np.ndarray, room: Room) -> int:
    """Write loads behind those that are there; return where they end now."""
    end = room.used[LOADS] + len(loads)
    room.loads[room.used[LOADS] : end] = loads
    room.used[LOADS] = end
    return end
