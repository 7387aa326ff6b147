"""This module says whether a touch may command the arm, by conditions with names.

A stop needs nothing but an arm that obeys and a touch that is felt now. For anything
else, skin, rule and arm must allow it. What makes the arm do more is asked for: the
skin was quiet before, the touch left it alone, and another touch answered
(`question.py`). Each condition returns why it does not hold, or None where it does.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from eskin.command.actions import (
    COOL_DOWN,
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    needs_answer,
)
from eskin.command.arm import ArmState
from eskin.command.command_map import CommandMap
from eskin.command.commanded_touch import CommandedTouch, CommandRequest
from eskin.command.question import QuestionConfig
from eskin.command.reasons import Refusal
from eskin.command.skin_monitor import SkinMonitorConfig
from eskin.reasons import Reason
from eskin.units import NS_PER_S


@dataclass(frozen=True, eq=False, kw_only=True)
class Situation:
    """A situation is what conditions depend on, at one instant."""

    request: CommandRequest
    """What a touch asks for."""

    arm: ArmState
    """State of the arm."""

    meant: str
    """Plain action that the same gesture would ask for now."""

    age: float
    """Age of the latest reading of the touch [s]."""

    asks: bool
    """Whether the arm asks before it does what is asked for."""

    problem: Reason | None
    """Why the arm is held now because of its skin or a function; None for a stop, which
    does not depend on it."""

    is_out: bool
    """Whether the touched patch is out."""

    has_data: bool
    """Whether the latest reading has data of the touched patch."""

    over: Reason | None
    """Problem for which the arm is still held, though it is over."""

    since_same: float
    """Time since the same rule was last executed [s]; infinite where it never was."""

    stopped_at: int
    """When the arm was last stopped [ns since the epoch]."""

    failed_at: int | None
    """When a question failed after which the skin has not been quiet for long enough
    [ns since the epoch]; None where none has."""

    latest: int
    """Stamp of the latest reading [ns since the epoch]."""

    others: Sequence[CommandedTouch]
    """Other touches that are present."""

    commands: CommandMap
    """The rules from touches to actions."""

    limits: SkinMonitorConfig
    """Limits of touches and of the skin."""

    config: QuestionConfig
    """What counts as a question."""

    @property
    def action(self) -> str:
        """Plain action that is asked for."""
        return self.request.action

    @property
    def halts(self) -> bool:
        """Whether the arm is to stop."""
        return self.action in HALTING_ACTIONS

    @property
    def starts(self) -> bool:
        """Whether an arm that stands is to move."""
        return self.action in STARTING_ACTIONS

    @property
    def is_immediate(self) -> bool:
        """Whether what is asked for makes the arm do no more than before."""
        return not needs_answer(self.action, self.request.rule.function)


Condition = Callable[[Situation], Reason | None]
"""Returns why it does not hold, or None where it does."""


def touch_is_new(situation: Situation) -> Reason | None:
    """Each touch commands once; a working arm is stopped by any."""
    touch = situation.request.touch
    if situation.halts and not situation.arm.stopped:
        return None
    if not touch.has_commanded(situation.request.detection.onset):
        return None
    return Refusal.ALREADY_COMMANDED.reason()


def arm_obeys(situation: Situation) -> Reason | None:
    """The arm is connected, and neither in protective stop nor without its program."""
    return situation.arm.problem


def touch_is_felt(situation: Situation) -> Reason | None:
    """The latest reading of the touch is not old."""
    if situation.age <= situation.limits.max_age:
        return None
    return Refusal.FELT_LONG_AGO.reason(milliseconds=1e3 * situation.age)


def skin_is_reliable(situation: Situation) -> Reason | None:
    """Skin, model and functions can be relied on."""
    return situation.problem


def patch_works(situation: Situation) -> Reason | None:
    """The touched patch sends data."""
    if not situation.is_out:
        return None
    return Refusal.PATCH_OUT.reason(patch=situation.request.detection.patch)


def rule_has_rested(situation: Situation) -> Reason | None:
    """The same rule was not executed just before."""
    given = situation.request.rule.cool_down
    cool_down = COOL_DOWN if given is None else given
    if situation.since_same >= cool_down:
        return None
    return Refusal.RESTS.reason(seconds=situation.since_same, cool_down=cool_down)


def arm_is_free(situation: Situation) -> Reason | None:
    """The arm is not held, or what is asked for ends that or makes it do less."""
    arm = situation.arm
    allowed = situation.action == "resume" or situation.action in REDUCING_ACTIONS
    if arm.hold_reason is None or allowed:
        return None
    way = describe_way(arm, situation.commands, situation.config)
    if situation.over is not None:
        return Refusal.STILL_HELD.reason(problem=situation.over.what, way=way)
    return Refusal.HELD.reason(problem=arm.hold_reason, way=way)


def jog_has_direction(situation: Situation) -> Reason | None:
    """The touch travelled, where it asks for a jog along its way."""
    travelled = situation.request.detection.direction_world.any()
    if situation.action != "jog" or travelled:
        return None
    return Refusal.NO_DIRECTION.reason()


def arm_is_paused(situation: Situation) -> Reason | None:
    """A person has paused the arm, where it is to move again."""
    if situation.arm.paused or not situation.starts:
        return None
    way = describe_way(situation.arm, situation.commands, situation.config)
    return Refusal.NOT_PAUSED.reason(way=way)


def skin_was_quiet(situation: Situation) -> Reason | None:
    """Nothing touched the skin for a while before, and an arm that stands stood.

    It is longer after a question that was not answered.
    """
    onset = situation.request.detection.onset
    quiet_since = situation.request.touch.quiet_since
    since = onset if quiet_since is None else quiet_since
    least = situation.config.quiet
    refusal = Refusal.TOUCHED_EARLIER
    if situation.arm.stopped:
        since = max(since, situation.stopped_at)
        refusal = Refusal.TOUCHED_OR_MOVED_EARLIER
    if situation.failed_at is not None:
        since = max(since, situation.failed_at)
        least = situation.config.quiet_after_failure
        refusal = Refusal.TOUCHED_AFTER_QUESTION
    if onset - since >= least * NS_PER_S:
        return None
    return refusal.reason(seconds=least)


def touch_is_one(situation: Situation) -> Reason | None:
    """No two touches that have asked have become one."""
    if not situation.request.touch.clashes:
        return None
    return Refusal.ALREADY_COMMANDED.reason()


def arm_is_unchanged(situation: Situation) -> Reason | None:
    """The gesture would still ask for the same."""
    if situation.meant == situation.action or not situation.commands.asks:
        return None
    return Refusal.ARM_CHANGED.reason(action=situation.meant.replace("_", " "))


def touch_is_last(situation: Situation) -> Reason | None:
    """No other touch has begun since the end of the touch."""
    end = situation.request.end
    if all((one.onset or 0) <= end for one in situation.others):
        return None
    return Refusal.TOUCHED_AGAIN.reason()


def skin_is_let_go(situation: Situation) -> Reason | None:
    """Nothing presses the skin long after the end of the touch."""
    request = situation.request
    since = situation.latest - request.end
    is_late = since > situation.config.quiet * NS_PER_S
    if not (request.touch.closed and is_late) or is_due(situation):
        return None
    return Refusal.STILL_TOUCHED.reason()


def gesture_is_clear(situation: Situation) -> Reason | None:
    """The gesture is as likely as the action requires."""
    request = situation.request
    if request.is_confident:
        return None
    return Refusal.UNCERTAIN.reason(
        gesture=request.detection.gesture.replace("_", " "),
        confidence=request.confidence,
        required=request.required,
    )


FOR_STOP: tuple[Condition, ...] = (arm_obeys, touch_is_felt)
"""Conditions of every command; a stop has no others."""
FOR_MORE: tuple[Condition, ...] = (
    *FOR_STOP,
    skin_is_reliable,
    patch_works,
    rule_has_rested,
    arm_is_free,
    jog_has_direction,
    arm_is_paused,
)
"""Conditions of what is no stop."""
FOR_QUESTION: tuple[Condition, ...] = (*FOR_MORE, skin_was_quiet)
"""Conditions of what the arm asks back for, and of what sets it in motion."""
WHILE_ALONE: tuple[Condition, ...] = (touch_is_last, skin_is_let_go)
"""Conditions of what makes the arm do more, until its touch has left the skin."""


def list_conditions(situation: Situation) -> tuple[Condition, ...]:
    """Return the conditions of what is asked for, in the order in which they count."""
    if situation.halts:
        return FOR_STOP
    if situation.asks or situation.starts:
        return FOR_QUESTION
    return FOR_MORE


def find_first(conditions: Iterable[Condition], situation: Situation) -> Reason | None:
    """Return why the first of some conditions that does not hold does not, or None."""
    for condition in conditions:
        refusal = condition(situation)
        if refusal is not None:
            return refusal
    return None


def find_refusal(situation: Situation) -> Reason | None:
    """Return why a detection must not command what it asks for, or None if it may.

    Its confidence is not considered.
    """
    return find_first((touch_is_new, *list_conditions(situation)), situation)


def find_change(situation: Situation) -> Reason | None:
    """Return why what was asked for is not allowed any more, or None where it is."""
    later = () if situation.halts else (arm_is_unchanged,)
    return find_first((*list_conditions(situation), *later), situation)


def find_late_refusal(situation: Situation) -> Reason | None:
    """Return why a request that waits must not be executed any more, or None."""
    refusal = touch_is_one(situation) or find_change(situation)
    if refusal is not None or situation.is_immediate:
        return refusal
    return find_first(WHILE_ALONE, situation)


def is_due(situation: Situation) -> bool:
    """Return whether it can be decided now whether a request is executed.

    What makes the arm do no more is, as soon as it is confident. All else waits until
    its touch has closed, and nothing presses the skin any more.
    """
    request = situation.request
    if situation.is_immediate:
        return request.is_confident or request.touch.closed
    is_alone = not (request.touch.is_present or situation.others)
    return is_alone and situation.has_data


def describe_way(arm: ArmState, commands: CommandMap, config: QuestionConfig) -> str:
    """Return what a person does at the skin to let a stopped arm go on.

    Args:
        arm: state of the arm.
        commands: the rules from touches to actions.
        config: what counts as a question.
    """
    stops, goes = (
        " or ".join(commands.list_gestures(action)).replace("_", " ")
        for action in ("pause", "resume")
    )
    if goes and commands.asks:
        answer = commands.answer.replace("_", " ")
        goes = f"{goes}, then {answer} when the arm asks"
    if arm.paused:
        return f"to go on: {goes or 'resume it in the program'}"
    if not (stops and goes):
        return "to go on: release it in the program"
    return f"to go on: {stops}, {config.quiet:g} s later {goes}"
