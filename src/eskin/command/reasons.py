"""This module lists why an arm does what it does, is held, or refuses a touch."""

from enum import unique

from eskin.reasons import Cause


@unique
class Trigger(Cause):
    """A trigger is why an arm does something that touches or the skin ask for."""

    GESTURE = "{gesture} on {patch}"
    QUESTION = "{action}? answer by a {answer} there within {window:g} s"
    TOUCHED = "touched: the arm stands until that is over"
    TOUCHED_WHILE_JOGGING = "touched while it jogs"
    MAY_BE_STOP = "not understood: it may be a stop ({chance:.0%})"
    LIKELIEST_MAY_BE_STOP = (
        "not understood, most likely {likeliest} ({confidence:.0%}): it may be a stop "
        "({chance:.0%})"
    )
    MAY_HAVE_BEEN_STOP = "not understood: the touch may have been a stop"
    LONG_TOUCH = "touch for {seconds:.1f} s"
    PROBLEM_OVER = "the cause is over ({problem})"


@unique
class Problem(Cause):
    """A problem is why an arm is held or slowed, though nobody asked for that."""

    PROTECTIVE_STOP = ("the arm is in protective stop", "unlock it at the robot")
    NOT_CONNECTED = (
        "the arm is not connected",
        "see to its cable and its controller",
    )
    PROGRAM_ENDED = ("the robot's program has ended", "start the command again")
    CLOSED = ("the arm is closed", "open it again")
    ORDER_FAILED = "{error}"
    TOLD = "{text}"
    STALE_SKIN = (
        "stale skin: no reading for {milliseconds:.0f} ms",
        "see to its cable and its power",
    )
    BUSY_COMPUTER = (
        "this computer was too busy: no reading for {milliseconds:.0f} ms",
        "end other programs on it",
    )
    BROKEN_MODEL = (
        "broken model: a probability is not finite",
        "use another model",
    )
    DEAF_SKIN = (
        "deaf skin: counts go the other way under pressure",
        "run eskin calibrate on it",
    )
    BROKEN_SKIN = (
        "broken skin: {patches} out, {share:.0%} of the taxels",
        "see to its cable or its cover; touches are felt elsewhere",
    )
    BROKEN_PATCH = (
        "broken skin: {patches} out",
        "see to its cable or its cover; touches are felt elsewhere",
    )
    LASTING_TOUCH = (
        "a light touch on patch '{patch}' lasts for more than {seconds:g} s",
        "lift what lies on it, or see to its cable or its cover",
    )
    STRONG_TOUCH = ("touch of {force:.0f} N", "take your hand off")
    GROWN_FORCE = (
        "touch that grew to {force:.0f} N after its detection",
        "take your hand off",
    )
    GROWN_AREA = (
        "touch that grew to {square_centimetres:.1f} cm2 at full scale",
        "take your hand off",
    )
    BLOCKED_FUNCTION = (
        "function '{name}' does not return",
        "let it start a thread for what takes long",
    )
    BLOCKED_POLICY = ("the policy does not answer", "start the command again")
    FAILED_POLICY = ("the policy failed: {error}", "start the command again")
    ENDED_STREAM = ("the stream has ended", "start the command again")


@unique
class Refusal(Cause):
    """A refusal is why a touch does not command what it asks for."""

    NO_RULE = ("the map has no rule for it", "touch in another way, or add one")
    RULE_OF_NONE = ("the map says none", "touch in another way, or change the map")
    NOT_UNDERSTOOD = (
        "not understood, most likely {likeliest} ({confidence:.0%})",
        "do it again, more clearly",
    )
    UNCERTAIN = (
        "not understood: {gesture} ({confidence:.0%}) is below {required:.0%}",
        "do it again, more clearly",
    )
    FELT_LONG_AGO = ("it was felt {milliseconds:.0f} ms ago", "touch again")
    ALREADY_COMMANDED = (
        "its touch has commanded already",
        "lift the hand before the next",
    )
    PATCH_OUT = ("patch '{patch}' is out", "touch elsewhere")
    RESTS = (
        "the same was done {seconds:.1f} s ago, it rests {cool_down:g} s",
        "wait, then do it again",
    )
    HELD = ("the arm is held: {problem}", "{way}")
    STILL_HELD = (
        "the arm is still held, though the cause is over ({problem})",
        "{way}",
    )
    PROBLEM_OVER = ("the cause is over ({problem})", "{way}")
    NOT_PAUSED = ("nobody has paused it", "{way}")
    NO_DIRECTION = ("the touch did not travel", "stroke farther")
    ARM_CHANGED = (
        "the arm has changed: the same would {action} now",
        "let go, wait some seconds, then ask again",
    )
    TOUCHED_EARLIER = (
        "something touched the skin less than {seconds:g} s before",
        "let go, wait {seconds:g} s, then ask again",
    )
    TOUCHED_OR_MOVED_EARLIER = (
        "something touched the skin, or the arm moved, less than {seconds:g} s before",
        "let go, wait {seconds:g} s, then ask again",
    )
    TOUCHED_AFTER_QUESTION = (
        "something touched the skin within {seconds:g} s after a question that nobody "
        "answered",
        "let go, wait {seconds:g} s, then ask again",
    )
    TOUCHED_ALL_THE_TIME = (
        "patch '{patch}' has been touched for more than {seconds:g} s, and nothing "
        "starts the arm meanwhile",
        "lift what lies on it, or start again so that its rest is measured",
    )
    STILL_TOUCHED = (
        "something still presses the skin",
        "let go, then ask again",
    )
    TOUCHED_AGAIN = (
        "the skin was touched again meanwhile",
        "let go, then ask again",
    )
    ASKS_ALREADY = (
        "the arm asks about another touch",
        "let go, then ask again",
    )
    TOUCHED_BEFORE_QUESTION = (
        "the skin was touched before the arm had asked",
        "let go, and ask again {again:g} s later",
    )
    NO_ANSWER = ("no {answer} answered", "let go, and ask again {again:g} s later")
    LATE_ANSWER = (
        "the answer came too late",
        "let go, and ask again {again:g} s later",
    )
    TWO_ANSWERS = (
        "more than one touch came in answer",
        "let go, and ask again {again:g} s later",
    )
    STRONG_ANSWER = (
        "the answer was too strong ({problem})",
        "let go, and ask again {again:g} s later",
    )
    LONG_ANSWER = (
        "the answer lasted for more than {seconds:g} s",
        "let go, and ask again {again:g} s later",
    )
    BRIEF_ANSWER = (
        "the answer was brief ({seconds:.2f} s), as a hit may be",
        "let go, and ask again {again:g} s later",
    )
    ANSWER_ELSEWHERE = (
        "the answer was not on {link}, where the touch was that asked",
        "let go, and ask again {again:g} s later",
    )
    UNCLEAR_ANSWER = (
        "the answer was no clear {answer} ({chance:.0%})",
        "let go, and ask again {again:g} s later",
    )
