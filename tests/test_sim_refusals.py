"""What the simulator cannot do is refused, each in one line that says why.

Folders of generated recordings, which stay as they were, are tested with generation.
"""

import numpy as np
import pytest

from eskin.errors import GenerationError, ImportSourceError
from eskin.sim.dataset import GenerationSettings, make_pair, read_index
from eskin.sim.interactive import InteractiveSkin, LinkPoint, TouchPlayer
from eskin.sim.people.recorded import (
    RecordedPeople,
    find_recorded_people,
    read_recorded_touches,
)
from eskin.sim.scene import load_environment
from eskin.sim.sensor import draw_flawed_build, sense
from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.faults import add_electrical_event
from helpers.refusals import REFUSALS, check_refusal, refusal
from helpers.sensors import CONSTANTS, SKIN
from helpers.simulation import StandIn, draw_people, perform_many
from helpers.socialtouch import write_socialtouch

TAXELS = np.array([7, 8, 13, 27, 50])
PRESSURE = np.ones((120, 5))


def constant(method, argument, part):
    """Return the row of a method of the constants with a wrong name or kind."""
    rng = [np.random.default_rng(0)] * (method in ("draw", "choose"))
    return refusal(
        f"{method} of {argument}",
        ValueError,
        lambda folder: getattr(CONSTANTS, method)(argument, *rng),
        part,
    )


def settings(*parts, **facts):
    """Return the row of settings of a generation."""
    name = f"settings {', '.join(map(str, facts.values()))}"
    return refusal(name, ValueError, lambda folder: GenerationSettings(**facts), *parts)


def people(*parts, **facts):
    """Return the row of settings of a generation with recorded people."""

    def call(folder):
        GenerationSettings(recorded=RecordedPeople(folder, (0,), ""), **facts)

    name = f"people in {', '.join(map(str, facts.values()))}"
    return refusal(name, ValueError, call, *parts)


def index(name, text, *parts):
    """Return the row of an index of a set of clips."""

    def call(folder):
        (folder / "clips.jsonl").write_text(text + "\n")
        read_index(folder)

    return refusal(name, GenerationError, call, *parts)


def performance(gesture, kind, difficulty, part):
    """Return the row of a gesture that nobody can perform."""
    return refusal(
        f"{gesture} by {kind} at {difficulty}",
        ValueError,
        lambda folder: perform_many(gesture, kind, difficulty),
        part,
    )


def live(name, act, part):
    """Return the row of what an interactive skin, or its hand, cannot do."""

    def call(folder):
        skin = InteractiveSkin()
        taxel = skin.mounted.skin.find_taxels("forearm_back")[40]
        place = skin.mounted.skin.positions[taxel].astype(float)
        act(skin, LinkPoint("forearm_link", place))

    return refusal(name, ValueError, call, part)


def pair(kind, part):
    """Return the row of a kind of pair that a bent sheet cannot make."""
    return refusal(
        f"pair of {kind}",
        ValueError,
        lambda folder: make_pair(kind, 0, env=load_environment("bent")),
        part,
    )


def recorded(name, numbers, part, error=GenerationError):
    """Return the row of people who are looked for where one has poked."""

    def call(folder):
        write_socialtouch(folder)
        find_recorded_people(folder, numbers)

    return refusal(name, error, call, part)


def sensed(part, pressure=PRESSURE, taxels=TAXELS, lead=0):
    """Return the row of pressures that a sensor cannot be given."""

    def call(folder):
        rng = np.random.default_rng(3)
        build = draw_build("b", "shifted", SKIN, CONSTANTS, rng)
        sense(pressure, taxels, build, SKIN, rng, lead=lead)

    return refusal(f"pressure that is {part}", ValueError, call, part)


def read_no_participant(folder):
    """Read recorded touches from a file that is no archive."""
    (folder / "P01.npz").write_bytes(b"nothing")
    read_recorded_touches(folder)


def add_spark(folder):
    """Add an electrical event that there is not."""
    counts = np.full((100, SKIN.count), 200, np.int32)
    rng = np.random.default_rng(1)
    build = draw_build("b", "fresh", SKIN, CONSTANTS, rng)
    received = np.ones(counts.shape, bool)
    electronics = build.electronics
    add_electrical_event("spark", counts, received, SKIN, electronics, rng, CONSTANTS)


def draw_rust(folder):
    """Draw a build with a flaw that there is not."""
    rng = np.random.default_rng(1)
    draw_flawed_build("b", "divider", {"rust": "high"}, SKIN, CONSTANTS, rng)


ROWS = [
    constant("value", "poke.colour", "no constant 'poke.colour'"),
    constant("value", "poke.force", "'poke.force' is not one number"),
    constant("array", "time.step", "'time.step' is not a list of numbers"),
    constant("draw", "time.step", "'time.step' is not drawn"),
    constant("choose", "time.step", "'time.step' has no weights"),
    constant("scaled", {"poke.colour": 2.0}, "no constant 'poke.colour'"),
    refusal(
        "level of a constant",
        ValueError,
        lambda folder: CONSTANTS.at_level("poke.force", "high"),
        "'poke.force' is not a range",
    ),
    settings("requested on a skin", "leave --", set_name="devices", skin="post"),
    settings(
        "families requested of", "leave --", set_name="devices", families=("divider",)
    ),
    settings("requested on a skin", "leave --", set_name="devices", robot="ur5"),
    settings(
        "families are none; allowed are one or more of divider",
        set_name="train",
        families=(),
    ),
    settings(
        "families are linear, linear; allowed",
        set_name="train",
        families=("linear", "linear"),
    ),
    settings(
        "families requested of set 'pairs'", set_name="pairs", families=("linear",)
    ),
    settings(
        "'base', whose robot has no known joints",
        set_name="pairs",
        skin="base",
        clips=2,
    ),
    settings("0 clips ", " 2, 4", set_name="pairs", clips=0),
    settings("3 clips ", " 2, 4", set_name="pairs", clips=3),
    settings("without recorded touches", set_name="recorded"),
    people("set 'train'", " sets recorded", set_name="train"),
    people("--people", set_name="recorded", subjects=2),
    refusal("missing index", GenerationError, read_index, "clips.jsonl"),
    index("index that is cut", "{", "line 1"),
    index("index of lists", "[]", "line 1"),
    index("index without clips", '{"file": "a"}', "line 1"),
    performance("wave", None, 0.0, "no gesture 'wave'; choose from poke, "),
    performance("poke", "elbow", 0.0, "'elbow' of poke"),
    performance("rub", "elbow", 0.0, "'elbow' of rub"),
    performance("poke", None, -1.0, "difficulty is -1.0"),
    live(
        "poke beside the skin",
        lambda skin, _: skin.hand.poke(LinkPoint("tool0", np.zeros(3))),
        "no skin on link 'tool0'; allowed are forearm_link, ",
    ),
    live("force below 0", lambda skin, at: skin.hand.poke(at, -1.0), "force is -1.0"),
    live(
        "electrical touch",
        lambda skin, _: skin.hand.perform("electrical"),
        "no gesture or contact 'electrical'; allowed are poke, ",
    ),
    live(
        "contact with itself",
        lambda skin, _: skin.hand.perform("self_contact"),
        "fold the arm",
    ),
    live("end of no touch", lambda skin, _: skin.hand.end(9), "touch 9 has not begun"),
    live(
        "move of a poke",
        lambda skin, at: skin.hand.move(skin.hand.poke(at), at),
        "0 is not dragged",
    ),
    live("joints", lambda skin, _: skin.scan(1, np.zeros(5)), "6 finite numbers"),
    live("unknown patch", lambda skin, _: skin.unplug("x"), "no patch 'x'"),
    live("share above 1", lambda skin, _: skin.kill(2.0), "share is 2"),
    refusal(
        "unknown skin", ValueError, lambda folder: InteractiveSkin("x"), "no skin 'x'"
    ),
    refusal(
        "seed below 0",
        ValueError,
        lambda folder: TouchPlayer(StandIn("small"), -1),
        "seed is -1",
    ),
    pair("stretching", "bending, merging"),
    pair("merging", "elbow_joint"),
    refusal(
        "unknown pads",
        ValueError,
        lambda folder: draw_people(1)[0].select_pads("tail"),
        "no parts 'tail' of a hand; choose from ['one_tip'",
    ),
    recorded("missing participant", [7], "participant 7; allowed are 0"),
    recorded("no participants", [], "any"),
    recorded("participant without some classes", [0], "no double_pat, none, stroke of"),
    refusal(
        "no folder of people",
        ImportSourceError,
        lambda folder: find_recorded_people(folder / "gone"),
        "no file or folder",
    ),
    refusal(
        "empty folder of people",
        GenerationError,
        find_recorded_people,
        "folders of the SocialTouch set",
    ),
    refusal(
        "no archive of a participant",
        ImportSourceError,
        read_no_participant,
        "no participant",
    ),
    sensed("twice", taxels=np.array([1, 2, 3, 4, 4])),
    sensed("lead is 500", lead=500),
    sensed("not finite", pressure=np.full((10, 5), np.nan)),
    refusal("spark", ValueError, add_spark, "'spark'", "allowed are line_step"),
    refusal("rust", ValueError, draw_rust, "flaw is 'rust'; allowed are noise, noisy"),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_what_cannot_be_simulated_is_refused_in_one_line(error, call, parts, tmp_path):
    check_refusal(error, call, parts, tmp_path)
