"""This module decides which touches command the arm, and holds it on trouble.

A stop needs nothing. For more, a touch asks, the arm asks back, and another touch
answers. The class reads from top to bottom: what a detection asks for, why that is
refused, what is done with a reading of the skin, the question, what the arm is told,
and the watch.
"""

import logging
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field, replace
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

from eskin.command.actions import (
    ASK,
    COOL_DOWN,
    FUNCTION,
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    SUSPEND,
    FunctionCall,
    needs_answer,
    resolve_action,
)
from eskin.command.arm import Arm, ArmState, Problem
from eskin.command.command_map import NON_GESTURES, CommandMap, Rule
from eskin.command.commanded_touch import (
    CommandedTouch,
    CommandedTouches,
    CommandRequest,
)
from eskin.command.question import Question, QuestionConfig
from eskin.command.skin_monitor import SkinMonitor, SkinMonitorConfig
from eskin.errors import ArmError, JogError
from eskin.live import UNKNOWN, Detection
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S

ALREADY_COMMANDED = "its touch has commanded already; lift the hand before the next"
GOES_ON = "something still presses the skin; let go, then ask again"
ASKS_ALREADY = "the arm asks about another touch; let go, then ask again"
TOUCHED_AGAIN = "the skin was touched again meanwhile; let go, then ask again"
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
        self.stops: tuple[int, str | None] | None = None
        self.last_used: dict[object, int] = {}
        self.slowed: Problem | None = None
        self.held_for: Problem | None = None
        self.over: str | None = None
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
                f"{2 / max_age:g} or more, so that what is old is noticed; run it "
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
            touch = self.touches.find(item.touch)
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
            said = "the map says none" if request else "the map has no rule for it"
            self.publish("none", False, said, detection)
            return
        halts = request.action in HALTING_ACTIONS and not self.arm.state().stopped
        refusal = ALREADY_COMMANDED
        if halts or not touch.has_commanded(detection.onset):
            refusal = self.find_refusal(request, detection.stamp)
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
        said = f", most likely {gesture} ({detection.confidence:.0%})" if known else ""
        chance = self.touches.find_stop_chance(detection)
        if chance is not None and not self.arm.state().paused:
            refusal = self.find_fault(self.arm.state(), detection.stamp)
            if refusal is None:
                reason = f"not understood{said}: it may be a stop ({chance:.0%})"
                self.pause_for(touch, reason, gesture if known else "")
            else:
                self.publish("pause", False, refusal, detection)
        elif known:
            likely = replace(detection, gesture=gesture)
            request = self.build_request(touch, likely)
            halts = request is not None and request.action in HALTING_ACTIONS
            if request is not None and request.is_confident and not halts:
                self.decide(touch, likely)
            else:
                reason = f"not understood{said}; do it again, more clearly"
                self.publish("none", False, reason, detection)

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

    def find_fault(self, state: ArmState, stamp: int) -> str | None:
        """Return why no touch may command the arm, not even to stop.

        Args:
            state: state of the arm.
            stamp: time of the latest reading of the touch [ns since the epoch].
        """
        age = self.context.age(stamp)
        if state.protective_stop:
            return "the arm is in protective stop; unlock it at the robot"
        if not state.connected:
            return "the arm is not connected; see to its cable and its controller"
        if not state.running:
            return "the robot's program has ended; start the command again"
        if age > self.config.monitor.max_age:
            return f"it was felt {1e3 * age:.0f} ms ago; touch again"
        return None

    def find_refusal(self, request: CommandRequest, stamp: int) -> str | None:
        """Return why a touch must not command what it asks for, or None where it may.

        Its confidence is not considered. The reason is the one that holds now, and says
        what to do.

        Args:
            request: what it asks for.
            stamp: time of the latest reading of the touch [ns since the epoch].
        """
        now = self.context.clock.now()
        state = self.arm.state()
        action = request.action
        detection = request.detection
        fault = self.find_fault(state, stamp)
        if fault is not None or action in HALTING_ACTIONS:
            return fault
        problem = self.find_problem(now)
        if problem is not None:
            return str(problem)
        if self.monitor.is_out(detection.patch, now):
            return f"patch '{detection.patch}' is out; touch elsewhere"
        rested = self.find_rest(request.rule, now)
        if rested is not None:
            return rested
        allowed = action == "resume" or action in REDUCING_ACTIONS
        if state.hold_reason is not None and not allowed:
            reason = self.over or state.hold_reason
            return f"the arm is held: {reason}; {self.describe_way(state)}"
        if action == "jog" and not detection.direction_world.any():
            return "the touch did not travel; stroke farther"
        if action in STARTING_ACTIONS and not state.paused:
            return f"nobody has paused it; {self.describe_way(state)}"
        if action in STARTING_ACTIONS or self.needs_answer(request):
            return self.find_noise(request, state)
        return None

    def find_noise(self, request: CommandRequest, state: ArmState) -> str | None:
        """Return why a touch must not ask, because of what was before; None if it may.

        Args:
            request: what the touch asks for.
            state: state of the arm.
        """
        onset = request.detection.onset
        since = request.touch.quiet_since
        since = onset if since is None else since
        least = self.config.question.quiet
        reason = f"something touched the skin less than {least:g} s before"
        if state.stopped:
            since = max(since, self.stopped_at)
            reason = (
                f"something touched the skin, or the arm moved, less than {least:g} s "
                "before"
            )
        if self.failed_at is not None:
            since = max(since, self.failed_at)
            least = self.config.question.quiet_after_failure
            reason = (
                f"something touched the skin within {least:g} s after a question that "
                "nobody answered"
            )
        if onset - since >= least * NS_PER_S:
            return None
        return f"{reason}; let go, wait {least:g} s, then ask again"

    def needs_answer(self, request: CommandRequest) -> bool:
        """Return whether the arm asks before it does what is asked for."""
        if request.action == "jog" and self.context.clock.now() < self.jogs_until:
            return False
        return self.commands.needs_answer(request.rule, request.action)

    def find_rest(self, rule: Rule, now: int) -> str | None:
        """Return why a rule rests at a time, or None where it does not."""
        if rule.key not in self.last_used:
            return None
        cool_down = rule.cool_down if rule.cool_down is not None else COOL_DOWN
        rested = (now - self.last_used[rule.key]) / NS_PER_S
        if rested >= cool_down:
            return None
        return (
            f"the same was done {rested:.1f} s ago, it rests {cool_down:g} s; wait, "
            "then do it again"
        )

    def describe_way(self, state: ArmState) -> str:
        """Return what a person does at the skin to let a stopped arm go on."""
        stops, goes = (
            " or ".join(self.commands.list_gestures(action)).replace("_", " ")
            for action in ("pause", "resume")
        )
        if goes and self.commands.asks:
            answer = self.commands.answer.replace("_", " ")
            goes = f"{goes}, then {answer} when the arm asks"
        if state.paused:
            return f"to go on: {goes or 'resume it in the program'}"
        if not (stops and goes):
            return "to go on: release it in the program"
        return f"to go on: {stops}, {self.config.question.quiet:g} s later {goes}"

    def find_problem(self, now: int) -> Problem | None:
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
                self.complete(request, str(problem))
            self.touches.requests.clear()
            if self.question is not None:
                self.end_question(str(problem))
            if state.hold_reason is None:
                self.held_for = problem
                self.hold(problem)
            self.over = None
        elif state.hold_reason is None:
            self.held_for = self.over = None
        elif self.held_for is not None and self.over is None:
            self.over = f"no longer {self.held_for.what}"
            way = self.describe_way(state)
            self.publish("resume", False, f"{self.over}; {way}")

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
            if excess and self.commands.asks:
                return self.hold(Problem(excess, "take your hand off"), touch)
            if touch.is_long(self.config.monitor):
                return self.pause_for(touch, f"touch for {touch.duration:.1f} s")

    def pause_if_touched(self) -> None:
        """End a jog as soon as anybody touches the skin; the arm stays paused."""
        if self.touches.felt and self.arm.state().jogging:
            self.arm.pause()
            self.publish("pause", True, "touched while it jogs")

    def pause_if_stop(self) -> None:
        """Pause an arm at work if a touch that nobody recognised may be a stop."""
        if self.arm.state().stopped:
            return
        for touch in self.touches.ended:
            may_stop = touch.onset is not None and not touch.decided
            if may_stop and touch.stop_chance >= touch.stop_required:
                self.pause_for(touch, "not understood: the touch may have been a stop")

    def tell_if_never_quiet(self) -> None:
        """Publish once which touch has pressed the skin for so long that none asks."""
        longest = self.config.monitor.light_seconds
        for touch in self.touches.felt:
            if touch.duration > longest and not touch.told:
                touch.told = True
                reason = (
                    f"patch '{touch.patch}' has been touched for more than {longest:g} "
                    "s, and nothing starts the arm meanwhile; lift what lies on it, or "
                    "start again so that its rest is measured"
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
                reason = "touched: the arm stands until that is over"
                self.publish(SUSPEND, True, reason, touch=touch)

    def update_slowing(self, now: int) -> None:
        """Slow the arm where the skin asks for it, and no longer once that is over."""
        problem = self.monitor.find_outage(now) or self.touches.find_lasting()
        if problem is not None:
            if self.slowed is None:
                self.publish("slow", True, str(problem))
            self.slowed = problem
            self.slowed_at = now
        elif self.slowed is not None:
            if now - self.slowed_at > self.config.monitor.clear_seconds * NS_PER_S:
                self.publish("normal", True, f"no longer {self.slowed.what}")
                self.slowed = None

    def review(self, request: CommandRequest) -> None:
        """Execute or ask for a request once it may be, or refuse it if it must not."""
        refusal = self.find_late_refusal(request)
        if refusal is None:
            if not self.is_due(request):
                return
            refusal = self.find_uncertainty(request)
        self.touches.requests.remove(request)
        asks = refusal is None and self.needs_answer(request)
        if asks and self.question is not None:
            self.complete(request, ASKS_ALREADY)
        elif asks:
            self.ask(request)
        else:
            self.complete(request, refusal)

    def find_late_refusal(self, request: CommandRequest) -> str | None:
        """Return why a request must not be executed any more, or None where it may."""
        if request.touch.clashes:
            return ALREADY_COMMANDED
        refusal = self.find_change(request)
        if refusal is not None or self.is_immediate(request):
            return refusal
        others = self.touches.list_others(request.touch)
        if any((one.onset or 0) > request.end for one in others):
            return TOUCHED_AGAIN
        longest = self.config.question.quiet * NS_PER_S
        since = self.touches.latest - request.end
        is_let_go = request.touch.closed and since > longest
        return GOES_ON if is_let_go and not self.is_due(request) else None

    def find_change(self, request: CommandRequest) -> str | None:
        """Return why arm and skin do not allow what is asked for now, or None."""
        refusal = self.find_refusal(request, self.touches.latest)
        if refusal is not None or request.action in HALTING_ACTIONS:
            return refusal
        meant = resolve_action(request.rule.action_or_function, self.arm.state())
        if meant != request.action and self.commands.asks:
            meant = meant.replace("_", " ")
            return f"the arm has changed: the same would {meant} now"
        return None

    def is_immediate(self, request: CommandRequest) -> bool:
        """Return whether what is asked for makes the arm do no more than before."""
        return not needs_answer(request.action, request.rule.function)

    def is_due(self, request: CommandRequest) -> bool:
        """Return whether it can be decided now whether a request is executed.

        What makes the arm do no more is, as soon as it is confident. All else waits
        until its touch has closed, and nothing presses the skin any more.
        """
        touch = request.touch
        if self.is_immediate(request):
            return request.is_confident or touch.closed
        is_quiet = not self.touches.list_others(touch)
        has_data = self.monitor.has_data(request.detection.patch)
        return not touch.is_present and is_quiet and has_data

    def find_uncertainty(self, request: CommandRequest) -> str | None:
        """Return that a gesture is not likely enough, or None where it is."""
        if request.is_confident:
            return None
        gesture = request.detection.gesture.replace("_", " ")
        return (
            f"not understood: {gesture} ({request.confidence:.0%}) is below "
            f"{request.required:.0%}; do it again, more clearly"
        )

    def ask(self, request: CommandRequest) -> None:
        """Ask whether the arm is to do what a touch asks for."""
        answer = self.commands.answer
        self.question = Question(
            request=request,
            answer=answer,
            vocabulary=self.vocabulary,
            asked_at=self.context.clock.now(),
            before=tuple(self.touches.by_id.values()),
            config=self.config.question,
        )
        self.arm.show_question(True)
        self.publish(ASK, True, self.question.text, request.detection)

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
        refusal = self.question.find_refusal(self.touches) or self.find_change(request)
        is_answered = self.question.is_answered(self.touches.latest)
        if refusal is not None or is_answered:
            self.end_question(refusal)

    def end_question(self, refusal: str | None) -> None:
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
        least = self.config.question.quiet_after_failure
        if ";" not in refusal:
            refusal = f"{refusal}; let go, and ask again {least:g} s later"
        self.complete(question.request, refusal)
        for touch, detection in question.detections:
            # It has waited for the question, and is not old because of that.
            present = replace(detection, stamp=self.touches.latest)
            self.take(touch, present)

    def complete(self, request: CommandRequest, refusal: str | None) -> None:
        """Execute a request unless it is refused, and publish the decision."""
        detection = request.detection
        if refusal is None:
            try:
                self.execute(request)
            except JogError as error:
                refusal = str(error)
            except ArmError as error:
                refusal = str(error)
                self.hold(Problem(refusal))
        if refusal is None:
            self.accepted += 1
            self.last_used[request.rule.key] = self.context.clock.now()
        source = f"{detection.gesture} on {detection.patch}"
        reason = source if refusal is None else refusal
        self.publish(request.action, refusal is None, reason, detection)

    def execute(self, request: CommandRequest) -> None:
        """Make the arm execute what is asked for."""
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
                arm.hold(f"{detection.gesture} on {detection.patch}")
                self.stopped_at = now
            case action if action == FUNCTION:
                call = FunctionCall(rule.function or "", arm, detection)
                if not call.has_returned(self.config.function_seconds):
                    self.call = call
                    self.held_for = call.problem
                    raise ArmError(str(call.problem))
            case action:
                getattr(arm, action)()

    def pause_for(
        self, touch: CommandedTouch, reason: str, likeliest: str = ""
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

    def hold(self, problem: Problem, touch: CommandedTouch | None = None) -> None:
        """Hold the arm and publish why, and for which touch."""
        self.arm.hold(str(problem))
        self.stopped_at = self.context.clock.now()
        self.publish("hold", True, str(problem), touch=touch)

    def publish(
        self,
        action: str,
        accepted: bool,
        reason: str,
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
                why=reason,
                onset=onset,
                patch=patch,
                likeliest=likeliest,
            )
        )

    def check_skin(self) -> None:
        """Hold or slow the arm where its skin or its policy cannot be relied on."""
        if not self.lock.acquire(timeout=self.config.monitor.max_age):
            return self.arm.hold("the policy does not answer")
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
            self.arm.hold(f"the policy failed: {type(error).__name__}")
            raise

    def close(self) -> None:
        """Hold the arm: nothing monitors the skin any more."""
        self.closing.set()
        self.arm.hold("the stream has ended")
        self.question = None
        self.arm.show_question(False)
        self.arm.limit_speed(1.0)
        if self.thread is not None:
            self.thread.join()
