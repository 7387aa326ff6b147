"""Attack the timing of a skin: delays that grow, step or vary, bursts and replays.

    python -m lab.attacks delay
    python -m lab.attacks delay --only "step 3 s" --minutes 2

A patch sends 50 scans a second; from 12 s on its packets are delayed or replayed. In
every reading with its data somebody
touches it. The table has the largest true age of data on which such a touch was obeyed,
when an event said that the patch is late or silent, with the true age of its newest
packet then, and the share of the scans made from then on that were used. Links are
one-way (the clock of the patch is 50 ppm too fast, which hides a delay that grows), or
have echoes once a second (its clock is 1 % too fast): of the line, which the attack
delays like data, or left alone by it. The clock is simulated.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eskin.units import NS_PER_S
from lab.attacks.played_line import (
    START,
    Arrival,
    PlayedEcho,
    PlayedLine,
    PlayedPatch,
)
from lab.tables import format_head, format_row

Link = Literal["one-way", "echo", "echo left alone"]
LINKS: tuple[Link, ...] = ("one-way", "echo", "echo left alone")
BEGIN = 12.0
"""When an attack begins [s]."""
TRAVEL = (0.001, 0.003)
"""Range of the delay of a packet that is not attacked [s]."""
ONE_WAY_ERROR = 50e-6
ECHO_ERROR = 0.01
"""Relative errors of the attacked clock without and with echoes."""
LIMIT = 0.15
"""Age that nothing obeyed may exceed [s]."""

Attack = Callable[[Iterable[Arrival], np.random.Generator], Iterator[Arrival]]
"""Gives the arrivals, in any order, of packets that are sent at once."""


def shift(arrival: Arrival, delay: float) -> Arrival:
    """Return an arrival that comes later by a delay [s]."""
    return arrival._replace(arrived=arrival.arrived + round(delay * NS_PER_S))


def since_begin(arrival: Arrival) -> float:
    """Return the time from the beginning of the attack to an arrival [s]."""
    return (arrival.arrived - START) / NS_PER_S - BEGIN


def grow(rate: float, begin: float = BEGIN) -> Attack:
    """Delay packets by a share of the time since a begin [s]."""
    return lambda sent, rng: (
        shift(a, rate * max(0.0, since_begin(a) + BEGIN - begin)) for a in sent
    )


def step(delay: float) -> Attack:
    """Delay packets by a time from the beginning on [s]."""
    return lambda sent, rng: (shift(a, delay * (since_begin(a) >= 0)) for a in sent)


def step_for(delay: float, seconds: float) -> Attack:
    """Delay packets by a time [s] for some seconds."""
    return lambda sent, rng: (
        shift(a, delay * (0 <= since_begin(a) < seconds)) for a in sent
    )


def jitter(spread: float) -> Attack:
    """Delay each packet by a random time up to a spread [s]."""
    return lambda sent, rng: (
        shift(a, rng.uniform(0, spread) * (since_begin(a) >= 0)) for a in sent
    )


def burst(interval: float) -> Attack:
    """Let packets wait until the end of an interval [s]."""
    return lambda sent, rng: (
        shift(a, (-since_begin(a)) % interval * (since_begin(a) >= 0)) for a in sent
    )


def replay(first: float, last: float, cut: bool, gap: float = 0.0) -> Attack:
    """Play the packets between two times [s] again and again from the beginning on.

    Echoes are not replayed: the host does not believe one that it did not request.

    Args:
        first: when the recorded packets begin.
        last: when they end.
        cut: whether the patch is cut off meanwhile.
        gap: time for which nothing comes before the first replay.
    """

    def attack(sent: Iterable[Arrival], rng: np.random.Generator) -> Iterator[Arrival]:
        recorded = []
        number = 0
        for arrival in sent:
            time = since_begin(arrival) + BEGIN
            if first <= time < last and not isinstance(arrival.packet, PlayedEcho):
                recorded.append(arrival)
            if time < BEGIN or not cut or isinstance(arrival.packet, PlayedEcho):
                yield arrival
            if time >= BEGIN + gap + number * (last - first):
                delay = BEGIN + gap + number * (last - first) - first
                yield from (shift(old, delay) for old in recorded)
                number += 1

    return attack


ATTACKS: dict[str, Attack] = {
    "none": step(0.0),
    "growing 0.01 %": grow(1e-4),
    "growing 0.04 %": grow(4e-4),
    "growing 0.06 %": grow(6e-4),
    "growing 0.1 %": grow(1e-3),
    "growing 1 %": grow(1e-2),
    "growing 0.1 % from the first packet": grow(1e-3, 0.0),
    "growing 1 % from the first packet": grow(1e-2, 0.0),
    "step 0.3 s": step(0.3),
    "step 3 s": step(3.0),
    "step 0.3 s for 20 s": step_for(0.3, 20.0),
    "jitter 0 to 0.3 s": jitter(0.3),
    "bursts every 0.1 s": burst(0.1),
    "bursts every 0.5 s": burst(0.5),
    "replayed, beside the patch": replay(4.0, 10.0, False),
    "replayed, patch cut off": replay(4.0, 10.0, True),
    "replayed from the first packet, patch cut off": replay(0.0, 10.0, True, 1.0),
}


@dataclass(frozen=True)
class DelayResult:
    """A delay result has what an attack on the timing of a patch led to."""

    obeyed: float
    """Largest true age of data on which a touch was obeyed [s]."""
    said: float | None
    """Time from the first packet of the attack to the event [s]; None without one."""
    age: float | None
    """True age of the newest packet then [s]."""
    used: float
    """Share of the scans from the beginning of the attack to its last second that was
    used."""


def attack_timing(name: str, link: Link, minutes: float, seed: int = 0) -> DelayResult:
    """Play an attack to a policy, and return what it led to.

    Args:
        name: name of the attack.
        link: whether there are echoes, and whether the attack delays them.
        minutes: duration of the attack [min].
        seed: seed of the delays.
    """
    rng = np.random.default_rng((seed, 31))
    seconds = BEGIN + 60 * minutes
    interval = None if link == "one-way" else 1.0
    error = ONE_WAY_ERROR if link == "one-way" else ECHO_ERROR
    patch = PlayedPatch(0, error=error)
    sent = list(patch.send(seconds, interval))
    spared = [a for a in sent if is_echo(a) and link == "echo left alone"]
    hit = [a for a in sent if not (is_echo(a) and spared)]
    arrivals = travel([*ATTACKS[name](iter(hit), rng), *spared], rng)
    line = PlayedLine([patch])
    line.play(arrivals, seconds)
    return summarise(line, arrivals, seconds)


def is_echo(arrival: Arrival) -> bool:
    """Return whether an arrival is an echo."""
    return isinstance(arrival.packet, PlayedEcho)


def travel(arrivals: Iterable[Arrival], rng: np.random.Generator) -> list[Arrival]:
    """Return arrivals in order after the usual delay; requests take their time too."""
    travelled = []
    for arrival in arrivals:
        arrived = shift(arrival, rng.uniform(*TRAVEL))
        packet = arrived.packet
        if isinstance(packet, PlayedEcho):
            sent = packet.sent - round(rng.uniform(*TRAVEL) * NS_PER_S)
            arrived = arrived._replace(packet=packet._replace(sent=sent))
        travelled.append(arrived)
    return sorted(travelled, key=lambda arrival: arrival.arrived)


def summarise(line: PlayedLine, arrivals: list[Arrival], seconds: float) -> DelayResult:
    """Return what an attack led to."""
    begin = START + round(BEGIN * NS_PER_S)
    events = [
        event.stamp
        for event in line.events
        if event.kind in ("late", "silent") and event.stamp > START + NS_PER_S
    ]
    said = None
    age = None
    if events:
        came = [a for a in arrivals if a.arrived <= events[0]]
        said = (events[0] - begin) / NS_PER_S
        age = (events[0] - came[-1].made) / NS_PER_S
    end = START + round((seconds - 1.0) * NS_PER_S)
    used = sum(begin <= made < end for made in line.made)
    share = used / round(50 * (seconds - 1.0 - BEGIN))
    return DelayResult(line.obeyed / NS_PER_S, said, age, share)


@dataclass(frozen=True)
class Command:
    """Attack the timing of a skin on a simulated clock."""

    minutes: float = 10.0
    """Duration of each attack [min]."""
    seed: int = 0
    """Seed of the delays."""
    only: tuple[str, ...] = ()
    """Attacks to run; all without any."""
    links: tuple[Link, ...] = LINKS
    """Links to attack."""


def main(command: Command) -> None:
    """Print a table of the attacks."""
    heads = ["oldest obeyed [ms]", "said after [s]", "at an age of [ms]", "used"]
    print(format_head(["attack", "link", *heads]))
    for name in command.only or ATTACKS:
        for link in command.links:
            result = attack_timing(name, link, command.minutes, command.seed)
            cells = [
                f"{1e3 * result.obeyed:.0f}",
                "" if result.said is None else f"{result.said:.1f}",
                "" if result.age is None else f"{1e3 * result.age:.0f}",
                f"{100 * result.used:.0f} %",
            ]
            print(format_row([name, link, *cells]), flush=True)
