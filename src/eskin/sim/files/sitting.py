"""A set split into sittings: one person, one build, one file each."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from eskin.sim.clip.plan import BuildOrigin, Origin, Seed
from eskin.sim.constants import Constants
from eskin.sim.files.sets import ClipSet
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Sitting:
    """One file of a set: the skin is attached once, one person touches."""

    file: str
    """Path of the recording below the folder of the set."""
    number: int
    """Counts the files of the set."""
    first: int
    """Number of its first clip among those of its part."""
    clips: int
    """How many clips it has."""
    person: Origin
    """Who touches."""
    others: tuple[Origin, ...]
    """Who else may touch at the same time."""
    build: BuildOrigin
    """The sensor."""
    session: Origin
    """What stays the same during the sitting."""
    start: int
    """Its first stamp [ns since the epoch]."""


def seed_of(role: str, first: int, second: int, seed: int) -> Seed:
    """The seed of something in a role; no two things share one.

    The seed of the set comes last since it may take any number of words.
    """
    return (zlib.crc32(role.encode()), first, second, seed)


def sittings_of(
    chosen: ClipSet, seed: int, constants: Constants
) -> tuple[Sitting, ...]:
    """The files of a set, in order."""
    people = [
        Origin(f"{chosen.people}-p{i}", seed_of(f"person {chosen.people}", i, 0, seed))
        for i in range(chosen.subjects)
    ]
    found: list[Sitting] = []
    for part in chosen.parts:
        first = 0
        for subject, clips in shares_of(chosen, part.clips, constants):
            number = len(found)
            name = f"{chosen.name}-{number:04d}"
            others = people[:subject] + people[subject + 1 :]
            found.append(
                Sitting(
                    file=f"{part.folder}/{name}.mcap".lstrip("/"),
                    number=number,
                    first=first,
                    clips=clips,
                    person=people[subject],
                    others=tuple(others),
                    build=build_of(chosen, subject, seed),
                    session=Origin(
                        name, seed_of(f"session {chosen.name}", number, 0, seed)
                    ),
                    start=start_of(number, constants),
                )
            )
            first += clips
    return tuple(found)


def build_of(chosen: ClipSet, subject: int, seed: int) -> BuildOrigin:
    """The sensor that a person meets."""
    number = subject % chosen.build_count
    role = f"build {chosen.builds}"
    return BuildOrigin(
        f"{chosen.builds}-b{number}",
        seed_of(role, number, 0, seed),
        chosen.build_kind,
    )


def start_of(number: int, constants: Constants) -> int:
    """The first stamp of a file [ns since the epoch]."""
    epoch, apart = constants.value("sets.epoch"), constants.value("sets.apart")
    return (int(epoch) + number * int(apart)) * NS_PER_S


def shares_of(
    chosen: ClipSet, clips: int, constants: Constants
) -> Iterator[tuple[int, int]]:
    """Person and number of clips of each sitting of a part."""
    most = int(constants.value("clip.most")) if chosen.classes else 1
    for subject, share in enumerate(evenly(clips, chosen.subjects)):
        for count in evenly(share, -(-share // most)):
            yield subject, count


def evenly(total: int, shares: int) -> list[int]:
    """A number in so many shares that differ by one at most; none is empty."""
    parts = [total * (i + 1) // shares - total * i // shares for i in range(shares)]
    return [part for part in parts if part]
