"""Tests of command maps: which rule applies, and which files are refused."""

import runpy

import pytest

from eskin.command import load_commands, parse_commands
from eskin.command.actions import COMMAND_FUNCTIONS, MIN_CONFIDENCE
from eskin.errors import CommandError
from helpers.commands import DEFAULT, OTHER_PATCH, PATCH, SKIN, TOGGLE, VOCABULARY
from helpers.examples import EXAMPLES

HEAD = "commands:\n"
POKE = "  - {gesture: poke, action: pause}\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "commands.yaml"


def load(path, text):
    path.write_text(text, "utf-8")
    return load_commands(path, VOCABULARY, SKIN)


def refuse(path, text):
    """Return the message with which a map is refused: one line that names the file."""
    with pytest.raises(CommandError) as error:
        load(path, text)
    message = str(error.value)
    assert message.startswith(str(path)) and "\n" not in message
    return message.removeprefix(str(path))


def test_default_map_fits_vocabulary_of_model():
    commands = load_commands(None, VOCABULARY, SKIN)
    rules = {rule.gesture: rule.action for rule in commands.commands}
    assert rules == dict(poke="pause", double_pat="pause", grab="go_on", stroke="slow")
    (rule,) = load_commands(None, ("none", "poke", "hug"), SKIN).commands
    assert rule.action_or_function == "pause"
    (rule,) = load_commands(None, ("none", "grab", "stroke"), SKIN).commands
    assert rule.gesture == "stroke"


def test_map_of_paper_is_that_of_its_section_v_c():
    commands = load_commands("paper", VOCABULARY, SKIN, simulated=True)
    assert not commands.asks
    assert {rule.gesture: rule.actions for rule in commands.commands} == {
        "poke": ("pause", "resume"),
        "double_pat": ("next_waypoint",),
        "grab": ("close_gripper", "open_gripper"),
    }
    (rule,) = load_commands("paper", ("none", "poke"), SKIN, simulated=True).commands
    assert rule.gesture == "poke"


RESUME = "  - {gesture: grab, action: resume, confidence: 0.1}\n"
ADVANCING = "  - {gesture: double_pat, action: next_waypoint, confidence: 0.1}\n"


def test_map_that_never_asks_is_refused_for_a_real_arm(path):
    for name in ("paper", path):
        path.write_text("answer: never\n" + HEAD + POKE, "utf-8")
        with pytest.raises(CommandError, match="answer: got never") as error:
            load_commands(name, VOCABULARY, SKIN)
        assert "\n" not in str(error.value)


def test_only_map_that_never_asks_lets_things_advance_the_arm(path):
    for simulated in (False, True):
        path.write_text(HEAD + ADVANCING, "utf-8")
        with pytest.raises(CommandError, match="answer: never"):
            load_commands(path, VOCABULARY, SKIN, simulated=simulated)
    path.write_text("answer: never\n" + HEAD + ADVANCING, "utf-8")
    commands = load_commands(path, VOCABULARY, SKIN, simulated=True)
    (rule,) = commands.commands
    assert commands.require_confidence(rule, "next_waypoint") == 0.1


def test_simulation_of_before_means_that_nothing_is_asked(path, caplog):
    path.write_text("simulation: true\n" + HEAD + ADVANCING, "utf-8")
    commands = load_commands(path, VOCABULARY, SKIN, simulated=True)
    assert commands.answer == "never"
    (record,) = caplog.records
    assert "answer: never" in record.getMessage()
    with pytest.raises(CommandError, match="answer: got never"):
        load_commands(path, VOCABULARY, SKIN)


def test_what_is_asked_for_needs_no_more_than_a_stop_or_what_its_rule_says(path):
    commands = load(path, f"{HEAD}{POKE}{RESUME}")
    (pause, resume) = commands.commands
    assert commands.require_confidence(pause, "pause") == MIN_CONFIDENCE
    assert commands.require_confidence(resume, "resume") == 0.1
    (_, _, grab, _) = load_commands(None, VOCABULARY, SKIN).commands
    assert commands.require_confidence(grab, "resume") == MIN_CONFIDENCE


@pytest.mark.parametrize("action", ["toggle_gripper", "close_gripper"])
def test_rule_whose_gesture_is_the_answer_is_left_out_and_told(path, caplog, action):
    rule = f"  - {{gesture: poke, action: {action}, patch: {PATCH.id}}}\n"
    commands = load(path, HEAD + POKE + rule)
    assert [one.action for one in commands.commands] == ["pause"]
    (record,) = caplog.records
    assert "commands[1] is left out" in record.getMessage()


def test_answer_may_be_any_gesture_of_the_model(path):
    text = "answer: stroke\n" + HEAD + POKE + "  - {gesture: grab, action: go_on}\n"
    assert load(path, text).answer == "stroke"
    message = refuse(path, text.replace("stroke", "hug"))
    assert "answer: got 'hug', allowed double_pat, grab, poke, stroke" in message


def test_map_tells_what_each_gesture_commands():
    assert {rule.gesture: rule.actions for rule in DEFAULT.commands} == {
        "poke": ("pause",),
        "grab": ("resume", "normal", "next_waypoint"),
        "double_pat": ("close_gripper", "open_gripper"),
        "stroke": ("slow",),
    }


def test_gestures_of_plain_action_are_listed():
    assert DEFAULT.list_gestures("pause") == ("poke",)
    assert DEFAULT.list_gestures("resume") == ("grab",)
    assert TOGGLE.list_gestures("resume") == ("grab",)
    assert DEFAULT.list_gestures("jog") == ()


@pytest.fixture
def speeds():
    """Let the program of an example register its function, and forget it at the end."""
    runpy.run_path(str(EXAMPLES / "directions" / "speeds.py"))
    yield
    del COMMAND_FUNCTIONS["half"]


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.yaml")), ids=str)
def test_example_map_is_valid(path, speeds):
    assert load_commands(path, VOCABULARY, SKIN).commands


@pytest.mark.parametrize("name", ["os:system", "..mine:act", "mine", "mine.act"])
def test_map_names_registered_functions_only_and_imports_nothing(path, name):
    (path.parent / "mine.py").write_text("raise RuntimeError")
    message = refuse(path, f"{HEAD}  - {{gesture: stroke, function: '{name}'}}\n")
    assert f"commands[0].function: got '{name}'" in message
    assert "command_function" in message


def test_rule_of_direction_applies_before_rule_of_any(path):
    rules = (
        "  - {gesture: stroke, action: slow}\n"
        "  - {gesture: stroke, direction: left, action: jog}\n"
    )
    commands = load(path, HEAD + rules)
    place = PATCH.link, PATCH.id
    assert commands.find_rule("stroke", *place, "left").action == "jog"
    assert commands.find_rule("stroke", *place, "right").action == "slow"
    assert commands.find_rule("stroke", *place).action == "slow"


def test_most_specific_rule_applies(path):
    rules = (
        f"  - {{gesture: poke, action: hold, link: {PATCH.link}}}\n"
        f"  - {{gesture: poke, action: slow, patch: {PATCH.id}}}\n"
    )
    commands = load(path, HEAD + rules + POKE)
    assert commands.find_rule("poke", PATCH.link, PATCH.id).action == "slow"
    assert commands.find_rule("poke", PATCH.link, "else").action == "hold"
    other = commands.find_rule("poke", OTHER_PATCH.link, OTHER_PATCH.id)
    assert other.action == "pause"
    assert commands.find_rule("grab", PATCH.link, PATCH.id) is None


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("None", "version, answer, commands")),
        ("commands: []\n", ("commands: got []",)),
        ("version: 2\n" + HEAD + POKE, ("version: got 2",)),
        (HEAD + POKE + "extra: 1\n", ("extra", "version, answer, commands")),
        (HEAD + POKE + POKE, ("commands[1]", "commands[0]")),
        (HEAD + "  - !!python/name:os.system ''\n", ("YAML",)),
        ("commands: &a [*a]\n", ("YAML", "aliases")),
        ("[" * 5000, ("YAML",)),
        ("a: \x00", ("YAML",)),
    ],
)
def test_invalid_file_is_refused(path, text, parts):
    message = refuse(path, text)
    assert all(part in message for part in parts)


@pytest.mark.parametrize(
    ("rule", "field", "parts"),
    [
        ("gesture: poke, action: fly", "action", ("'fly'", "toggle_pause")),
        ("gesture: hug, action: pause", "gesture", ("'hug'", "grab, poke, stroke")),
        ("gesture: none, action: pause", "gesture", ("'none'",)),
        ("gesture: poke, action: pause, link: tail", "link", ("'tail'", PATCH.link)),
        ("gesture: poke, action: pause, patch: tail", "patch", ("'tail'", PATCH.id)),
        (
            f"gesture: poke, action: pause, patch: {PATCH.id}, link: "
            f"{OTHER_PATCH.link}",
            "link",
            (OTHER_PATCH.link, PATCH.link),
        ),
        ("gesture: poke, function: os.system", "function", ("'os.system'",)),
        ("gesture: stroke, action: slow, direction: up", "direction", ("'up'", "left")),
        ("gesture: poke", "", ("action", "function")),
        ("action: pause", "gesture", ("missing",)),
        ("gesture: poke, action: pause, sure: 1", "sure", ("confidence",)),
        ("gesture: poke, action: pause, confidence: 1.5", "confidence", ("1.5",)),
        *(
            (
                f"gesture: {gesture}, action: {action}",
                "action",
                (gesture, "gesture: grab"),
            )
            for gesture in ("poke", "double_pat")
            for action in ("go_on", "resume", "toggle_pause", "toggle_speed", "jog")
        ),
        ("gesture: stroke, action: jog, step: 0.5", "step", ("0.5", "0.1")),
        ("gesture: stroke, action: slow, step: 0.05", "step", ("0.05", "jog")),
    ],
)
def test_invalid_rule_is_refused_with_its_field(path, rule, field, parts):
    message = refuse(path, f"{HEAD}  - {{{rule}}}\n")
    assert f"commands[0].{field}".rstrip(".") in message
    assert all(part in message for part in parts)


def test_all_problems_are_listed(path):
    message = refuse(
        path,
        HEAD + "  - {gesture: hug, action: pause, link: tail}\n"
        "  - {gesture: poke, action: resume}\n",
    )
    assert message.count("commands[0]") == 2 and message.count("commands[1]") == 1


def test_unreadable_file_is_refused(path):
    for data, part in ((None, "read"), (b"\xff\xfe", "byte 0"), (b"#" * 300_000, "2")):
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(CommandError, match=part):
            load_commands(path, VOCABULARY, SKIN)


def test_parsing_alone_compares_no_skin():
    parsed = parse_commands(HEAD + "  - {gesture: hug, action: pause}\n", "a file")
    assert parsed.commands[0].gesture == "hug"
