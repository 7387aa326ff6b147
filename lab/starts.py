"""Count the people who start a paused arm: they grab it, and answer its question.

    python -m lab.starts                                  # 200 people, ten minutes
    python -m lab.starts --builds 1 --people 2 --kinds fresh --keep tries.jsonl

Each person is in no set. They wait until the skin was left alone for as long as a
request needs, grab the paused arm as people do, and wait for its question. They answer
it by one poke, 0.35 to 0.8 s later, on the link of the grab. If the arm does not
start, they try again after the time that the refusal asks for, up to four tries. All of
them remember to answer, so that the system is measured and not the people.

The first table has the shares of people who start the arm within one, two and three
tries, with intervals of 95 % of resampled builds (percentile bootstrap), and the times
from the question, and from the first contact of the grab, to motion. The second has the
reasons of the tries that fail. Builds of a family with less than 20 readings a second
command no arm: the next seeds take their place. `--keep` appends a line of JSON for
each try.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any, final

import numpy as np
import tyro

from eskin.command import PolicyConfig
from eskin.recording import TruthRecord
from eskin.sim.demo.simulated_user import REACTION, draw_place
from eskin.sim.interactive import draw_demo_person
from eskin.sim.sensor.build import BuildKind
from eskin.stream import CommandEvent
from eskin.units import NS_PER_S
from lab.commanded_arm import compute_interval, format_times
from lab.tables import format_head, format_row
from lab.touched_arm import KINDS, TouchedArm, list_seeds

TRIES = 4
"""Number of tries before a person gives up."""
PATIENCE = 1.5
"""Longest time that a person waits for the question after a grab, or for motion after
an answer [s]."""
HESITATION = (0.1, 0.5)
"""Shortest and longest time that a person waits for longer than is asked for [s]."""
LONGEST = 30.0
"""Time after which a skin counts as never quiet, or an arm as never moving [s]."""
HEAD = (
    "build",
    "people",
    "first try",
    "within two",
    "within three",
    "tries",
    "question to motion p50 / p95 [s]",
    "first contact to motion p50 / p95 [s]",
    "grabs not detected as such",
)


@dataclass(frozen=True)
class Command:
    """Count the people who start a paused arm."""

    builds: int = 5
    """Number of builds of each kind."""
    people: int = 8
    """Number of people on each build."""
    kinds: tuple[BuildKind, ...] = KINDS
    """Kinds of builds."""
    keep: Path | None = None
    """File to which a line of JSON is appended for each try."""
    seed: int = 61000
    """Seed of the first build and its people; each kind begins 100 later."""
    workers: int = 1
    """Number of processes."""


@dataclass
class Try:
    """A try is one grab of a paused arm, and what came of it.

    Times are in [s] since the first contact of the grab; None where it never was.
    """

    kind: str
    """Kind of the build."""
    seed: int
    """Seed of the build."""
    person: int
    """Number of the person on it."""
    number: int
    """Number of the try, from 1."""
    end: float | None = None
    """Last contact of the grab."""
    force: float = 0.0
    """Greatest true force of the grab [N]."""
    felt: float | None = None
    """When the grab was first felt."""
    detected: list[tuple[str, float]] = field(default_factory=list)
    """What the grab was detected as, with the confidence."""
    asked: float | None = None
    """When the arm asked."""
    answer: float | None = None
    """First contact of the answer."""
    answer_end: float | None = None
    """Last contact of the answer."""
    answer_force: float = 0.0
    """Greatest true force of the answer [N]."""
    answer_felt: float | None = None
    """When the answer was first felt."""
    answer_detected: list[tuple[str, float]] = field(default_factory=list)
    """What the answer was detected as, with the confidence."""
    commanded: float | None = None
    """When the arm was resumed."""
    moved: float | None = None
    """When it moved."""
    decisions: list[tuple[str, bool, str, float]] = field(default_factory=list)
    """What was decided: action, whether it was executed, the cause in words, and when.
    """

    @property
    def is_detected(self) -> bool:
        """Return whether the grab was detected as one."""
        return any(gesture == "grab" for gesture, _ in self.detected)

    @property
    def reason(self) -> str:
        """Why the arm did not start, in a few words; empty where it did."""
        if self.moved is not None:
            return ""
        if self.end is None:
            return "the grab missed the skin"
        if self.felt is None:
            return "the grab was not felt"
        refused = [
            why
            for action, accepted, why, _ in self.decisions
            if action == "resume" and not accepted
        ]
        told = refused[-1] if refused else "nothing was said"
        if self.asked is not None:
            words = " ".join(word for word, _ in self.answer_detected)
            words = words or ("not felt" if self.answer_felt is None else "not said")
            return f"answer ({words}): {told}"
        if self.is_detected:
            return f"request: {told}"
        words = " ".join(word for word, _ in self.detected)
        return f"detected as {words or 'nothing'}"


@final
class Starter:
    """People who start a paused arm, one after the other."""

    def __init__(
        self, kind: BuildKind, seed: int, config: PolicyConfig | None = None
    ) -> None:
        """Begin with an arm that works.

        Args:
            kind: kind of the build of the skin.
            seed: seed of the build and its people.
            config: how careful the policy is; as ever unless given.
        """
        self.kind = kind
        self.seed = seed
        self.touched = TouchedArm(kind, seed, config)
        self.rng = np.random.default_rng([seed, 75])

    def run(self, people: int) -> list[list[Try]]:
        """Return the tries of each person."""
        found = [self.run_person(person) for person in range(people)]
        self.touched.close()
        return found

    def run_person(self, person: int) -> list[Try]:
        """Pause the arm and let a person start it; return the tries."""
        touched = self.touched
        hand = touched.skin.hand
        touched.go()
        touched.wait_until(lambda: touched.arm.state().moving, LONGEST)
        touched.arm.pause()
        hand.person = draw_demo_person(touched.skin.env, 1000 * self.seed + person)
        tries: list[Try] = []
        while len(tries) < TRIES:
            self.leave_alone()
            one = Try(self.kind, self.seed, person, len(tries) + 1)
            self.perform_try(one)
            tries.append(one)
            if one.moved is not None:
                break
        return tries

    def leave_alone(self) -> None:
        """Leave the skin alone for as long as the next request needs."""
        policy = self.touched.policy
        config = policy.config.question
        has_failed = policy.failed_at is not None
        least = config.quiet_after_failure if has_failed else config.quiet
        self.touched.wait(least + self.rng.uniform(*HESITATION))

    def perform_try(self, one: Try) -> None:
        """Grab the arm, wait for its question and answer it."""
        touched = self.touched
        earlier = len(touched.notes.decisions)
        grab = touched.skin.hand.perform("grab")
        truths = self.follow(grab)
        if not truths:
            return
        zero = truths[0].stamp
        one.end = (truths[-1].stamp - zero) / NS_PER_S
        one.force = max(truth.force for truth in truths)
        touched.wait_until(lambda: touched.policy.question is not None, PATIENCE)
        question = touched.policy.question
        if question is not None:
            one.asked = (question.asked_at - zero) / NS_PER_S
            strongest = max(truths, key=lambda truth: truth.force)
            self.perform_answer(one, strongest, zero)
        one.felt = self.tell_felt(grab, zero)
        one.detected = self.tell_detected(grab)
        decisions = touched.notes.decisions[earlier:]
        one.decisions = [
            (
                event.action,
                event.accepted,
                event.reason.cause.words,
                (event.stamp - zero) / NS_PER_S,
            )
            for event in decisions
        ]
        started = [each for each in decisions if is_start(each)]
        if started:
            one.commanded = (started[0].stamp - zero) / NS_PER_S
            if touched.wait_until(lambda: touched.arm.state().moving, PATIENCE):
                one.moved = (touched.stamp - zero) / NS_PER_S

    def perform_answer(self, one: Try, grabbed: TruthRecord, zero: int) -> None:
        """Answer the question by a poke, unless it ends before that."""
        touched = self.touched
        policy = touched.policy
        question = policy.question
        assert question is not None
        reaction = self.rng.uniform(*REACTION)
        answers_at = question.asked_at + round(reaction * NS_PER_S)
        touched.wait_until(
            lambda: policy.question is None or touched.source.due >= answers_at, LONGEST
        )
        if policy.question is None:
            return
        place = draw_place(touched.skin, grabbed, self.rng)
        poke = touched.skin.hand.perform(question.answer, place)
        truths = self.follow(poke)
        if truths:
            one.answer = (truths[0].stamp - zero) / NS_PER_S
            one.answer_end = (truths[-1].stamp - zero) / NS_PER_S
            one.answer_force = max(truth.force for truth in truths)
        touched.wait_until(lambda: policy.question is None, PATIENCE)
        touched.wait_until(lambda: touched.arm.state().moving, 0.1)
        one.answer_felt = self.tell_felt(poke, zero)
        one.answer_detected = self.tell_detected(poke)

    def follow(self, number: int) -> list[TruthRecord]:
        """Read scans until a touch is over; return what it truly did."""
        truths: list[TruthRecord] = []
        while number in self.touched.skin.hand.touching:
            self.touched.read()
            truth = self.touched.find_truth(number)
            if truth is not None:
                truths.append(truth)
        return truths

    def tell_felt(self, number: int, zero: int) -> float | None:
        """Return when a touch was first felt, since a time [s]."""
        stamp = self.touched.notes.felt.get(number)
        return None if stamp is None else (stamp - zero) / NS_PER_S

    def tell_detected(self, number: int) -> list[tuple[str, float]]:
        """Return what a touch was detected as, with the confidence."""
        found = self.touched.notes.list_detections(number)
        return [(one.gesture, round(one.confidence, 3)) for one in found]


def is_start(event: CommandEvent) -> bool:
    """Return whether a decision resumed the arm."""
    return event.accepted and event.action == "resume"


Plan = tuple[BuildKind, int, int]
"""Kind and seed of a build, and the number of people on it."""


def run_plan(plan: Plan) -> list[list[Try]]:
    """Return the tries of each person on a build."""
    kind, seed, people = plan
    return Starter(kind, seed).run(people)


def count_started(people: Sequence[list[Try]], within: int) -> int:
    """Return how many people started the arm within a number of tries."""
    return sum(any(one.moved is not None for one in tries[:within]) for tries in people)


def measure_times(tries: Sequence[Try], since: str) -> tuple[float, float] | None:
    """Return median and 95th percentile of the time to motion since an event [s]."""
    times = [
        one.moved - (getattr(one, since) if since else 0.0)
        for one in tries
        if one.moved is not None
    ]
    if not times:
        return None
    return float(np.median(times)), float(np.percentile(times, 95))


def format_kind(name: str, builds: Sequence[list[list[Try]]]) -> str:
    """Format the people of some builds as a row of the table."""
    people = [tries for build in builds for tries in build]
    tries = [one for own in people for one in own]
    shares = []
    for within in (1, 2, 3):
        counts = [(count_started(build, within), len(build)) for build in builds]
        interval = compute_interval(np.array(counts, dtype=np.float64))
        shares.append("{:.1%} ({:.0%} to {:.0%})".format(*interval))
    return format_row(
        [
            name,
            str(len(people)),
            *shares,
            str(len(tries)),
            format_times(measure_times(tries, "asked")),
            format_times(measure_times(tries, "")),
            str(sum(not one.is_detected for one in tries)),
        ]
    )


def print_reasons(kinds: Sequence[str], tries: Sequence[Try]) -> None:
    """Print the table of the reasons for which tries failed."""
    counts = Counter(one.reason for one in tries if one.reason)
    print("\n" + format_head(["reason", "tries", *kinds]))
    for reason, count in counts.most_common():
        own = [
            sum(one.reason == reason and one.kind == kind for one in tries)
            for kind in kinds
        ]
        print(format_row([reason, *map(str, (count, *own))]))


def keep_tries(path: Path, tries: Sequence[Try]) -> None:
    """Append a line of JSON for each try to a file."""
    with path.open("a", encoding="utf-8") as file:
        for one in tries:
            line: dict[str, Any] = asdict(one) | {"reason": one.reason}
            file.write(json.dumps(line) + "\n")


def simulate(command: Command) -> Iterator[tuple[BuildKind, list[list[list[Try]]]]]:
    """Yield each kind of builds with the tries of each person of each build."""
    with get_context("spawn").Pool(command.workers) as pool:
        for kind in command.kinds:
            seeds = list_seeds(kind, command.seed, command.builds)
            plans: list[Plan] = [(kind, seed, command.people) for seed in seeds]
            yield kind, list(pool.imap(run_plan, plans, 1))


def main(args: list[str] | None = None) -> None:
    """Print both tables."""
    command = tyro.cli(Command, args=args)
    found: list[list[list[Try]]] = []
    print(format_head(HEAD), flush=True)
    for kind, builds in simulate(command):
        print(format_kind(kind, builds), flush=True)
        found += builds
        if command.keep is not None:
            own = [one for build in builds for tries in build for one in tries]
            keep_tries(command.keep, own)
    print(format_kind("all", found))
    tries = [one for build in found for own in build for one in own]
    print_reasons(command.kinds, tries)


if __name__ == "__main__":
    main()
