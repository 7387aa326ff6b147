"""What a policy publishes when it asks and is answered, and a listener that does."""

from eskin.stream import CommandEvent, RecognitionState
from helpers.streams import Ear

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TEXT = "resume? answer by a poke within 1 s"


def decide(seconds, action, accepted, why):
    """Return a decision about a grab, some seconds after its first contact."""
    stamp = START + round(seconds * SECOND)
    return CommandEvent(stamp, action, 7, "grab", accepted, why, START, "forearm")


ASKED = decide(1.5, "ask", True, TEXT)
DECISIONS = (
    ASKED,
    decide(3.0, "resume", True, "grab on forearm"),
    CommandEvent(START + 9 * SECOND, "hold", None, None, True, "stale skin"),
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
