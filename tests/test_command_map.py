"""Command maps: which rule counts, and what is refused in which words."""

from pathlib import Path

import pytest

from eskin.command import load_commands, parse_commands
from eskin.command.actions import (
    ACTIONS,
    MIN_CONFIDENCE,
    required_confidence,
    resolve_action,
)
from eskin.errors import CommandError
from helpers.commands import PATCH, SKIN, VOCABULARY, Scene

HEAD = "commands:\n"
POKE = "  - {gesture: poke, action: pause}\n"


def loaded(tmp_path, text):
    path = tmp_path / "commands.yaml"
    path.write_text(text, "utf-8")
    return load_commands(path, VOCABULARY, SKIN)


def refusal(tmp_path, text):
    with pytest.raises(CommandError) as error:
        loaded(tmp_path, text)
    said = str(error.value)
    assert len(said.splitlines()) == 1
    assert said.startswith(str(tmp_path / "commands.yaml"))
    return said.removeprefix(str(tmp_path / "commands.yaml")).removeprefix(": ")


def test_the_map_that_comes_with_eskin_is_the_design_s():
    commands = load_commands(None, VOCABULARY, SKIN)
    rules = {rule.gesture: rule.action for rule in commands.commands}
    assert rules == {
        "poke": "toggle_pause",
        "double_pat": "next_waypoint",
        "grab": "toggle_gripper",
        "stroke": "toggle_speed",
    }
    assert (
        load_commands(None, ("none", "poke", "hug"), SKIN)
        .commands[0]
        .action_or_function
    )


def test_the_maps_among_the_examples_can_be_used():
    for path in (Path(__file__).parents[1] / "examples").glob("*.yaml"):
        assert load_commands(path, VOCABULARY, SKIN).commands


def test_the_most_particular_rule_counts(tmp_path):
    other = next(patch for patch in SKIN.patches if patch.link != PATCH.link)
    text = (
        f"{HEAD}  - {{gesture: poke, action: next_waypoint, link: {PATCH.link}}}\n"
        f"  - {{gesture: poke, action: slow, patch: {PATCH.id}}}\n{POKE}"
    )
    commands = loaded(tmp_path, text)
    assert commands.find_rule("poke", PATCH.link, PATCH.id).action == "slow"
    assert commands.find_rule("poke", PATCH.link, "else").action == "next_waypoint"
    assert commands.find_rule("poke", other.link, other.id).action == "pause"
    assert commands.find_rule("grab", PATCH.link, PATCH.id) is None


WRONG = [
    ("", "got None, allowed a mapping with the keys version, commands"),
    ("commands: []\n", "commands: got []"),
    ("version: 2\n" + HEAD + POKE, "version: got 2, be 1"),
    (HEAD + POKE + "extra: 1\n", "extra is not known, allowed version, commands"),
    (
        HEAD + "  - {gesture: poke, action: fly}\n",
        "commands[0].action: got 'fly', allowed pause, resume, toggle_pause",
    ),
    (
        HEAD + "  - {gesture: hug, action: pause}\n",
        "commands[0].gesture: got 'hug', allowed double_pat, grab, poke, stroke",
    ),
    (HEAD + "  - {gesture: none, action: pause}\n", "commands[0].gesture: got 'none'"),
    (
        HEAD + "  - {gesture: poke, action: pause, link: tail}\n",
        "commands[0].link: got 'tail', allowed ",
    ),
    (
        HEAD + "  - {gesture: poke, action: pause, patch: tail}\n",
        "commands[0].patch: got 'tail', allowed ",
    ),
    (
        HEAD
        + f"  - {{gesture: poke, action: pause, patch: {SKIN.patches[0].id}, "
        + f"link: {SKIN.patches[-1].link}}}\n",
        f"allowed {SKIN.patches[0].link}, which its patch is on, or none",
    ),
    (
        HEAD + "  - {gesture: poke, function: os.system}\n",
        "commands[0].function: got 'os.system', allowed ",
    ),
    (HEAD + "  - {gesture: poke}\n", "commands[0]: allowed is either action or func"),
    (HEAD + "  - {action: pause}\n", "commands[0].gesture is missing; add it"),
    (
        HEAD + "  - {gesture: poke, action: pause, sure: 1}\n",
        "commands[0].sure is not known, allowed gesture, action, function",
    ),
    (
        HEAD + "  - {gesture: poke, action: pause, confidence: 1.5}\n",
        "commands[0].confidence: got 1.5, be less than or equal to 1",
    ),
    (
        HEAD + "  - {gesture: poke, action: resume, confidence: 0.9}\n",
        "commands[0].confidence: got 0.9, allowed 0.95 to 1 for resume; raise it",
    ),
    (
        HEAD + "  - {gesture: stroke, action: jog, confidence: 0.9}\n",
        "commands[0].confidence: got 0.9, allowed 0.95 to 1 for jog; raise it",
    ),
    (
        HEAD + "  - {gesture: stroke, action: jog, step: 0.5}\n",
        "commands[0].step: got 0.5, be less than or equal to 0.1",
    ),
    (
        HEAD + "  - {gesture: stroke, action: slow, step: 0.05}\n",
        "commands[0].step: got 0.05, allowed only where the action is jog",
    ),
    (HEAD + POKE + POKE, "commands[1] is for the same touches as commands[0]"),
    (HEAD + "  - !!python/name:os.system ''\n", "not plain YAML"),
    ("commands: &a [*a]\n", "not plain YAML: aliases are not allowed"),
    ("[" * 5000, "not plain YAML"),
    ("a: \x00", "not plain YAML"),
]


@pytest.mark.parametrize(("text", "said"), WRONG)
def test_what_is_wrong_is_said_with_its_path(tmp_path, text, said):
    assert said in refusal(tmp_path, text)


def test_all_that_is_wrong_is_said_at_once(tmp_path):
    said = refusal(
        tmp_path,
        HEAD + "  - {gesture: hug, action: pause, link: tail}\n"
        "  - {gesture: poke, action: resume, confidence: 0.1}\n",
    )
    assert said.count("commands[0]") == 2 and said.count("commands[1]") == 1


def test_files_that_are_none_are_refused(tmp_path):
    path = tmp_path / "commands.yaml"
    with pytest.raises(CommandError, match="cannot be read .*; correct the path"):
        load_commands(path, VOCABULARY, SKIN)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(CommandError, match="byte 0 is no UTF-8"):
        load_commands(path, VOCABULARY, SKIN)
    path.write_bytes(b"#" * 300_000)
    with pytest.raises(CommandError, match="allowed are fewer"):
        load_commands(path, VOCABULARY, SKIN)


def test_every_plain_action_has_its_confidence_and_toggles_become_plain():
    state = Scene().arm.state()
    for action in ACTIONS:
        assert action == "none" or resolve_action(action, state) in MIN_CONFIDENCE
    assert (
        MIN_CONFIDENCE["resume"]
        > MIN_CONFIDENCE["open_gripper"]
        > MIN_CONFIDENCE["pause"]
    )
    assert required_confidence("resume", 0.1) == MIN_CONFIDENCE["resume"]
    assert required_confidence("pause", 0.1) == 0.1


def test_the_text_alone_is_not_compared_to_a_skin():
    parsed = parse_commands(HEAD + "  - {gesture: hug, action: pause}\n", "a file")
    assert parsed.commands[0].gesture == "hug"
