"""What a policy publishes when it asks and is answered, and a listener that does."""

from eskin.command import Problem, Trigger
from eskin.stream import CommandEvent, RecognitionState
from helpers.streams import Ear

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
QUESTION = Trigger.QUESTION.reason(action="resume", answer="poke", window=1.0)
GRAB = Trigger.GESTURE.reason(gesture="grab", patch="forearm")
STALE = Problem.STALE_SKIN.reason(milliseconds=120.0)


def decide(seconds, action, accepted, reason):
    """Return a decision about a grab, some seconds after its first contact."""
    stamp = START + round(seconds * SECOND)
    return CommandEvent(stamp, action, 7, "grab", accepted, reason, START, "forearm")


ASKED = decide(1.5, "ask", True, QUESTION)
DECISIONS = (
    ASKED,
    decide(3.0, "resume", True, GRAB),
    CommandEvent(START + 9 * SECOND, "hold", None, None, True, STALE),
)
"""A question, its answer, and a decision that no touch led to."""


def make_deciding_listener():
    """Return a listener that publishes the decisions when the first reading comes."""

    def decide_once(item):
        if not listener.received:
            for decision in DECISIONS:
                listener.context.publish(decision)

    listener = Ear("deciding", message_types=(RecognitionState,), do=decide_once)
    return listener
