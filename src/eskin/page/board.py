"""This module shows the answers of two recognisers to the same counts in two poses."""

from html import escape
from typing import final

from viser import GuiApi, Icon

from eskin.page.colours import ColourScale
from eskin.page.html import AMBER, LINE, PALE, RED, TEAL, render_block, to_words
from eskin.page.messages import Answer, ComparisonBoard, SceneDescription, ViewUpdate
from eskin.page.panel import add_scale

DULL = "#b9c2cd"


@final
class ComparisonPanel:
    """Shows the comparison of two recognisers in place of the usual panel."""

    def __init__(
        self, gui: GuiApi, setup: SceneDescription, scale: ColourScale
    ) -> None:
        """Lay out the panel."""
        self.setup = setup
        self.board = gui.add_html(render_board(None, setup.gestures))
        self.legend = gui.add_html(render_block(scale.legend()))
        with gui.add_tab_group().add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, self.legend)

    def take(self, update: ViewUpdate) -> None:
        """Ignore an update: `draw` needs only the update that it draws."""

    def draw(self, update: ViewUpdate) -> None:
        """Draw the board of an update."""
        self.board.content = render_board(update.board, self.setup.gestures)


def render_board(shown: ComparisonBoard | None, gestures: tuple[str, ...]) -> str:
    """Return the board as HTML: a column for each pose, a row for each recogniser."""
    if shown is None:
        return render_block("the arm moves to its first pose")
    heads = "".join(
        render_pose(name, done, number == shown.playing)
        for number, (name, done) in enumerate(zip(shown.poses, shown.done, strict=True))
    )
    rows = "".join(
        f'<div style="color:{PALE};margin:10px 0 2px">{escape(name)}</div>'
        + render_columns("".join(render_answer(answer, gestures) for answer in answers))
        for name, answers in shown.rows
    )
    return render_block(
        f"<b>{escape(shown.title)}</b>{render_columns(heads)}{rows}"
        '<div style="height:14px"></div>'
    )


def render_columns(cells: str) -> str:
    """Return cells side by side as HTML."""
    return f'<div style="display:flex;gap:12px">{cells}</div>'


def render_pose(name: str, done: str, is_playing: bool) -> str:
    """Return the head of a column as HTML: the pose and its true label."""
    colour = AMBER if is_playing else LINE
    return (
        f'<div style="flex:1;border-bottom:3px solid {colour};padding:4px 0">'
        f"{escape(to_words(name))}<br>"
        f'<span style="color:{PALE}">true label: {escape(to_words(done))}</span></div>'
    )


def render_answer(answer: Answer, gestures: tuple[str, ...]) -> str:
    """Return an answer as HTML: its text, and the strongest touch's probabilities."""
    colour = DULL if answer.right is None else TEAL if answer.right else RED
    probabilities = answer.probabilities.tolist()
    best = max(probabilities, default=0.0)
    bars = "".join(
        render_small_bar(name, probability, colour if probability == best > 0 else DULL)
        for name, probability in zip(gestures, probabilities, strict=True)
    )
    texts = "<br>".join(map(escape, answer.texts))
    return (
        f'<div style="flex:1;min-width:0"><div style="font-weight:600;color:{colour};'
        f'min-height:36px">{texts}</div>{bars}</div>'
    )


def render_small_bar(gesture: str, probability: float, colour: str) -> str:
    """Return a probability as an HTML bar in half the width of the panel."""
    return (
        '<div style="display:flex;align-items:center;gap:5px;height:15px;'
        'font-size:11px"><span style="width:58px;white-space:nowrap">'
        f"{escape(to_words(gesture))}</span>"
        f'<span style="flex:1;height:7px;border-radius:4px;background:{LINE}">'
        '<span style="display:block;height:7px;border-radius:4px;'
        f'width:{probability:.0%};background:{colour}"></span></span>'
        f'<span style="width:28px;text-align:right;color:{PALE};'
        f'font-variant-numeric:tabular-nums">{probability:.0%}</span></div>'
    )
