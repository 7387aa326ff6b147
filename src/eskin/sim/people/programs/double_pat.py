"""Double pat, and pats once or more often."""

import numpy as np

from eskin.sim.contact.press import Press
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.series import minimum_jerk, peaked


def double_pat(act: Act) -> tuple[Press, ...]:
    """Two pats; sometimes more, which mean the same."""
    more = act.happens("more", act.constants.value("double_pat.more"))
    return pats(act, several(act) if more else 2, act.kind)


def tap_many(act: Act) -> tuple[Press, ...]:
    """Three pats or more."""
    return pats(act, several(act), act.choose("double_pat.kinds"))


def several(act: Act) -> int:
    """How many pats, three or more."""
    return int(act.choose("unknown.taps"))


def pats(act: Act, count: int, group: str) -> tuple[Press, ...]:
    """Several pats by parts of a hand, each elsewhere and as firm as it happens."""
    force = draw_force(act, "double_pat.force", "double_pat")
    interval = draw_interval(act)
    contact = draw_duration(act, "pat", "double_pat")
    contact = act.note(
        "contact", min(contact, act.constants.value("double_pat.filled") * interval)
    )
    firm = [force]
    for number in range(1, count):
        share = act.draw("double_pat.second")
        firm.append(act.note(f"force.{number}", force * share))
    length, apart = act.steps(contact), max(round(interval / act.step), 1)
    apart = max(apart, length)
    series = np.zeros((count - 1) * apart + length)
    path, noise = act.wander(len(series)), act.held(len(series))
    for number, each in enumerate(firm):
        start = number * apart
        pat = peaked(act.push(length) * noise[start : start + length], each)
        series[start : start + length] = pat
        if number:
            move(act, path, start - apart + length, start)
    stay(act, series, min(firm), length // 2, len(series) - length // 2)
    flesh, angle = act.flesh(), act.turn()
    return (act.press(act.stamps(group), flesh, series, path, angle),)


def draw_interval(act: Act) -> float:
    """Time between the onsets of two pats [s]."""
    growth = act.constants.value("duration.repeat_growth") * act.difficulty
    usual = act.person.pat_interval * act.draw("double_pat.interval", 1 + growth)
    if act.regime == "cost":
        usual *= act.constants.value("double_pat.slower")
    low, high = act.constants.array("double_pat.interval_limits")
    return act.note("interval", float(np.clip(usual, low, high)))


def move(act: Act, path: np.ndarray, leave: int, land: int) -> None:
    """Write the hand's way between two pats, and where it then stays."""
    length, way = (
        act.draw("double_pat.shift"),
        act.note("shift", act.rng.uniform(0, 2 * np.pi)),
    )
    shift = length * np.array([np.cos(way), np.sin(way)])
    path[leave:land] += shift * minimum_jerk(max(land - leave, 1))[:, None]
    path[land:] += shift


def stay(act: Act, series: np.ndarray, weakest: float, first: int, last: int) -> None:
    """Let the hand not quite leave between the first and the last peak, sometimes."""
    chance = act.constants.value("double_pat.stays") * act.difficulty
    if act.happens("stays", chance):
        residue = act.constants.value("double_pat.residue") * act.person.force_scale
        residue = act.note("residue", min(residue, weakest / 2))
        series[first:last] = np.maximum(series[first:last], residue)
