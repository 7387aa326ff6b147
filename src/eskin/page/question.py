"""This module describes what a policy asks, as the page shows it."""

from eskin.command import Policy
from eskin.page.messages import QuestionBoard


def describe_question(policy: Policy, now: int) -> QuestionBoard:
    """Return what a policy asks, and what a person has to observe before it asks again.

    Args:
        policy: policy that commands the arm.
        now: time [ns since the epoch].
    """
    commands, question = policy.commands, policy.question
    answer = commands.answer if commands.asks else ""
    rest = 0.0
    if policy.failed_at is not None:
        rest = policy.config.question.quiet_after_failure
    if question is None:
        return QuestionBoard(answer, rest)
    request = question.request
    window = question.deadline - question.asked_at
    return QuestionBoard(
        answer=answer,
        rest=rest,
        action=request.rule.function or request.action,
        link=request.detection.link,
        left=min(max((question.deadline - now) / window, 0.0), 1.0),
        is_answering=question.is_answering,
    )
