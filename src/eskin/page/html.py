"""This module renders the texts and colours of the page, as HTML."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import cycle

import numpy as np
from jaxtyping import Bool, Float16

from eskin.page.messages import (
    ArmCondition,
    ArmSummary,
    GuideBoard,
    LogEntry,
    OpenTouch,
    QuestionBoard,
    RecordingState,
    SceneDescription,
    TouchRule,
    ViewUpdate,
)
from eskin.skin.colours import INVALID_COLOUR, REST_COLOUR, ColourScale
from eskin.units import format_index

INK = "light-dark(#1f2733,#e3e8ee)"
PALE = "light-dark(#596372,#b0b9c4)"
LINE = "light-dark(#e6e9ee,#3a424d)"
TEAL = "light-dark(#0c6b60,#5ecbb8)"
AMBER = "light-dark(#8a5000,#f0b255)"
RED = "light-dark(#b3261e,#ff9d94)"
BLUE = "light-dark(#2b5c9e,#93bdf5)"
"""Colours of the panel on white and on black, each with a contrast of 4.5 or more to
both of its backgrounds."""
AT_WORK: tuple[ArmCondition, ...] = ("running", "stopping", "standing")
"""Conditions in which nobody needs to do anything for the arm to go on."""
STATES: dict[ArmCondition, tuple[str, str]] = {
    "running": ("The arm is running", TEAL),
    "stopping": ("The arm stops", PALE),
    "standing": ("The arm stands still", PALE),
    "paused": ("The arm is paused", AMBER),
    "held": ("The arm is stopped", RED),
    "stopped": ("The arm is stopped", RED),
}
"""What the page says of each condition of the arm, and in which colour."""
KIND_COLOURS = {
    "detection": INK,
    "command": BLUE,
    "refused": AMBER,
    "event": PALE,
    "note": TEAL,
}
"""Colour of each kind of entry of the log."""
GESTURE_COLOURS = {
    "none": "#4a525e",
    "unknown": "#c8cdd4",
    "poke": "#d55e00",
    "double_pat": "#0072b2",
    "grab": "#009e73",
    "stroke": "#cc79a7",
}
"""Colours of the gestures that eskin comes with (Okabe and Ito 2008), and of none."""
OTHER_COLOURS = ("#e69f00", "#56b4e9", "#5d3a9b", "#8c510a", "#b8de29")
"""Colours of other gestures, in turns."""
FONT = f"font:12px/1.45 system-ui,sans-serif;color:{INK};padding:0 14px"
BOX = "padding:5px 8px;border-radius:6px"
ROW = "display:flex;gap:8px"
NUMERALS = "font-variant-numeric:tabular-nums"
"""Styles of a part of the panel, of a box, of cells side by side, and of numbers."""


def choose_gesture_colours(gestures: Iterable[str]) -> dict[str, str]:
    """Return the colour of each gesture, the same wherever the same ones are shown."""
    others = sorted(set(gestures) - set(GESTURE_COLOURS))
    named = zip(others, cycle(OTHER_COLOURS), strict=False)
    return GESTURE_COLOURS | dict(named)


def list_gestures(gestures: Iterable[str]) -> list[str]:
    """Return gestures in the order in which the page lists them: `none` is last."""
    return sorted(gestures, key=lambda name: name == "none")


def to_words(name: str) -> str:
    """Return a name with spaces in place of underscores."""
    return name.replace("_", " ")


def div(style: str, *inside: str) -> str:
    """Return parts in a box of a style as HTML."""
    return f'<div style="{style}">{"".join(inside)}</div>'


def span(style: str, *inside: str) -> str:
    """Return parts in a line of a style as HTML."""
    return f'<span style="{style}">{"".join(inside)}</span>'


def render_brief(*inside: str) -> str:
    """Return parts that give way to a tab beside the first in a low window, as HTML."""
    return f'<div class="eskin-brief">{"".join(inside)}</div>'


def render_name(name: str) -> str:
    """Return a name in words as HTML."""
    return escape(to_words(name))


def render_dot(colour: tuple[int, int, int] | str) -> str:
    """Return a dot of a colour as HTML, beside the text that it explains."""
    if not isinstance(colour, str):
        colour = "rgb({},{},{})".format(*colour)
    return span(
        "display:inline-block;width:9px;height:9px;margin-right:4px;"
        f"border:1px solid #99a;border-radius:5px;background:{colour}"
    )


def render_block(*inside: str) -> str:
    """Return a part of the panel as HTML in the font of the panel."""
    return div(FONT, *inside)


def render_notice(text: str) -> str:
    """Return a notice in small print as HTML."""
    return render_block(div(f"color:{PALE};font-size:11px", escape(text)))


def render_purpose(setup: SceneDescription) -> str:
    """Return what the page is, and what to do first, as HTML."""
    text = (
        "This page shows what a robot feels: touch its skin, and read below which "
        "gesture that was."
    )
    if setup.touchable:
        text = (
            "This simulated robot feels touch: click on its skin, and read below what "
            "it felt."
        )
    return render_brief(render_block(div("margin-bottom:6px", escape(text))))


def render_warning(text: str) -> str:
    """Return a warning as HTML."""
    style = f"margin-bottom:6px;{BOX};color:#fff;background:#b3261e"
    return render_block(div(style, escape(text)))


def render_request(board: GuideBoard) -> str:
    """Return what to do now as HTML."""
    style = "font-size:15px;font-weight:600;min-height:72px;padding:4px 0 8px"
    return render_block(div(style, escape(board.request)))


def render_result(board: GuideBoard) -> str:
    """Return the result as HTML, one line below the other; empty without one."""
    if not board.result:
        return ""
    lines = "".join(f"<div>{escape(line)}</div>" for line in board.result)
    return render_block(div(f"{BOX};background:{LINE}", lines))


def render_numbers(*pairs: tuple[str, str]) -> str:
    """Return names with their values side by side as HTML."""
    cells = "".join(
        f"<div>{div(f'color:{PALE};font-size:11px', name)}"
        f"{div(f'font-weight:600;white-space:nowrap;{NUMERALS}', value)}</div>"
        for name, value in pairs
    )
    return render_block(
        div("display:grid;grid-template-columns:4fr 4fr 3fr 6fr;gap:4px", cells)
    )


def render_status(update: ViewUpdate) -> str:
    """Return rate, delay, taxels in use, arm and recording as HTML."""
    working = int(update.valid.sum())
    count = len(update.valid)
    colour = TEAL if working == count else AMBER if working > 0.9 * count else RED
    parts = render_brief(
        render_numbers(
            ("readings/s", f"{update.rate:.0f}"),
            ("computing", f"{1e3 * update.step:.2f} ms"),
            ("delay", f"{1e3 * update.age:.0f} ms"),
            ("taxels", span(f"color:{colour}", f"{working} of {count}")),
        )
    )
    if update.arm is not None:
        parts += render_block(render_arm(update.arm))
    if update.recording is not None:
        parts += render_recording(update.recording)
    return parts


def render_recording(recording: RecordingState) -> str:
    """Return where it is recorded, or was saved, as HTML."""
    done, colour = ("recording to", RED) if recording.is_on else ("saved to", TEAL)
    return render_block(render_dot(colour), escape(f"{done} {recording.path}"))


def render_arm(summary: ArmSummary) -> str:
    """Return the state of the arm as HTML."""
    state, colour = STATES[summary.state]
    why = to_words(summary.why)
    if why and summary.state in AT_WORK:
        state = f"{state} {why}"
        why = ""
    rest = [f"gripper {summary.gripper}"]
    if summary.target:
        rest.append(f"next: {to_words(summary.target)}")
    if 0 < summary.speed < 1:
        rest.append(f"{summary.speed:.0%} speed")
    return div(
        f"margin:4px 0 8px;padding:4px 8px;border-radius:6px;background:{LINE}",
        f'<b style="color:{colour}">{escape(state)}</b>',
        *(f"<br>{escape(text)}" for text in (why, summary.remedy) if text),
        f"<br>{span(f'color:{PALE};font-size:11px', escape(' · '.join(rest)))}",
    )


def render_keys(
    names: Sequence[str],
    colours: Mapping[str, str],
    counts: Sequence[int] | None = None,
) -> str:
    """Return gestures with their key, colour and number of labels as HTML.

    Args:
        names: names of the gestures, of which the first has the key 1.
        colours: colour of each.
        counts: number of labels of each; None where there are no labels.
    """
    style = "white-space:nowrap" + (";margin-right:10px" if counts is not None else "")
    keys = [
        f"<b>{number}</b> {render_dot(colours[name])}{render_name(name)}"
        for number, name in enumerate(names, 1)
    ]
    if counts is None:
        return " ".join(span(style, key) for key in keys)
    return "".join(
        f"{span(style, key, ' ', span(f'color:{PALE}', str(count or '')))} "
        for key, count in zip(keys, counts, strict=True)
    )


def render_correction(
    last: LogEntry | None, names: Sequence[str], colours: Mapping[str, str]
) -> str:
    """Return the last detection, and the keys that correct it, as HTML."""
    if last is None:
        return render_block("nothing was recognised yet")
    dot = render_dot(colours.get(last.gesture, LINE))
    return render_block(
        f"at {format_seconds(last.seconds)}: {dot}"
        f"<b>{escape(last.text)}</b><br>{render_keys(names[:9], colours)}"
    )


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
        div(
            f"flex:1;border-radius:6px;padding:3px 8px;background:{LINE};"
            f"border-left:6px solid {colours.get(gesture, LINE)}",
            f"{span(f'color:{PALE}', title)} <b>{render_name(text)}</b>",
        )
        for title, (gesture, text) in (("label", label), ("model", model))
    )
    return render_block(div(f"{ROW};margin:4px 0", cells))


def render_comparison(rows: Sequence[tuple[float, str, str, bool]]) -> str:
    """Return a table of labels and detections as HTML.

    Args:
        rows: time [s], label, detection, and whether they agree.
    """
    right = sum(is_right for *_, is_right in rows)
    body = "".join(
        div(
            f"{ROW};border-bottom:1px solid {LINE}",
            span(f"color:{PALE};width:52px;text-align:right", f"{seconds:.1f} s"),
            span("flex:1", render_name(label)),
            span(
                f"flex:1;color:{TEAL if is_right else RED}",
                render_name(detection),
            ),
        )
        for seconds, label, detection, is_right in rows
    )
    return render_block(div(f"color:{PALE}", f"{right} of {len(rows)} match"), body)


HOW = {
    "poke": "click",
    "double_pat": "double click",
    "stroke": "drag",
    "grab": "shift-click",
}
"""How the mouse makes each gesture."""
EFFECTS = {
    "pause": "pauses the arm",
    "hold": "stops the arm",
    "resume": "resumes a paused arm",
    "slow": "slows the arm",
    "normal": "speeds up a slow arm",
    "next_waypoint": "sends it to the next waypoint",
    "close_gripper": "closes the gripper",
    "open_gripper": "opens it",
}
"""What the page says of an action, where that is not its name."""


ASKED = {"normal": "full speed"}
"""What the page asks about an action, where that is not its name."""


def name_question(action: str) -> str:
    """Return what the arm asks about an action, such as `Next waypoint?`."""
    return f"{to_words(ASKED.get(action, action)).capitalize()}?"


def render_question(board: QuestionBoard | None, setup: SceneDescription) -> str:
    """Return what the arm asks as HTML, which is hidden: a script reads it.

    It holds the question, how to answer, and the share of the time that is left; the
    question is empty while the arm does not ask.
    """
    question = hint = ""
    left = 0.0
    if board is not None and board.action:
        question = name_question(board.action)
        hint = to_words(f"{board.answer.capitalize()} the {board.link}")
        if setup.touchable and board.answer in HOW:
            hint += f" ({HOW[board.answer]})"
        if board.is_answering:
            hint = "Let go and wait"
        left = board.left
    return (
        f'<div hidden data-question="{escape(question)}" data-hint="{escape(hint)}" '
        f'data-left="{left:.2f}"></div>'
    )


def describe_rule(rule: TouchRule) -> str:
    """Return what a rule commands, and where: `left slows the arm`."""
    done = [EFFECTS.get(action, to_words(action)) for action in rule.actions]
    *first, last = done
    said = f"{', '.join(first)} or {last}" if first else last
    return to_words(f"{rule.where} {said}" if rule.where else said)


def describe_commands(setup: SceneDescription) -> dict[str, str]:
    """Return what each gesture commands, and how the mouse makes it."""
    found = {}
    for gesture in setup.gestures:
        rules = [rule for rule in setup.commands if rule.gesture == gesture]
        how = [HOW[gesture]] if setup.touchable and gesture in HOW else []
        found[gesture] = " · ".join([*how, *map(describe_rule, rules)])
    return found


def render_bars(touches: Sequence[OpenTouch], setup: SceneDescription) -> str:
    """Return the probabilities of the strongest touch as HTML bars.

    Each gesture has its colour, and what it commands below it.
    """
    head = "no touch"
    best = -1
    probabilities = np.zeros(len(setup.gestures))
    for first in touches[:1]:
        head = f"touch {first.id} on {render_name(first.patch)}, {first.force:.1f} N"
        best = int(np.argmax(first.probabilities))
        probabilities = first.probabilities
    colours = choose_gesture_colours(setup.gestures)
    commands = describe_commands(setup)
    below = f"color:{PALE};font-size:11px;line-height:1.2;margin:0 0 2px 14px"
    rows = [div(f"color:{PALE};margin:2px 0", head)]
    for gesture in list_gestures(setup.gestures):
        number = setup.gestures.index(gesture)
        colour = colours[gesture]
        share = f"{probabilities[number]:.0%}"
        weight = f"font-weight:{600 if number == best else 400}"
        name = render_dot(colour) + render_name(gesture)
        bar = "display:block;height:9px;border-radius:5px"
        rows += [
            div(
                "display:flex;align-items:center;gap:8px;height:17px",
                span(f"width:88px;{weight};white-space:nowrap", name),
                span(
                    f"flex:1;height:9px;border-radius:5px;background:{LINE}",
                    span(f"{bar};width:{share};background:{colour}"),
                ),
                span(f"width:36px;text-align:right;color:{PALE};{NUMERALS}", share),
            )
        ]
        if commands[gesture]:
            rows += [render_brief(div(below, escape(commands[gesture])))]
    return render_block(*rows)


LOG_HEIGHT = "max(90px,calc(100vh - 620px))"
"""Height of the log, which takes what other parts of the panel leave."""


def render_log(
    log_entries: Iterable[LogEntry], colours: Mapping[str, str] | None = None
) -> str:
    """Return detections, commands and events as HTML, newest first.

    Args:
        log_entries: the entries.
        colours: colour of each gesture, which marks detections.
    """
    marks = {name: render_dot(colour) for name, colour in (colours or {}).items()}
    # Answers to the mouse are added meanwhile, in the thread of the server.
    rows = "".join(
        div(
            f"{ROW};border-bottom:1px solid {LINE};padding:1px 0",
            span(
                f"color:{PALE};width:54px;flex:none;text-align:right;"
                f"white-space:nowrap;{NUMERALS}",
                format_seconds(entry.seconds),
            ),
            span(
                f"color:{KIND_COLOURS[entry.kind]}",
                marks.get(entry.gesture, ""),
                escape(entry.text),
            ),
        )
        for entry in tuple(log_entries)
    )
    inside = rows or span(f"color:{PALE}", "nothing has happened yet")
    return render_block(
        f'<div class="eskin-log" style="height:{LOG_HEIGHT};overflow-y:auto;'
        f'margin:4px 0">{inside}</div>'
    )


def format_seconds(seconds: float) -> str:
    """Return a time as minutes and seconds, such as `26:48.9`."""
    minutes, rest = divmod(round(10 * seconds), 600)
    return f"{minutes}:{rest / 10:04.1f}"


def render_patches(setup: SceneDescription, valid: Bool[np.ndarray, "taxel"]) -> str:
    """Return how many taxels of each patch are not valid, as HTML."""
    sizes = np.bincount(setup.patch_index, minlength=len(setup.patches))
    missing = np.bincount(setup.patch_index[~valid], minlength=len(setup.patches))
    cells = ""
    for name, out, size in zip(setup.patches, missing, sizes, strict=True):
        colour = TEAL
        note = ""
        if out:
            colour, note = (RED, " silent") if out == size else (AMBER, f" {out} out")
        cells += span(
            f"border:1px solid {LINE};border-radius:9px;padding:0 7px;font-size:11px",
            f"{span(f'color:{colour}', '&#9679;')} {render_name(name)}{note}",
        )
    return render_block(div("display:flex;flex-wrap:wrap;gap:4px", cells))


def render_scale(scale: ColourScale) -> str:
    """Return a scale of pressures as HTML: a bar with its values."""
    shares = np.linspace(0.0, 1.0, 5).tolist()
    stops = ", ".join(f"rgb({r},{g},{b})" for r, g, b in scale.table[::7].tolist())
    values = [f"{scale.maximum * share * share:.3g}" for share in shares]
    values[-1] += " kPa"
    small = f"font-size:11px;color:{PALE}"
    return render_block(
        div(f"height:10px;border-radius:5px;background:linear-gradient(90deg,{stops})"),
        div(
            f"display:flex;justify-content:space-between;{small}",
            *(f"<span>{value}</span>" for value in values),
        ),
        div(
            small,
            f"{render_dot(REST_COLOUR)}at rest {render_dot(INVALID_COLOUR)}not used",
        ),
    )


MAP_HEIGHT = "clamp(100px,100vh - 500px,260px)"
"""Greatest height of an unrolled patch, which fits into a low window."""
MAP_STYLE = (
    "<style>.eskin-map text{display:none;font-size:5px;fill:currentColor}"
    ".eskin-map g:hover text{display:block}"
    ".eskin-map g:hover circle{stroke:currentColor;stroke-width:.8}</style>"
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
    kpa = pressure[taxels].astype(np.float64)
    good = valid[taxels]
    rows, columns = setup.rows[taxels], setup.columns[taxels]
    row_count = int(rows.max()) + 1
    column_count = int(columns.max()) + 1
    each = (rows, columns, scale.colours(kpa, good), kpa, good)
    cells = "".join(
        f'<g><circle cx="{10 * column + 5}" cy="{10 * row + 5}" r="4.2" '
        f'fill="rgb({red},{green},{blue})"/><text x="0" y="-2">'
        f"{format_index('row', row, row_count)}, "
        f"{format_index('column', column, column_count)}: "
        f"{f'{value:.0f} kPa' if is_good else 'not used'}</text></g>"
        for row, column, (red, green, blue), value, is_good in zip(
            *(array.tolist() for array in each), strict=True
        )
    )
    return render_block(
        MAP_STYLE,
        div(
            f"color:{PALE}",
            render_name(setup.patches[patch]),
            f", rows 0 to {rows.max()} down, columns 0 to {columns.max()} across; "
            "point at a taxel",
        ),
        f'<svg class="eskin-map" viewBox="0 -8 {10 * column_count} '
        f'{10 * row_count + 8}" '
        f'style="width:100%;max-height:{MAP_HEIGHT};overflow:visible">{cells}</svg>',
    )
