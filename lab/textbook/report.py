"""Report sweeps as tables, verdicts, JSON and a picture."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eskin.learn.plots import save_figure
from lab.tables import format_head, format_row
from lab.textbook.draws import TOUCHES, name_true_class
from lab.textbook.sweeps import FACTORS, SURFACE, WANTED, Factor, Point

LABELS = {
    "force": "force [N]",
    "area": "area of a fingertip [cm2]",
    "duration": "duration of a poke [s]",
    "press": "duration of a press [s]",
    "ramp": "ramp of force [ms]",
    "gap": "onset to onset of two pats [s]",
    "speed": "speed of a stroke [cm/s]",
    "pitch": "pitch of the taxels [mm]",
    "rate": "rate of scans [Hz]",
    SURFACE: "surface",
}
"""Labels of tables and axes."""
LOOKS = {
    "poke": ("tab:red", "o", "-"),
    "double_pat": ("tab:blue", "s", "-"),
    "stroke": ("tab:green", "^", "-"),
    "grab": ("tab:purple", "D", "-"),
    "resting hand": ("tab:brown", "v", "--"),
    "one pat": ("tab:cyan", "P", "--"),
    "press": ("tab:gray", "X", "--"),
}
"""Colour, marker and line of each touch; dashed where the true class is `none`."""
BESIDE = 0.1
"""Offset between the markers of one surface."""


def summary(points: Sequence[Point]) -> str:
    """Format the number of targets that are met in all sweeps."""
    factors = dict.fromkeys(one.factor for one in points)
    met = [ok for factor in factors for ok in verdicts(points, factor).values()]
    return f"{sum(met)} of {len(met)} met: at least {WANTED:.0%} of the middle half"


def table(points: Sequence[Point], factor: str) -> str:
    """Format the accuracies of forced choice at each value and of the middle half.

    Values of the middle half are in bold; all surfaces belong to it. `live` is the
    share of the middle half with the true gesture as first detection, or rightly
    without one.
    """
    values = list_values(points, factor)
    heads = [
        LABELS[factor],
        *(format_value(value, inside) for value, inside in values),
        *("middle half", "live", "verdict", "most frequent error"),
    ]
    lines = [
        format_line(
            select_points(points, factor, touch), [value for value, _ in values]
        )
        for touch in list_touches(points, factor)
    ]
    return "\n".join([format_head(heads), *lines])


def format_line(row: Sequence[Point], values: Sequence[float | str]) -> str:
    """Format the row of one touch, with empty cells for values without clips."""
    texts = {one.value: f"{100 * share([one]):.0f}" for one in row}
    middle = [one for one in row if one.inside]
    others = count_errors(middle)
    return format_row(
        [
            row[0].touch,
            *(texts.get(value, "") for value in values),
            f"{share(middle):.1%}",
            f"{share(middle, live=True):.1%}",
            "met" if share(middle) >= WANTED else "not met",
            max(others, key=lambda name: others[name], default=""),
        ]
    )


def list_touches(points: Sequence[Point], factor: str) -> list[str]:
    """Return the touches that are swept over a factor, in the order of `TOUCHES`."""
    swept = {one.touch for one in points if one.factor == factor}
    return [name for name in TOUCHES if name in swept]


def select_points(points: Sequence[Point], factor: str, touch: str) -> list[Point]:
    """Return the points of one row of a table."""
    return [one for one in points if (one.factor, one.touch) == (factor, touch)]


def list_values(points: Sequence[Point], factor: str) -> list[tuple[float | str, bool]]:
    """Return the values of a factor, and whether each lies in the middle half."""
    every = [(one.value, one.inside) for one in points if one.factor == factor]
    return list(dict.fromkeys(every))


def verdicts(points: Sequence[Point], factor: str) -> dict[str, bool]:
    """Return whether the accuracy in the middle half is sufficient, by touch."""
    return {
        touch: share([p for p in select_points(points, factor, touch) if p.inside])
        >= WANTED
        for touch in list_touches(points, factor)
    }


def share(points: Sequence[Point], live: bool = False) -> float:
    """Return the accuracy on all clips of some points."""
    right = sum(one.right_said if live else one.right for one in points)
    return right / max(sum(one.count for one in points), 1)


def count_errors(points: Sequence[Point]) -> dict[str, int]:
    """Count the wrong answers by class."""
    total: dict[str, int] = {}
    for one in points:
        for name, count in one.forced.items():
            if name != name_true_class(one.touch):
                total[name] = total.get(name, 0) + count
    return total


def format_value(value: float | str, inside: bool) -> str:
    """Format a value as a head of a column."""
    text = value if isinstance(value, str) else f"{value:.3g}"
    return f"**{text}**" if inside else text


def to_json(points: Sequence[Point]) -> str:
    """Format all answers and verdicts as JSON."""
    factors = dict.fromkeys(one.factor for one in points)
    met = {factor: verdicts(points, factor) for factor in factors}
    content = {"points": [asdict(one) for one in points], "met": met}
    return json.dumps(content, indent=1)


def draw(points: Sequence[Point], title: str, path: Path) -> None:
    """Draw a panel for each factor, with a line for each touch."""
    swept = dict.fromkeys(one.factor for one in points)
    columns = min(len(swept), 5)
    rows = -(-len(swept) // columns)
    figure = Figure(
        figsize=(3.6 * columns, 3.2 * rows + 0.8), dpi=110, layout="constrained"
    )
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    known = {factor.name: factor for factor in FACTORS}
    for name, axes in zip(swept, panels, strict=False):
        draw_panel(axes, points, name, known.get(name))
    for axes in panels[len(swept) :]:
        axes.axis("off")
    lines = {}
    for axes in panels:
        handles, names = axes.get_legend_handles_labels()
        lines = dict(zip(names, handles, strict=True)) | lines
    ordered = [name for name in TOUCHES if name in lines]
    figure.legend(
        [lines[name] for name in ordered],
        [f"{n} (none)" if name_true_class(n) != n else n for n in ordered],
        loc="outside lower center",
        ncols=len(ordered),
        frameon=False,
    )
    figure.suptitle(title)
    save_figure(figure, path)


def draw_panel(
    axes: Axes, points: Sequence[Point], name: str, factor: Factor | None
) -> None:
    """Draw the sweep of one factor, its middle half shaded; None is the surface."""
    values = [value for value, _ in list_values(points, name)]
    for touch in list_touches(points, name):
        row = select_points(points, name, touch)
        colour, marker, line = LOOKS[touch]
        place = list(TOUCHES).index(touch) - len(TOUCHES) // 2
        axes.plot(
            [one.value for one in row]
            if factor
            else [values.index(one.value) + BESIDE * place for one in row],
            [100 * share([one]) for one in row],
            color=colour,
            marker=marker,
            ls=line if factor else "none",
            ms=5,
            label=touch,
        )
    if factor is None:
        axes.set_xticks(range(len(values)), [str(value) for value in values])
    else:
        shown = [float(value) for value in values[:: max(1, (len(values) - 1) // 4)]]
        axes.set_xscale("log")
        axes.set_xticks(shown, [f"{value:.3g}" for value in shown])
        axes.minorticks_off()
        axes.axvspan(*factor.middle, color="0.92", zorder=0)
    axes.axhline(100 * WANTED, color="black", lw=0.8, ls=":")
    axes.set(ylim=(-5, 105), xlabel=LABELS[name], ylabel="accuracy [%]")
