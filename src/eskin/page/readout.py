"""What the panel says, as HTML."""

from collections.abc import Sequence
from html import escape

import numpy as np
from jaxtyping import Bool

from eskin.page.picture import ArmLine, Picture, Saying, TouchNow
from eskin.page.setup import Setup

INK, PALE, LINE = "#1f2733", "#7b8594", "#e6e9ee"
TEAL, AMBER, RED, BLUE = "#1f9e89", "#c77700", "#c43a31", "#3b6fb6"
STATES = {
    "running": TEAL,
    "paused": AMBER,
    "held": RED,
    "stopped": RED,
    "waiting": PALE,
}
KINDS = {"detection": TEAL, "command": BLUE, "refused": AMBER, "event": PALE}
FONT = f"font:12px/1.45 system-ui,sans-serif;color:{INK};padding:0 14px"


def block(inside: str) -> str:
    """A part of the panel."""
    return f'<div style="{FONT}">{inside}</div>'


def status(picture: Picture) -> str:
    """How fast, how old, what is wrong; and what the arm does."""
    wrong = f"{picture.faults} fault{'s' * (picture.faults != 1)}"
    colour = RED if picture.faults else TEAL
    return numbers(
        ("readings/s", f"{picture.rate:.0f}"),
        ("step", f"{1e3 * picture.step:.2f} ms"),
        ("age", f"{1e3 * picture.age:.1f} ms"),
        ("skin", f'<span style="color:{colour}">{wrong}</span>'),
    ) + (block(arm(picture.arm)) if picture.arm else "")


def numbers(*pairs: tuple[str, str]) -> str:
    """Names with their values beside each other."""
    cells = "".join(
        f'<div><div style="color:{PALE};font-size:10px">{name}</div>'
        f'<div style="font-weight:600;font-variant-numeric:tabular-nums">{value}</div>'
        "</div>"
        for name, value in pairs
    )
    return block(
        f'<div style="display:flex;justify-content:space-between">{cells}</div>'
    )


def plain(text: str) -> str:
    """Text as it is, harmless."""
    return escape(text)


def comparison(rows: Sequence[tuple[float, str, str, bool]], right: int) -> str:
    """What was done beside what was said.

    Args:
        rows: time [s], label, detection, and whether they agree.
        right: how many do.
    """
    head = f'<div style="color:{PALE}">{right} of {len(rows)} as labelled</div>'
    body = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE}">'
        f'<span style="color:{PALE};width:52px;text-align:right">{seconds:.1f} s</span>'
        f'<span style="flex:1">{escape(word(label))}</span>'
        f'<span style="flex:1;color:{TEAL if is_right else RED}">'
        f"{escape(word(said))}</span></div>"
        for seconds, label, said, is_right in rows
    )
    return block(head + body)


def arm(line: ArmLine) -> str:
    """The arm's state in one line."""
    word = line.state + (f": {line.why}" if line.why else "")
    rest = f"{line.speed:.0%} speed, gripper {line.gripper}, to {line.target or '-'}"
    return (
        f'<div style="margin-top:6px;padding:5px 8px;border-radius:6px;'
        f'background:{LINE}"><b style="color:{STATES[line.state]}">{escape(word)}</b>'
        f'<br><span style="color:{PALE}">{escape(rest)}</span></div>'
    )


def bars(touches: Sequence[TouchNow], gestures: Sequence[str]) -> str:
    """Probabilities of the strongest touch."""
    first = touches[0] if touches else None
    head = "no touch"
    if first is not None:
        head = f"touch {first.id} on {escape(first.link)}, {first.force:.1f} N"
    chances = np.zeros(len(gestures)) if first is None else first.probabilities
    best = int(np.argmax(chances)) if first is not None else -1
    rows = "".join(
        bar(gesture, float(chance), number == best)
        for number, (gesture, chance) in enumerate(zip(gestures, chances, strict=True))
    )
    return block(f'<div style="color:{PALE};margin:4px 0 3px">{head}</div>{rows}')


def bar(gesture: str, chance: float, is_best: bool) -> str:
    """One probability."""
    colour = TEAL if is_best else "#b9c2cd"
    weight = 600 if is_best else 400
    return (
        '<div style="display:flex;align-items:center;gap:8px;height:18px">'
        f'<span style="width:72px;font-weight:{weight}">{escape(word(gesture))}</span>'
        f'<span style="flex:1;height:9px;border-radius:5px;background:{LINE}">'
        f'<span style="display:block;height:9px;border-radius:5px;width:{chance:.0%};'
        f'background:{colour}"></span></span>'
        f'<span style="width:36px;text-align:right;color:{PALE};'
        f'font-variant-numeric:tabular-nums">{chance:.0%}</span></div>'
    )


def log(sayings: Sequence[Saying]) -> str:
    """Detections, commands and events, newest first."""
    rows = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE};'
        'padding:1px 0">'
        f'<span style="color:{PALE};width:46px;flex:none;text-align:right;'
        f'font-variant-numeric:tabular-nums">{saying.seconds:.1f} s</span>'
        f'<span style="color:{KINDS[saying.kind]}">{escape(saying.text)}</span></div>'
        for saying in sayings
    )
    return block(rows or f'<span style="color:{PALE}">nothing yet</span>')


def patches(setup: Setup, valid: Bool[np.ndarray, "taxel"]) -> str:
    """How much of each patch is believed."""
    sizes = np.bincount(setup.patch_index, minlength=len(setup.patches))
    good = np.bincount(setup.patch_index, valid, minlength=len(setup.patches))
    cells = "".join(
        chip(name, int(size - whole), int(size))
        for name, whole, size in zip(setup.patches, good, sizes, strict=True)
    )
    return block(f'<div style="display:flex;flex-wrap:wrap;gap:4px">{cells}</div>')


def chip(patch: str, out: int, size: int) -> str:
    """The state of one patch."""
    colour, note = TEAL, ""
    if out:
        colour, note = (RED, " silent") if out == size else (AMBER, f" {out} out")
    return (
        f'<span style="border:1px solid {LINE};border-radius:9px;padding:0 7px;'
        f'font-size:11px"><span style="color:{colour}">&#9679;</span> '
        f"{escape(word(patch))}{note}</span>"
    )


def word(name: str) -> str:
    """A name without underscores."""
    return name.replace("_", " ")
