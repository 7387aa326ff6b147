"""This module writes a report of the forces and pressures of touches, as one HTML page.

The page needs no other file: its pictures are SVG, and it runs no script.
"""

from html import escape
from pathlib import Path
from time import gmtime, strftime

import numpy as np

from eskin.exports.limits import Region
from eskin.exports.loads import RecordingLoads, TouchLoad
from eskin.files import atomic_path
from eskin.units import NS_PER_S

NO_SAFETY = (
    "This report is no safety function and no proof of conformity. It shows what the "
    "skin has measured in one recording; biomechanical limits are verified with "
    "measuring devices made for that."
)
UNITS = {
    "peak_force": ("peak force", "N"),
    "peak_pressure": ("peak pressure", "kPa"),
    "held_force": ("held force", "N"),
    "held_pressure": ("held pressure", "kPa"),
}
"""Words and units of the values of a load."""
WIDTH = 760
HEIGHT = 150
LEFT = 48
BOTTOM = 22
"""Size of a diagram, and of the space for its axes [pixels]."""
CELL = 7
GAP = 24
ROW_WIDTH = 740
"""Size of a taxel, space between patches, and width of the map [pixels]."""
STYLE = """body{font:14px/1.5 system-ui,sans-serif;color:#1f2733;max-width:820px;
margin:2em auto;padding:0 1em}table{border-collapse:collapse;font-variant-numeric:
tabular-nums;margin:.5em 0}td,th{padding:2px 10px 2px 0;text-align:right;border-bottom:
1px solid #e6e9ee}td:first-child,th:first-child{text-align:left}.above{color:#c43a31;
font-weight:600}.note{background:#fdf3e1;padding:.6em 1em;border-radius:6px}text{font:
11px system-ui,sans-serif;fill:#7b8594}"""


def write_report(found: RecordingLoads, path: Path) -> None:
    """Write the report of a recording."""
    with atomic_path(path) as part:
        part.write_text(format_report(found), encoding="utf-8")


def format_report(found: RecordingLoads) -> str:
    """Return the report as HTML."""
    recording = found.recording
    limits = found.limits
    title = f"Contacts in {recording.path.name}"
    when = strftime("%Y-%m-%d %H:%M UTC", gmtime((recording.start or 0) / NS_PER_S))
    about = (
        f"{when}, {found.seconds:.1f} s; skin {recording.skin.name} on "
        f"{recording.robot_name}; {recording.metadata.subject}, "
        f"{recording.metadata.session}. Held: for {limits.quasi_static_after:g} s "
        f"without a break. Limits: {limits.source}."
    )
    regions = {load.region.name: load.region for load in found.loads}
    regions |= {region.name: region for region in limits.regions}
    parts = [
        f"<h1>{escape(title)}</h1><p>{escape(about)}</p>",
        f'<p class="note"><b>{NO_SAFETY}</b></p>',
        "<ul>",
        *(f"<li>{escape(doubt)}</li>" for doubt in found.list_doubts()),
        "</ul><h2>Regions</h2>",
        format_regions(found, list(regions.values())),
        "<h2>Over time</h2>",
        *(format_diagrams(found, region) for region in regions.values()),
        "<h2>Greatest pressure of each taxel</h2>",
        draw_map(found),
        "<h2>Touches</h2>",
        format_touches(found.loads),
        f'<p class="note">{NO_SAFETY}</p>',
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"
        f"{''.join(parts)}</body></html>\n"
    )


def format_table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table of cells that are HTML."""
    lines = [f"<tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr>"]
    lines += [f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table>{''.join(lines)}</table>"


def format_value(value: float, limit: float | None, mark: str = "") -> str:
    """Return a value beside its limit, marked where it is above."""
    text = f"{mark}{value:.3g}" + ("" if limit is None else f" / {limit:g}")
    is_above = limit is not None and value > limit
    return f'<span class="above">{text} above</span>' if is_above else text


def format_regions(found: RecordingLoads, regions: list[Region]) -> str:
    """Return the table of the greatest values of each region, beside its limits."""
    head = ["region", "touches", *(f"{word} [{unit}]" for word, unit in UNITS.values())]
    rows = []
    for region in regions:
        loads = [load for load in found.loads if load.region.name == region.name]
        cells = [escape(region.name), str(len(loads))]
        for name in UNITS:
            values = [load.values[name] for load in loads]
            cells.append(format_value(*max(values)) if values else "-")
        rows.append(cells)
    return format_table(head, rows)


def format_touches(loads: tuple[TouchLoad, ...]) -> str:
    """Return the table of all touches."""
    head = ["region", "patch", "at [s]", "for [s]", "gesture"]
    head += [f"{word} [{unit}]" for word, unit in UNITS.values()]
    rows = []
    for load in loads:
        touch = load.touch
        mark = "≥ " if load.is_clipped else ""
        rows.append(
            [
                escape(load.region.name),
                escape(touch.contact.patch),
                f"{load.seconds[0]:.2f}",
                f"{(touch.last - touch.onset) / NS_PER_S:.2f}",
                escape(load.gesture),
                *(format_value(*pair, mark) for pair in load.values.values()),
            ]
        )
    return format_table(head, rows) if rows else "<p>No touch was found.</p>"


def format_diagrams(found: RecordingLoads, region: Region) -> str:
    """Return force and pressure of a region over time."""
    loads = [load for load in found.loads if load.region.name == region.name]
    if not loads:
        return ""
    fast = region.transient
    slow = region.quasi_static
    force = draw_series(
        [(load.seconds, load.force) for load in loads],
        found.seconds,
        "N",
        {"transient": fast.force, "quasi-static": slow.force},
    )
    pressure = draw_series(
        [(load.seconds, load.pressure) for load in loads],
        found.seconds,
        "kPa",
        {"transient": fast.pressure, "quasi-static": slow.pressure},
    )
    return f"<h3>{escape(region.name)}</h3>{force}{pressure}"


def draw_series(
    series: list[tuple[np.ndarray, np.ndarray]],
    seconds: float,
    unit: str,
    limits: dict[str, float | None],
) -> str:
    """Draw values over time, with limits as dashed lines."""
    lines = {name: value for name, value in limits.items() if value is not None}
    top = max(float(values.max()) for _, values in series)
    top = 1.1 * max(top, *lines.values(), 1e-9)
    across = (WIDTH - LEFT) / max(seconds, 1e-9)
    up = (HEIGHT - BOTTOM) / top
    parts = [
        f'<svg width="{WIDTH}" height="{HEIGHT}" role="img">',
        f'<path d="M{LEFT} 0V{HEIGHT - BOTTOM}H{WIDTH}" fill="none" stroke="#7b8594"/>',
        f'<text x="0" y="12">{top / 1.1:.3g} {unit}</text>',
        f'<text x="{LEFT}" y="{HEIGHT - 6}">0 s</text>',
        f'<text x="{WIDTH - 50}" y="{HEIGHT - 6}">{seconds:.0f} s</text>',
    ]
    for times, values in series:
        x = LEFT + across * times
        y = HEIGHT - BOTTOM - up * values
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="#3b6fb6" '
            'stroke-width="1.5"/>'
        )
    for name, value in lines.items():
        y = HEIGHT - BOTTOM - up * value
        parts.append(
            f'<path d="M{LEFT} {y:.1f}H{WIDTH}" stroke="#c43a31" '
            'stroke-dasharray="5 4"/>'
            f'<text x="{LEFT + 6}" y="{y - 3:.1f}">{name} {value:g} {unit}</text>'
        )
    return "".join([*parts, "</svg>"])


def draw_map(found: RecordingLoads) -> str:
    """Draw the greatest pressure of each taxel, patch by patch, by row and column."""
    skin = found.recording.skin
    top = max(float(found.peaks.max(initial=0.0)), 1e-9)
    parts = []
    x = 0
    y = GAP
    tallest = 0
    for number, patch in enumerate(skin.patches):
        taxels = np.flatnonzero(skin.patch_index == number)
        rows, columns = skin.rows[taxels], skin.columns[taxels]
        width = max(CELL * (int(columns.max(initial=0)) + 1), 7 * len(patch.id))
        height = CELL * (int(rows.max(initial=0)) + 1)
        if x and x + width > ROW_WIDTH:
            x = 0
            y = y + tallest + GAP
            tallest = 0
        parts.append(f'<text x="{x}" y="{y - 4}">{escape(patch.id)}</text>')
        for taxel, row, column in zip(taxels, rows, columns, strict=True):
            share = float(found.peaks[taxel]) / top
            parts.append(
                f'<rect x="{x + CELL * column}" y="{y + CELL * row}" '
                f'width="{CELL - 1}" height="{CELL - 1}" fill="{mix_colour(share)}"/>'
            )
        x = x + width + GAP
        tallest = max(tallest, height)
    size = f'width="{ROW_WIDTH + 20}" height="{y + tallest + 4}"'
    key = f"<p>Pale: untouched. Darkest: {top:.3g} kPa.</p>"
    return f'{key}<svg {size} role="img">{"".join(parts)}</svg>'


def mix_colour(share: float) -> str:
    """Return the colour of a share of the greatest pressure, from pale to dark red."""
    pale = np.array([230, 233, 238])
    dark = np.array([150, 20, 20])
    red, green, blue = np.rint(pale + share**0.5 * (dark - pale)).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"
