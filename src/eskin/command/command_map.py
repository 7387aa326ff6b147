"""This module reads and checks command maps, which map touches to actions."""

import logging
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from eskin.command.actions import (
    ADVANCING_ACTIONS,
    COMMAND_FUNCTIONS,
    FUNCTION,
    HALTING_ACTIONS,
    MIN_CONFIDENCE,
    OWN_CONFIDENCE,
    THING_GESTURES,
    TOGGLES,
    Action,
    needs_answer,
)
from eskin.errors import CommandError
from eskin.files import (
    Name,
    describe_entry_error,
    load_plain_yaml,
    read_file,
    shorten,
)
from eskin.recording.records import NONE, UNKNOWN
from eskin.skin import Patch, Skin

MAX_BYTES = 1 << 18
"""Largest size of a command map [bytes]."""
DEFAULT_MAP = "commands.yaml"
"""File of the default map, which comes with eskin."""
NAMED_MAPS = {"paper": "paper.yaml"}
"""Files of other maps that come with eskin, by their names."""
NON_GESTURES = (NONE, UNKNOWN)
"""Classes of detections that are no gestures and command nothing."""
NEVER_ASKS = "never"
"""Answer of maps by which nothing is asked, for simulated arms alone."""
SIMULATION = "simulation"
"""Key that said what `answer: never` says now."""
logger = logging.getLogger(__name__)


class Rule(BaseModel):
    """A rule maps a gesture, perhaps on one link or patch, to an action or function."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    gesture: Name
    action: Action | None = None
    function: Name | None = None
    link: Name | None = None
    patch: Name | None = None
    direction: Literal["toward_tool", "toward_base", "left", "right"] | None = None
    confidence: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None
    cool_down: Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)] | None = None
    step: Annotated[float, Field(ge=0.005, le=0.1, allow_inf_nan=False)] | None = None

    @property
    def action_or_function(self) -> str:
        """The action, or `function` where the rule names one."""
        return FUNCTION if self.action is None else self.action

    @property
    def actions(self) -> tuple[str, ...]:
        """The plain actions, or the function, of which the arm's state chooses one."""
        action = self.function or self.action or ""
        return TOGGLES.get(action, (action,))

    @property
    def where(self) -> str:
        """Direction, link and patch of the touch; empty where it may be any."""
        places = (self.direction, self.link, self.patch)
        return " ".join(place for place in places if place)

    @property
    def needs_answer(self) -> bool:
        """Whether the arm asks before it does what the rule says, in some state."""
        if self.function is not None:
            return needs_answer(FUNCTION, self.function)
        return any(needs_answer(one) for one in self.actions)

    @property
    def key(self) -> tuple[str | None, ...]:
        """Gesture, link, patch and direction, which identify the rule."""
        return self.gesture, self.link, self.patch, self.direction


class CommandMap(BaseModel):
    """A command map holds all rules; the most particular one that fits counts.

    Attributes:
        version: version of the format.
        answer: gesture that answers when the arm asks whether it is to do more; `never`
            for simulated arms alone, which nobody stands beside: they do not ask, so
            that things and faults of the skin start them too.
        commands: the rules.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    version: Literal[1] = 1
    answer: Name = "poke"
    commands: Annotated[list[Rule], Field(min_length=1, max_length=1000)]

    def find_rule(
        self, gesture: str, link: str, patch: str, direction: str = ""
    ) -> Rule | None:
        """Return the rule for a touch: of its patch, else its link, else of neither.

        Of rules for one place, the one of the touch's direction counts first.
        """
        fitting = [
            rule
            for rule in self.commands
            if rule.gesture == gesture
            and rule.link in (None, link)
            and rule.patch in (None, patch)
            and rule.direction in (None, direction)
        ]
        order = [
            tuple(part is not None for part in (rule.patch, rule.link, rule.direction))
            for rule in fitting
        ]
        return fitting[order.index(max(order))] if order else None

    def list_gestures(self, action: str) -> tuple[str, ...]:
        """Return the gestures that give a plain action somewhere, in some state."""
        found = {
            rule.gesture: None
            for rule in self.commands
            if rule.action is not None and action in rule.actions
        }
        return tuple(found)

    def find_stops(self, vocabulary: tuple[str, ...], patch: Patch) -> dict[int, float]:
        """Return the gestures that stop an arm at work on a patch.

        Args:
            vocabulary: classes in the order of the probabilities.
            patch: patch that is touched.

        Returns:
            the confidence that each needs, by its index in the vocabulary.
        """
        found = {}
        for index, gesture in enumerate(vocabulary):
            rule = self.find_rule(gesture, patch.link, patch.id)
            if rule is None or gesture in NON_GESTURES:
                continue
            action = rule.action_or_function
            action = TOGGLES.get(action, (action,))[0]
            if action in HALTING_ACTIONS:
                found[index] = self.require_confidence(rule, action)
        return found

    @property
    def asks(self) -> bool:
        """Whether the arm asks before it does more."""
        return self.answer != NEVER_ASKS

    def needs_answer(self, rule: Rule, action: str) -> bool:
        """Return whether the arm asks before a plain action of a rule."""
        return self.asks and needs_answer(action, rule.function)

    def require_confidence(self, rule: Rule, action: str) -> float:
        """Return the confidence that a plain action of a rule needs.

        A rule may have one of its own.
        """
        if rule.confidence is not None:
            return rule.confidence
        if self.needs_answer(rule, action):
            return MIN_CONFIDENCE
        return OWN_CONFIDENCE.get(action, MIN_CONFIDENCE)

    def select_rules(self, vocabulary: tuple[str, ...]) -> "CommandMap":
        """Return the map with the rules that a model can give, and answer.

        Args:
            vocabulary: gestures that the model knows.
        """
        answers = self.answer in vocabulary or not self.asks
        fitting = [
            rule
            for rule in self.commands
            if rule.gesture in vocabulary and (answers or not rule.needs_answer)
        ]
        return self.model_copy(update={"commands": fitting})

    def leave_out_answers(self, where: str) -> "CommandMap":
        """Return the map without rules that its answer cannot ask for.

        A warning tells of each.

        Args:
            where: name of the file, for the warning.
        """
        kept = []
        for index, rule in enumerate(self.commands):
            asks = self.asks and rule.needs_answer
            if asks and rule.gesture == self.answer:
                logger.warning(
                    "%s: commands[%d] is left out: got %s for %s, which is the answer "
                    "when the arm asks; allowed is another gesture, or a function that "
                    "moves nothing",
                    where,
                    index,
                    rule.function or rule.action,
                    rule.gesture,
                )
                continue
            kept.append(rule)
        return self.model_copy(update={"commands": kept})

    def find_problems(self, vocabulary: tuple[str, ...], skin: Skin) -> list[str]:
        """Return what does not fit model, skin or other rules, each with its path."""
        known = {
            "gesture": tuple(word for word in vocabulary if word not in NON_GESTURES),
            "link": tuple(sorted({patch.link for patch in skin.patches})),
            "patch": tuple(patch.id for patch in skin.patches),
            "function": tuple(COMMAND_FUNCTIONS),
        }
        found = []
        links = {patch.id: patch.link for patch in skin.patches}
        for index, rule in enumerate(self.commands):
            where = f"commands[{index}]"
            for key, allowed in known.items():
                value = getattr(rule, key)
                if value is not None and value not in allowed:
                    names = ", ".join(allowed) or "none"
                    remedy = ""
                    if key == "function":
                        remedy = "; register it with eskin.command.command_function"
                    found.append(
                        f"{where}.{key}: got {shorten(value)}, allowed {names}{remedy}"
                    )
            if rule.link and links.get(rule.patch or "", rule.link) != rule.link:
                found.append(
                    f"{where}.link: got {shorten(rule.link)}, allowed "
                    f"{links[rule.patch or '']}, which its patch is on, or none"
                )
            problems = find_rule_problems(rule, self.answer)
            found += [f"{where}{problem}" for problem in problems]
        asking = [rule for rule in self.commands if rule.needs_answer]
        if self.asks and asking and self.answer not in known["gesture"]:
            found.append(
                f"answer: got {shorten(self.answer)}, allowed "
                f"{', '.join(known['gesture'])}, or {NEVER_ASKS} for a simulated arm"
            )
        keys = [rule.key for rule in self.commands]
        for index, key in enumerate(keys):
            if (first := keys.index(key)) < index:
                found.append(
                    f"commands[{index}] is for the same touches as commands[{first}]; "
                    "allowed is one rule; take one out"
                )
        return found


def find_rule_problems(rule: Rule, answer: str) -> list[str]:
    """Return the mistakes of a rule by itself.

    Args:
        rule: the rule.
        answer: gesture that answers when the arm asks, or `NEVER_ASKS`.
    """
    found = []
    if (rule.action is None) == (rule.function is None):
        found.append(": allowed is either action or function; give one of them")
    actions = TOGGLES.get(rule.action or "", (rule.action or "",))
    advances = set(actions) & set(ADVANCING_ACTIONS)
    asks = answer != NEVER_ASKS
    if rule.gesture == answer and advances and rule.gesture not in THING_GESTURES:
        found.append(
            f".gesture: got {rule.gesture} for {rule.action}, which is the answer when "
            "the arm asks; allowed is another gesture; change it, or the map's answer"
        )
    if rule.gesture in THING_GESTURES and advances and asks:
        found.append(
            f".action: got {rule.action} for {rule.gesture}, which things that bump, "
            "bounce or swing make too; allowed are actions that stop or slow; write "
            f"'gesture: grab', or 'answer: {NEVER_ASKS}' for a simulated arm"
        )
    if rule.step is not None and rule.action != "jog":
        found.append(
            f".step: got {rule.step:g}, allowed only where the action is jog; take it "
            "out"
        )
    return found


def load_commands(
    path: Path | str | None,
    vocabulary: tuple[str, ...],
    skin: Skin,
    simulated: bool = False,
) -> CommandMap:
    """Read a command map, and compare it to model, skin and arm.

    Args:
        path: path of the file, or one of `NAMED_MAPS`; None takes the default map. Maps
            that come with eskin lose rules whose gesture the model does not know.
        vocabulary: gestures that the model knows.
        skin: the skin whose links and patches may be named.
        simulated: whether the arm is simulated, and no person can be near it.

    Raises:
        CommandError: it cannot be read or used; names every problem with its path, in
            one line.
    """
    commands = read_commands(path)
    if not simulated:
        check_real(commands, path)
    if find_shipped_map(path) is not None:
        commands = commands.select_rules(vocabulary)
    problems = commands.find_problems(vocabulary, skin)
    if problems:
        raise CommandError(f"{format_path(path)}: {'; '.join(problems)}")
    return commands.leave_out_answers(format_path(path))


def read_commands(path: Path | str | None) -> CommandMap:
    """Read a command map, without comparing it to model, skin or arm.

    Args:
        path: as of `load_commands`.

    Raises:
        CommandError: it cannot be read.
    """
    file = find_shipped_map(path)
    if file is None:
        return parse_commands(read_map_text(Path(str(path))), str(path))
    text = (resources.files("eskin.command") / file).read_text("utf-8")
    return parse_commands(text, file)


def find_shipped_map(path: Path | str | None) -> str | None:
    """Return the file of a map that comes with eskin, or None for any other."""
    if path is None:
        return DEFAULT_MAP
    return NAMED_MAPS.get(str(path))


def check_real(commands: CommandMap, path: Path | str | None) -> None:
    """Check that a map is not for simulated arms alone.

    Raises:
        CommandError: it is.
    """
    if not commands.asks:
        raise CommandError(
            f"{format_path(path)}: answer: got {NEVER_ASKS} on a real arm, which "
            "things that bump, bounce or swing would start; allowed is a gesture that "
            "answers when the arm asks; use another map, or --robot sim:ur5"
        )


def read_map_text(path: Path) -> str:
    """Read the text of a file, within the size limit."""
    try:
        return read_file(path, MAX_BYTES).decode("utf-8")
    except UnicodeDecodeError as error:
        raise CommandError(
            f"{format_path(path)}: byte {error.start} is no UTF-8; save it as UTF-8"
        ) from None
    except OSError as error:
        raise CommandError(
            f"{format_path(path)} cannot be read ({error.strerror}); allowed is a "
            "YAML file"
        ) from error


def format_path(path: Path | str | None) -> str:
    """Return a path on one line."""
    return " ".join(str(path or DEFAULT_MAP).split())


def parse_commands(text: str, file: str) -> CommandMap:
    """Read the text of a command map, without comparing it to model or skin.

    Raises:
        CommandError: names every entry that is wrong, in one line that begins with the
            file.
    """
    file = format_path(file)
    try:
        data = load_plain_yaml(text)
    except ValueError as error:
        raise CommandError(f"{file}{error}") from None
    if isinstance(data, dict) and isinstance(data.get(SIMULATION), bool):
        if data.pop(SIMULATION):
            data.setdefault("answer", NEVER_ASKS)
            logger.warning(
                "%s: %s: got true, which is read as 'answer: %s'; write that, or take "
                "it out so that the arm asks",
                file,
                SIMULATION,
                NEVER_ASKS,
            )
    if not isinstance(data, dict):
        raise CommandError(
            f"{file}: got {shorten(data)}, allowed a mapping with the keys "
            f"{', '.join(CommandMap.model_fields)}"
        )
    try:
        return CommandMap.model_validate(data)
    except ValidationError as error:
        lines = "; ".join(map(describe_map_error, error.errors()))
        raise CommandError(f"{file}: {lines}") from None


def describe_map_error(detail: ErrorDetails) -> str:
    """Describe which entry is wrong, what was got and what is allowed."""
    if detail["loc"] == ("answer",) and detail["type"] == "string_type":
        got = shorten(detail["input"])
        return f"answer: got {got}, allowed is one gesture, or {NEVER_ASKS}"
    known = Rule if len(detail["loc"]) > 1 else CommandMap
    return describe_entry_error(detail, tuple(known.model_fields))
