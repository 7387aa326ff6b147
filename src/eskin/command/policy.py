"""This module decides which touches command the arm, and holds it on trouble.

A stop needs nothing. For more, a touch asks, the arm asks back, and another touch
answers; whether it may is said by `conditions.py`. The class reads from top to bottom:
what a detection asks for, what is done with a reading of the skin, the question, what
the arm is told, and the watch.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field, replace
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

from eskin.command.actions import (
    ASK,
    FUNCTION,
    HALTING_ACTIONS,
    SUSPEND,
    FunctionCall,
    resolve_action,
)
from eskin.command.arm import Arm
from eskin.command.command_map import NON_GESTURES, CommandMap, Rule
from eskin.command.commanded_touch import (
    CommandedTouch,
    CommandedTouches,
    CommandRequest,
)
from eskin.command.conditions import (
    Situation,
    describe_way,
    find_change,
    find_late_refusal,
    find_refusal,
    gesture_is_clear,
    is_due,
)
from eskin.command.question import Question, QuestionConfig
from eskin.command.reasons import Problem, Refusal, Trigger
from eskin.command.skin_monitor import SkinMonitor, SkinMonitorConfig
from eskin.errors import ArmError, JogError
from eskin.live import UNKNOWN, Detection
from eskin.reasons import Reason
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S

UNUSED = (
    "evidence",
    "min_duration",
    "min_breadth",
    "min_pause",
    "min_release",
    "max_delay",
)
"""Arguments of `PolicyConfig` that say nothing any more."""
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PolicyConfig:
    """A policy configuration says how careful commands are."""

    monitor: SkinMonitorConfig = field(default_factory=SkinMonitorConfig)
    """Limits beyond which the arm is held because of its skin."""

    question: QuestionConfig = field(default_factory=QuestionConfig)
    """What counts as a question, and as its answer."""

    slow_speed: float = 0.3
    """Share of full speed of the action `slow`, and on a skin that is out in part."""

    jog_step: float = 0.05
    """Length of a jog whose rule gives none [m]."""

    function_seconds: float = 0.06
    """Longest time that a function of the map may take before the arm is held [s]."""

    check_period: float | None = 0.02
    """How often a thread checks whether the skin is stale, though no reading comes [s];
    None starts no thread, and `check_skin` is called by others."""

    evidence: InitVar[object] = None
    min_duration: InitVar[float | None] = None
    min_breadth: InitVar[float | None] = None
    min_pause: InitVar[float | None] = None
    min_release: InitVar[float | None] = None
    max_delay: InitVar[float | None] = None

    def __post_init__(self, *before: object) -> None:
        """Tell that limits of touches say nothing any more."""
        given = [
            name
            for name, value in zip(UNUSED, before, strict=True)
            if value is not None
        ]
        if given:
            logger.warning(
                "PolicyConfig: got %s, which says nothing any more, since the arm asks "
                "back; take it out, or see QuestionConfig",
                ", ".join(given),
            )


@final
class Policy(Listener):
    """A policy turns detections into commands of an arm, and publishes each decision.

    A moving arm is suspended while it is touched. What makes the arm do less is
    executed at once. What makes it do more is asked for, and executed once a person has
    answered. Whatever fails in here holds the arm. This is no certified safety
    function.

    Attributes:
        arm: the arm that is commanded.
        accepted: number of commands of touches that were executed.
        question: the question that is open, or None.
        failed_at: when the latest question failed, until the skin has been quiet for
            long enough to ask again [ns since the epoch]; None otherwise.
    """

    name = "policy"
    message_types = (Detection, RecognitionState)
    size = 64
    drop: Drop = "oldest"

    def __init__(
        self,
        arm: Arm,
        commands: CommandMap,
        vocabulary: tuple[str, ...],
        config: PolicyConfig | None = None,
    ) -> None:
        """Command nothing before the stream starts.

        Args:
            arm: the arm that is commanded; its owner closes it.
            commands: the rules from touches to actions.
            vocabulary: gestures of the model, in the order of the probabilities.
            config: how careful it is.
        """
        self.arm = arm
        self.commands = commands
        self.vocabulary = vocabulary
        self.config = config or PolicyConfig()
        self.lock = RLock()
        self.accepted = 0
        self.stopped_at = 0
        self.slowed_at = 0
        self.jogs_until = 0
        self.question: Question | None = None
        self.failed_at: int | None = None
        self.stops: tuple[int, Reason | None] | None = None
        self.last_used: dict[object, int] = {}
        self.slowed: Reason | None = None
        self.held_for: Reason | None = None
        self.over: Reason | None = None
        self.failure: BaseException | None = None
        self.call: FunctionCall | None = None
        self.closing = Flag()
        self.thread: Thread | None = None

    def start(self, context: Context) -> None:
        """Start to monitor the skin.

        Raises:
            ArmError: the skin gives too few readings to be relied on.
        """
        max_age = self.config.monitor.max_age
        rate = context.info.rate
        if rate * max_age < 2:
            raise ArmError(
                f"the skin gives {rate:.3g} readings a second; allowed are "
                f"{2 / max_age:g} or more, so that old data is noticed; run it "
                "without an arm"
            )
        self.context = context
        skin = context.info.skin
        limits = self.config.monitor
        now = context.clock.now()
        self.watched = now
        self.monitor = SkinMonitor(skin, limits, now)
        self.touches = CommandedTouches(
            skin, context.info.calibration, self.commands, self.vocabulary, limits, now
        )
        if self.config.check_period is not None:
            self.thread = Thread(target=self.run, name="eskin watch", daemon=True)
            self.thread.start()

    def on_message(self, item: Message) -> None:
        """Handle a detection or a recognition state."""
        if self.failure is not None:
            raise self.failure
        with self.lock:
            self.hold_on_error(lambda: self.handle(item))

    def handle(self, item: Message) -> None:
        """Execute what a detection or a recognition state asks for."""
        if isinstance(item, Detection):
            touch = self.touches.find_touch(item.touch)
            touch.decided = True
            touch.detected_force = item.peak_force
            touch.detected_area = touch.full_area
            if self.question is not None and item.onset >= self.question.asked_at:
                self.question.detections.append((touch, item))
            else:
                self.take(touch, item)
        elif isinstance(item, RecognitionState):
            self.touches.update(item)
            self.monitor.update(item, (one.patch for one in self.touches.felt))
            self.hold_if_unreliable()
            self.stop_if_excessive()
            self.pause_if_touched()
            self.pause_if_stop()
            for request in tuple(self.touches.requests):
                self.review(request)
            self.review_question()
            self.tell_if_never_quiet()
            self.update_limit()

    def take(self, touch: CommandedTouch, detection: Detection) -> None:
        """Execute a detection's action now or later, if it has one."""
        if detection.gesture == UNKNOWN:
            self.decide_unknown(touch, detection)
        elif detection.gesture not in NON_GESTURES:
            self.decide(touch, detection)

    def decide(self, touch: CommandedTouch, detection: Detection) -> None:
        """Execute a detection's action now or later, or publish why not."""
        request = self.build_request(touch, detection)
        if request is None or request.action == "none":
            refusal = Refusal.NO_RULE if request is None else Refusal.RULE_OF_NONE
            self.publish("none", False, refusal.reason(), detection)
            return
        refusal = find_refusal(self.observe(request, detection.stamp))
        if refusal is None:
            touch.asked.add(detection.onset)
            if request.action not in HALTING_ACTIONS or not request.is_confident:
                self.touches.requests.append(request)
                return
        self.complete(request, refusal)

    def decide_unknown(self, touch: CommandedTouch, detection: Detection) -> None:
        """Stop or slow the arm if an unknown touch may ask for it; do nothing else."""
        gesture = detection.likeliest
        known = gesture not in ("", *NON_GESTURES)
        chance = self.touches.find_stop_chance(detection)
        if chance is not None and not self.arm.state().paused:
            self.pause_for_unknown(touch, detection, chance)
        elif known:
            likely = replace(detection, gesture=gesture)
            request = self.build_request(touch, likely)
            halts = request is not None and request.action in HALTING_ACTIONS
            if request is not None and request.is_confident and not halts:
                self.decide(touch, likely)
            else:
                refusal = Refusal.NOT_UNDERSTOOD.reason(
                    likeliest=gesture, confidence=detection.confidence
                )
                self.publish("none", False, refusal, detection)

    def pause_for_unknown(
        self, touch: CommandedTouch, detection: Detection, chance: float
    ) -> None:
        """Pause the arm for an unknown touch that may be a stop, unless it cannot be.

        Args:
            touch: the touch.
            detection: its detection, as unknown.
            chance: probability that it is a stop.
        """
        request = CommandRequest(
            touch=touch,
            detection=detection,
            rule=Rule(gesture=detection.gesture, action="pause"),
            action="pause",
            required=0.0,
            confidence=chance,
            end=detection.end,
        )
        refusal = find_change(self.observe(request, detection.stamp))
        if refusal is not None:
            self.publish("pause", False, refusal, detection)
            return
        likeliest = detection.likeliest
        if likeliest in ("", *NON_GESTURES):
            self.pause_for(touch, Trigger.MAY_BE_STOP.reason(chance=chance))
            return
        reason = Trigger.LIKELIEST_MAY_BE_STOP.reason(
            likeliest=likeliest, confidence=detection.confidence, chance=chance
        )
        self.pause_for(touch, reason, likeliest)

    def build_request(
        self, touch: CommandedTouch, detection: Detection
    ) -> CommandRequest | None:
        """Return what a detection asks for; None where the map has no rule for it."""
        rule = self.commands.find_rule(
            detection.gesture, detection.link, detection.patch, detection.heading
        )
        if rule is None:
            return None
        action = resolve_action(rule.action_or_function, self.arm.state())
        return CommandRequest(
            touch=touch,
            detection=detection,
            rule=rule,
            action=action,
            required=self.commands.require_confidence(rule, action),
            confidence=detection.confidence,
            end=detection.end,
        )

    def observe(self, request: CommandRequest, stamp: int) -> Situation:
        """Return what the conditions of a request depend on, now.

        Args:
            request: what a touch asks for.
            stamp: time of the latest reading of the touch [ns since the epoch].
        """
        now = self.context.clock.now()
        state = self.arm.state()
        patch = request.detection.patch
        halts = request.action in HALTING_ACTIONS
        used = self.last_used.get(request.rule.key)
        return Situation(
            request=request,
            arm=state,
            meant=resolve_action(request.rule.action_or_function, state),
            age=self.context.age(stamp),
            asks=self.needs_answer(request),
            problem=None if halts else self.find_problem(now),
            is_out=self.monitor.is_out(patch, now),
            has_data=self.monitor.has_data(patch),
            over=self.over,
            since_same=math.inf if used is None else (now - used) / NS_PER_S,
            stopped_at=self.stopped_at,
            failed_at=self.failed_at,
            latest=self.touches.latest,
            others=self.touches.list_others(request.touch),
            commands=self.commands,
            limits=self.config.monitor,
            config=self.config.question,
        )

    def needs_answer(self, request: CommandRequest) -> bool:
        """Return whether the arm asks before it does the requested action."""
        if request.action == "jog" and self.context.clock.now() < self.jogs_until:
            return False
        return self.commands.needs_answer(request.rule, request.action)

    def find_problem(self, now: int) -> Reason | None:
        """Return why the arm is held at a time; None if it is not."""
        if self.call is not None and self.call.has_returned():
            self.call = None
        if self.call is not None:
            return self.call.problem
        # A watch that comes late itself shows that the skin need not be silent.
        late = now - self.watched > self.config.monitor.max_age * NS_PER_S
        is_busy = self.thread is not None and late
        return self.monitor.find_problem(now, is_busy)

    def hold_if_unreliable(self) -> None:
        """Hold the arm if skin or functions cannot be relied on; publish when again."""
        now = self.context.clock.now()
        state = self.arm.state()
        stops = state.pause_count, state.hold_reason
        if stops != self.stops:
            self.stops = stops
            self.stopped_at = now
            self.jogs_until = 0
        problem = self.find_problem(now)
        if problem is not None:
            for request in self.touches.requests:
                self.complete(request, problem)
            self.touches.requests.clear()
            if self.question is not None:
                self.end_question(problem)
            if state.hold_reason is None:
                self.held_for = problem
                self.hold(problem)
            self.over = None
        elif state.hold_reason is None:
            self.held_for = self.over = None
        elif self.held_for is not None and self.over is None:
            self.over = self.held_for
            way = describe_way(state, self.commands, self.config.question)
            refusal = Refusal.PROBLEM_OVER.reason(problem=self.over.what, way=way)
            self.publish("resume", False, refusal)

    def stop_if_excessive(self) -> None:
        """Stop an arm at work under a touch that is too strong or long, whatever it is.

        An arm that is only suspended for a touch is stopped too. One that never asks is
        simulated, and only stands while the touch is too strong.
        """
        state = self.arm.state()
        suspended = state.speed_limit == 0.0
        if state.stopped or not (state.moving or suspended):
            return
        for touch in self.touches.felt:
            excess = touch.find_excess(self.config.monitor)
            if excess is not None and self.commands.asks:
                return self.hold(excess, touch)
            if touch.is_long(self.config.monitor):
                reason = Trigger.LONG_TOUCH.reason(seconds=touch.duration)
                return self.pause_for(touch, reason)

    def pause_if_touched(self) -> None:
        """End a jog as soon as anybody touches the skin; the arm stays paused."""
        if self.touches.felt and self.arm.state().jogging:
            self.arm.pause()
            self.publish("pause", True, Trigger.TOUCHED_WHILE_JOGGING.reason())

    def pause_if_stop(self) -> None:
        """Pause an arm at work if a touch that nobody recognised may be a stop."""
        if self.arm.state().stopped:
            return
        for touch in self.touches.ended:
            may_stop = touch.onset is not None and not touch.decided
            if may_stop and touch.stop_chance >= touch.stop_required:
                self.pause_for(touch, Trigger.MAY_HAVE_BEEN_STOP.reason())

    def tell_if_never_quiet(self) -> None:
        """Publish once which touch has pressed the skin for so long that none asks."""
        longest = self.config.monitor.light_seconds
        for touch in self.touches.felt:
            if touch.duration > longest and not touch.told:
                touch.told = True
                reason = Refusal.TOUCHED_ALL_THE_TIME.reason(
                    patch=touch.patch, seconds=longest
                )
                self.publish("none", False, reason, touch=touch)

    def update_limit(self) -> None:
        """Suspend the arm, let it go slowly or at its speed, and publish a change."""
        now = self.context.clock.now()
        state = self.arm.state()
        if not state.stopped:
            self.update_slowing(now)
        limit = 1.0 if self.slowed is None else self.config.slow_speed
        touch = None if state.stopped else self.touches.find_suspending()
        is_asking = self.question is not None or bool(self.touches.requests)
        if touch is not None or is_asking or self.monitor.lost_in_contact(now):
            limit = 0.0
        if state.speed_limit != limit:
            self.arm.limit_speed(limit)
            if touch is not None:
                self.publish(SUSPEND, True, Trigger.TOUCHED.reason(), touch=touch)

    def update_slowing(self, now: int) -> None:
        """Slow the arm where the skin asks for it, and no longer once that is over."""
        problem = self.monitor.find_outage(now) or self.touches.find_lasting()
        if problem is not None:
            if self.slowed is None:
                self.publish("slow", True, problem)
            self.slowed = problem
            self.slowed_at = now
        elif self.slowed is not None:
            if now - self.slowed_at > self.config.monitor.clear_seconds * NS_PER_S:
                reason = Trigger.PROBLEM_OVER.reason(problem=self.slowed.what)
                self.publish("normal", True, reason)
                self.slowed = None

    def review(self, request: CommandRequest) -> None:
        """Execute or ask for a request once it may be, or refuse it if it must not."""
        situation = self.observe(request, self.touches.latest)
        refusal = find_late_refusal(situation)
        if refusal is None:
            if not is_due(situation):
                return
            refusal = gesture_is_clear(situation)
        self.touches.requests.remove(request)
        asks = refusal is None and situation.asks
        if asks and self.question is not None:
            self.complete(request, Refusal.ASKS_ALREADY.reason())
        elif asks:
            self.ask(request)
        else:
            self.complete(request, refusal)

    def ask(self, request: CommandRequest) -> None:
        """Ask whether the arm is to do what a touch asks for."""
        answer = self.commands.answer
        self.question = Question(
            request=request,
            answer=answer,
            vocabulary=self.vocabulary,
            asked_at=self.context.clock.now(),
            before=tuple(self.touches.by_id.values()),
            links=self.touches.links,
            config=self.config.question,
        )
        self.arm.show_question(True)
        self.publish(ASK, True, self.question.reason, request.detection)

    def review_question(self) -> None:
        """Execute what the arm has asked for once it is answered, or refuse it."""
        now = self.context.clock.now()
        if self.failed_at is not None:
            quiet_since = max(self.failed_at, self.touches.last_contact)
            least = self.config.question.quiet_after_failure * NS_PER_S
            if now - quiet_since >= least:
                self.failed_at = None
        if self.question is None:
            return
        request = self.question.request
        refusal = self.question.find_refusal(self.touches)
        if refusal is None:
            refusal = find_change(self.observe(request, self.touches.latest))
        is_answered = self.question.is_answered(self.touches.latest)
        if refusal is not None or is_answered:
            self.end_question(refusal)

    def end_question(self, refusal: Reason | None) -> None:
        """End the question that is open, and do what was asked for unless refused.

        What was detected meanwhile acts as ever if it was no answer.
        """
        question = self.question
        if question is None:
            return
        self.question = None
        self.arm.show_question(False)
        if refusal is None:
            if question.touch is not None:
                question.touch.blocked = True
            self.complete(question.request, None)
            return
        self.failed_at = self.context.clock.now()
        self.complete(question.request, refusal)
        for touch, detection in question.detections:
            # It has waited for the question, and is not old because of that.
            present = replace(detection, stamp=self.touches.latest)
            self.take(touch, present)

    def complete(self, request: CommandRequest, refusal: Reason | None) -> None:
        """Execute a request unless it is refused, and publish the decision."""
        detection = request.detection
        if refusal is None:
            try:
                refusal = self.execute(request)
            except JogError as error:
                refusal = Problem.ORDER_FAILED.reason(error=error)
            except ArmError as error:
                refusal = Problem.ORDER_FAILED.reason(error=error)
                self.hold(refusal)
        if refusal is None:
            self.accepted += 1
            self.last_used[request.rule.key] = self.context.clock.now()
        reason = describe_source(detection) if refusal is None else refusal
        self.publish(request.action, refusal is None, reason, detection)

    def execute(self, request: CommandRequest) -> Reason | None:
        """Make the arm execute what is asked for; return why it failed, if it did.

        Raises:
            ArmError: the arm does not execute it.
        """
        arm = self.arm
        detection = request.detection
        rule = request.rule
        now = self.context.clock.now()
        match request.action:
            case "resume":
                arm.release()
                arm.resume()
            case "jog":
                step = self.config.jog_step if rule.step is None else rule.step
                arm.jog(step * detection.direction_world)
                if now >= self.jogs_until:
                    seconds = self.config.question.jog_seconds
                    self.jogs_until = now + round(seconds * NS_PER_S)
            case "slow":
                arm.set_speed(self.config.slow_speed)
            case "normal":
                arm.set_speed(1.0)
            case "hold":
                arm.hold(describe_source(detection))
                self.stopped_at = now
            case action if action == FUNCTION:
                call = FunctionCall(rule.function or "", arm, detection)
                if not call.has_returned(self.config.function_seconds):
                    self.call = call
                    self.held_for = call.problem
                    self.hold(call.problem)
                    return call.problem
            case action:
                getattr(arm, action)()
        return None

    def pause_for(
        self, touch: CommandedTouch, reason: Reason, likeliest: str = ""
    ) -> None:
        """Pause the arm for a touch that was not recognised, and publish why.

        Args:
            touch: the touch.
            reason: why it pauses the arm.
            likeliest: the likeliest gesture of the touch, where one is known.
        """
        self.arm.pause()
        self.accepted += 1
        touch.blocked = True
        self.publish("pause", True, reason, touch=touch, likeliest=likeliest)

    def hold(self, problem: Reason, touch: CommandedTouch | None = None) -> None:
        """Hold the arm and publish why, and for which touch."""
        self.arm.hold(problem)
        self.stopped_at = self.context.clock.now()
        self.publish("hold", True, problem, touch=touch)

    def publish(
        self,
        action: str,
        accepted: bool,
        reason: Reason,
        detection: Detection | None = None,
        touch: CommandedTouch | None = None,
        likeliest: str = "",
    ) -> None:
        """Publish a decision to the other listeners.

        Args:
            action: plain action that it is about.
            accepted: whether the action was carried out.
            reason: why it was, or was not.
            detection: detection that led to it, if any.
            touch: touch that led to it, where no detection did.
            likeliest: likeliest gesture of that touch, where one is known.
        """
        number = onset = patch = gesture = None
        if detection is not None:
            number = detection.touch
            gesture = detection.gesture
            onset = detection.onset
            patch = detection.patch
        elif touch is not None:
            number = touch.id
            onset = touch.onset
            patch = touch.patch or None
        now = self.context.clock.now()
        self.context.publish(
            CommandEvent(
                stamp=now,
                action=action,
                touch=number,
                gesture=gesture,
                accepted=accepted,
                reason=reason,
                onset=onset,
                patch=patch,
                likeliest=likeliest,
            )
        )

    def check_skin(self) -> None:
        """Hold or slow the arm where its skin or its policy cannot be relied on."""
        if not self.lock.acquire(timeout=self.config.monitor.max_age):
            return self.arm.hold(Problem.BLOCKED_POLICY.reason())
        try:
            self.hold_if_unreliable()
            self.update_limit()
        finally:
            self.watched = self.context.clock.now()
            self.lock.release()

    def run(self) -> None:
        """Check the skin again and again, though no reading may come."""
        while not self.closing.wait(self.config.check_period):
            try:
                self.hold_on_error(self.check_skin)
            except BaseException as error:
                logger.exception("the watch over the skin has failed")
                self.failure = error
                return

    def hold_on_error(self, action: Callable[[], None]) -> None:
        """Call a function; hold the arm where it fails."""
        try:
            action()
        except BaseException as error:
            name = type(error).__name__
            self.arm.hold(Problem.FAILED_POLICY.reason(error=name))
            raise

    def close(self) -> None:
        """Hold the arm: nothing monitors the skin any more."""
        self.closing.set()
        self.arm.hold(Problem.ENDED_STREAM.reason())
        self.question = None
        self.arm.show_question(False)
        self.arm.limit_speed(1.0)
        if self.thread is not None:
            self.thread.join()


def describe_source(detection: Detection) -> Reason:
    """Return that a gesture on a patch is why the arm does something."""
    return Trigger.GESTURE.reason(gesture=detection.gesture, patch=detection.patch)
