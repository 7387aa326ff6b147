"""This module renders the texts of the page as HTML."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from jaxtyping import Bool, Float16

from eskin.page.colours import ColourScale, choose_gesture_colours, render_dot
from eskin.page.messages import (
    ArmSummary,
    LogEntry,
    OpenTouch,
    SceneDescription,
    ViewUpdate,
)

INK, PALE, LINE = "#1f2733", "#7b8594", "#e6e9ee"
TEAL, AMBER, RED, BLUE = "#1f9e89", "#c77700", "#c43a31", "#3b6fb6"
STATE_COLOURS = {
    "running": TEAL,
    "paused": AMBER,
    "held": RED,
    "stopped": RED,
    "waiting": PALE,
}
"""Colour of each state of the arm."""
KIND_COLOURS = {
    "detection": INK,
    "command": BLUE,
    "refused": AMBER,
    "event": PALE,
    "note": TEAL,
}
FONT = f"font:12px/1.45 system-ui,sans-serif;color:{INK};padding:0 14px"


def render_block(inside: str) -> str:
    """Return a part of the panel as HTML in the font of the panel."""
    return f'<div style="{FONT}">{inside}</div>'


def render_status(update: ViewUpdate, valid: Bool[np.ndarray, "taxel"]) -> str:
    """Return rate, delay, taxels in use, arm and recording as HTML."""
    working, count = int(valid.sum()), len(valid)
    colour = TEAL if working == count else AMBER if working > 0.9 * count else RED
    parts = render_numbers(
        ("readings/s", f"{update.rate:.0f}"),
        ("recognition", f"{1e3 * update.step:.2f} ms"),
        ("delay", f"{1e3 * update.age:.0f} ms"),
        ("taxels in use", f'<span style="color:{colour}">{working} of {count}</span>'),
    )
    if update.arm is not None:
        parts += render_block(render_arm(update.arm))
    if update.recording:
        parts += render_block(f"{render_dot(RED)}{escape(update.recording)}")
    return parts


def render_notice(text: str) -> str:
    """Return a notice in small print as HTML."""
    return render_block(
        f'<div style="color:{PALE};font-size:11px">{escape(text)}</div>'
    )


def render_warning(text: str) -> str:
    """Return a warning as HTML."""
    return render_block(
        f'<div style="margin-bottom:6px;padding:5px 8px;border-radius:6px;color:#fff;'
        f'background:{RED}">{escape(text)}</div>'
    )


def render_numbers(*pairs: tuple[str, str]) -> str:
    """Return names with their values side by side as HTML."""
    cells = "".join(
        f'<div><div style="color:{PALE};font-size:10px">{name}</div>'
        f'<div style="font-weight:600;font-variant-numeric:tabular-nums">{value}</div>'
        "</div>"
        for name, value in pairs
    )
    return render_block(
        f'<div style="display:flex;justify-content:space-between">{cells}</div>'
    )


def render_gestures(
    counted: Sequence[tuple[str, int]], colours: Mapping[str, str]
) -> str:
    """Return gestures with their key, colour and number of labels as HTML."""
    cells = "".join(
        f'<span style="white-space:nowrap;margin-right:10px"><b>{number}</b> '
        f"{render_dot(colours[name])}{escape(to_words(name))} "
        f'<span style="color:{PALE}">{count or ""}</span></span> '
        for number, (name, count) in enumerate(counted, 1)
    )
    return render_block(cells)


def render_instant(
    label: tuple[str, str], model: tuple[str, str], colours: Mapping[str, str]
) -> str:
    """Return the label at an instant beside the detection of the model, as HTML.

    Args:
        label: gesture of the label, empty without one, and the text.
        model: gesture of the detection, empty without one, and the text.
        colours: colour of each gesture.
    """
    cells = "".join(
        f'<div style="flex:1;border-radius:6px;padding:3px 8px;background:{LINE};'
        f'border-left:6px solid {colours.get(gesture, LINE)}">'
        f'<span style="color:{PALE}">{title}</span> '
        f"<b>{escape(to_words(text))}</b></div>"
        for title, (gesture, text) in (("label", label), ("model", model))
    )
    return render_block(f'<div style="display:flex;gap:8px;margin:4px 0">{cells}</div>')


def render_comparison(rows: Sequence[tuple[float, str, str, bool]], right: int) -> str:
    """Return a table of labels and detections as HTML.

    Args:
        rows: time [s], label, detection, and whether they agree.
        right: number of rows that agree.
    """
    head = f'<div style="color:{PALE}">{right} of {len(rows)} match</div>'
    body = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE}">'
        f'<span style="color:{PALE};width:52px;text-align:right">{seconds:.1f} s</span>'
        f'<span style="flex:1">{escape(to_words(label))}</span>'
        f'<span style="flex:1;color:{TEAL if is_right else RED}">'
        f"{escape(to_words(detection))}</span></div>"
        for seconds, label, detection, is_right in rows
    )
    return render_block(head + body)


def render_arm(summary: ArmSummary) -> str:
    """Return the state of the arm as HTML."""
    state = summary.state + (f": {summary.why}" if summary.why else "")
    colour = STATE_COLOURS[summary.state]
    target = summary.target or "-"
    rest = f"{summary.speed:.0%} speed, gripper {summary.gripper}, to {target}"
    remedy = f"<br>{escape(summary.remedy)}" if summary.remedy else ""
    return (
        f'<div style="margin-top:4px;padding:4px 8px;border-radius:6px;'
        f'background:{LINE}"><b style="color:{colour}">{escape(state)}</b>{remedy}'
        f'<br><span style="color:{PALE}">{escape(rest)}</span></div>'
    )


HOW = {"poke": "click", "double_pat": "double click", "stroke": "drag"}
HOW |= {"grab": "shift-click"}
"""How the mouse makes each gesture."""


EFFECTS = {
    "pause": "pauses the arm",
    "hold": "stops the arm",
    "resume": "resumes",
    "slow": "slows the arm",
    "normal": "full speed",
    "close gripper": "closes the gripper",
    "open gripper": "opens it",
}
"""What the page says of an action."""


def describe_actions(actions: str) -> str:
    """Return what actions do, which are separated by `or`."""
    *first, last = [EFFECTS.get(action, action) for action in actions.split(" or ")]
    return f"{', '.join(first)} or {last}" if first else last


def describe_commands(setup: SceneDescription) -> dict[str, str]:
    """Return what each gesture commands, and how the mouse makes it."""
    rules = [line.partition(": ") for line in setup.commands]
    found = {}
    for gesture in setup.gestures:
        name = to_words(gesture)
        done = [
            f"{touch.removeprefix(name).strip()} {describe_actions(action)}".strip()
            for touch, _, action in rules
            if touch == name or touch.startswith(f"{name} ")
        ]
        how = [HOW[gesture]] if setup.touchable and gesture in HOW else []
        found[gesture] = " · ".join([*how, *done])
    return found


def render_bars(touches: Sequence[OpenTouch], setup: SceneDescription) -> str:
    """Return the probabilities of the strongest touch as HTML bars.

    Each gesture has its colour, and what it commands below it.
    """
    first = touches[0] if touches else None
    head = "no touch"
    if first is not None:
        head = f"touch {first.id} on {escape(to_words(first.link))}"
        head += f", {first.force:.1f} N"
    count = len(setup.gestures)
    probabilities = np.zeros(count) if first is None else first.probabilities
    best = int(np.argmax(probabilities)) if first is not None else -1
    colours, commands = choose_gesture_colours(setup.gestures), describe_commands(setup)
    rows = "".join(
        render_bar(
            gesture,
            float(probabilities[number]),
            number == best,
            colours[gesture],
            commands[gesture],
        )
        for number, gesture in enumerate(setup.gestures)
    )
    head = f'<div style="color:{PALE};margin:2px 0">{head}</div>'
    return render_block(head + rows)


def render_bar(
    gesture: str, probability: float, is_best: bool, colour: str, command: str
) -> str:
    """Return one probability as an HTML bar, with what the gesture commands."""
    weight = 600 if is_best else 400
    style = f"color:{PALE};font-size:10.5px;line-height:1.2;margin:0 0 2px 14px"
    below = f'<div style="{style}">{escape(command)}</div>' if command else ""
    return (
        '<div style="display:flex;align-items:center;gap:8px;height:17px">'
        f'<span style="width:88px;font-weight:{weight};white-space:nowrap">'
        f"{render_dot(colour)}{escape(to_words(gesture))}</span>"
        f'<span style="flex:1;height:9px;border-radius:5px;background:{LINE}">'
        '<span style="display:block;height:9px;border-radius:5px;'
        f'width:{probability:.0%};background:{colour}"></span></span>'
        f'<span style="width:36px;text-align:right;color:{PALE};'
        f'font-variant-numeric:tabular-nums">{probability:.0%}</span></div>{below}'
    )


def render_log(
    log_entries: Sequence[LogEntry], colours: Mapping[str, str] | None = None
) -> str:
    """Return detections, commands and events as HTML, newest first.

    Args:
        log_entries: the entries.
        colours: colour of each gesture, which marks detections.
    """
    rows = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE};'
        'padding:1px 0">'
        f'<span style="color:{PALE};width:46px;flex:none;text-align:right;'
        f'font-variant-numeric:tabular-nums">{entry.seconds:.1f} s</span>'
        f'<span style="color:{KIND_COLOURS[entry.kind]}">'
        f"{render_mark(entry, colours or {})}{escape(entry.text)}</span></div>"
        for entry in log_entries
    )
    inside = rows or f'<span style="color:{PALE}">nothing has happened yet</span>'
    style = "height:80px;overflow-y:auto;margin:4px 0"
    return render_block(f'<div style="{style}">{inside}</div>')


def render_mark(entry: LogEntry, colours: Mapping[str, str]) -> str:
    """Return the dot of a detection's gesture as HTML; empty for other entries."""
    return render_dot(colours[entry.gesture]) if entry.gesture in colours else ""


def render_correction(
    last: LogEntry | None, names: Sequence[str], colours: Mapping[str, str]
) -> str:
    """Return the last detection, and the keys that correct it, as HTML."""
    if last is None:
        return render_block("nothing was recognised yet")
    keys = " ".join(
        f'<span style="white-space:nowrap"><b>{number}</b> '
        f"{render_dot(colours[name])}{escape(to_words(name))}</span>"
        for number, name in enumerate(names[:9], 1)
    )
    return render_block(
        f"at {last.seconds:.1f} s: {render_dot(colours.get(last.gesture, LINE))}"
        f"<b>{escape(last.text)}</b><br>{keys}"
    )


def unpack_valid(
    update: ViewUpdate, setup: SceneDescription
) -> Bool[np.ndarray, "taxel"]:
    """Return whether each taxel of an update is valid."""
    return np.unpackbits(update.valid, count=setup.patch_index.size).astype(bool)


def render_patches(setup: SceneDescription, valid: Bool[np.ndarray, "taxel"]) -> str:
    """Return how many taxels of each patch are not valid, as HTML."""
    sizes = np.bincount(setup.patch_index, minlength=len(setup.patches))
    good = np.bincount(setup.patch_index, valid, minlength=len(setup.patches))
    cells = "".join(
        render_patch_state(name, int(size - whole), int(size))
        for name, whole, size in zip(setup.patches, good, sizes, strict=True)
    )
    style = "display:flex;flex-wrap:wrap;gap:4px"
    return render_block(f'<div style="{style}">{cells}</div>')


def render_patch_state(patch: str, out: int, size: int) -> str:
    """Return the state of one patch as HTML."""
    colour, note = TEAL, ""
    if out:
        colour, note = (RED, " silent") if out == size else (AMBER, f" {out} out")
    return (
        f'<span style="border:1px solid {LINE};border-radius:9px;padding:0 7px;'
        f'font-size:11px"><span style="color:{colour}">&#9679;</span> '
        f"{escape(to_words(patch))}{note}</span>"
    )


MAP_STYLE = (
    "<style>.eskin-map text{display:none;font-size:5px;fill:#1f2733}"
    ".eskin-map g:hover text{display:block}"
    ".eskin-map g:hover circle{stroke:#1f2733;stroke-width:.8}</style>"
)
"""Shows the value of the taxel under the pointer, without a word from this process."""


def render_patch_map(
    setup: SceneDescription,
    patch: int,
    pressure: Float16[np.ndarray, "taxel"],
    valid: Bool[np.ndarray, "taxel"],
    scale: ColourScale,
) -> str:
    """Return a patch as HTML, unrolled by its rows and columns, seen from outside."""
    taxels = np.flatnonzero(setup.patch_index == patch)
    colours = scale.colours(pressure[taxels].astype(np.float64), valid[taxels]).tolist()
    width = 10 * (int(setup.columns[taxels].max()) + 1)
    height = 10 * (int(setup.rows[taxels].max()) + 1)
    cells = "".join(
        f'<g><circle cx="{10 * column + 5}" cy="{10 * row + 5}" r="4.2" '
        f'fill="rgb({red},{green},{blue})"/>'
        f'<text x="0" y="-2">row {row}, column {column}: {value}</text></g>'
        for row, column, (red, green, blue), value in zip(
            setup.rows[taxels].tolist(),
            setup.columns[taxels].tolist(),
            colours,
            [
                f"{kpa:.0f} kPa" if good else "not used"
                for kpa, good in zip(
                    pressure[taxels].tolist(), valid[taxels].tolist(), strict=True
                )
            ],
            strict=True,
        )
    )
    return render_block(
        f'{MAP_STYLE}<div style="color:{PALE}">{escape(to_words(setup.patches[patch]))}'
        ", rows down, columns across; point at a taxel</div>"
        f'<svg class="eskin-map" viewBox="0 -8 {width} {height + 8}" '
        'style="width:100%;max-height:260px;overflow:visible">'
        f"{cells}</svg>"
    )


def to_words(name: str) -> str:
    """Return a name with spaces in place of underscores."""
    return name.replace("_", " ")
