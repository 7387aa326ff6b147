"""This module decides which touches command the arm, and holds it on trouble.

The class reads from top to bottom: what a detection asks for, what is done with a
reading of the skin, when a request is executed, what the arm is told, and the watch.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

from eskin.command.actions import (
    COOL_DOWN,
    FUNCTION,
    GRAB,
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    SUSPEND,
    SUSPEND_CONFIDENCE,
    FunctionCall,
    resolve_action,
)
from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import NON_GESTURES, CommandMap, Rule
from eskin.command.commanded_touch import (
    CommandedTouch,
    CommandedTouches,
    CommandRequest,
)
from eskin.command.evidence import EvidenceConfig, EvidenceMonitor
from eskin.command.skin_monitor import SkinMonitor, SkinMonitorConfig
from eskin.errors import ArmError, JogError
from eskin.live import UNKNOWN, Detection
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S

ALREADY_COMMANDED = "its touch has commanded already; lift the hand before the next"
IMPLAUSIBLE = (
    "too few sound taxels felt it, or too briefly: it may be a fault of the skin; "
    "touch more firmly"
)
REMEDY = "see to its cable or its cover; it goes on being felt elsewhere"
GOES_ON = "touching went on for too long; let go, then ask again"
TOUCHED_AGAIN = "the skin was touched again meanwhile; let go, then ask again"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PolicyConfig:
    """A policy configuration says how careful commands are."""

    monitor: SkinMonitorConfig = field(default_factory=SkinMonitorConfig)
    """Limits beyond which the arm is held because of its skin."""

    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    """How much of a touch must be sound for more than a stop."""

    min_duration: float = 0.3
    """Least time from the first to the latest contact of a touch that makes the arm do
    more than before [s]; what bumps into a skin and rebounds is briefer than most
    double pats. Chosen from data (`lab/notes/policy.md`)."""

    min_breadth: float = 0.05
    """Least breadth of a grab that makes the arm do more [m]: straps, hoses and cables
    are narrower, hands are broader. Chosen from data (`lab/notes/policy.md`)."""

    min_pause: float = 1.0
    """How long the arm must have been stopped, and nobody have touched the skin, before
    the touch begins that sets it in motion [s]."""

    min_release: float = 0.1
    """How long a touch must have ended before it makes the arm do more [s]."""

    max_delay: float = 2.0
    """How long after a detection its touch may go on before it makes the arm do more,
    and a doubtful one may become confident [s]."""

    slow_speed: float = 0.3
    """Share of full speed of the action `slow`, and on a skin that is out in part."""

    jog_step: float = 0.05
    """Length of a jog whose rule gives none [m]."""

    function_seconds: float = 0.06
    """Longest time that a function of the map may take before the arm is held [s]."""

    check_period: float | None = 0.02
    """How often a thread checks whether the skin is stale, though no reading comes [s];
    None starts no thread, and `check_skin` is called by others."""


@final
class Policy(Listener):
    """A policy turns detections into commands of an arm, and publishes each decision.

    What can make the arm do less needs little; what can start it needs much. A moving
    arm is suspended while a touch may be a stop, and goes on once it is recognised as
    something else. Whatever fails in here holds the arm. This is no certified safety
    function.

    Attributes:
        arm: the arm that is commanded.
        accepted: number of commands of touches that were executed.
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
        self.accepted = self.stopped_at = self.slowed_at = 0
        self.stops: tuple[int, str | None] | None = None
        self.last_used: dict[object, int] = {}
        self.slowed: str | None = None
        self.held_for: str | None = None
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
        max_age, rate = self.config.monitor.max_age, context.info.rate
        if rate * max_age < 2:
            raise ArmError(
                f"the skin gives {rate:.3g} readings a second; allowed are "
                f"{2 / max_age:g} or more, so that what is old is noticed; run it "
                "without an arm"
            )
        self.context = context
        skin, limits, now = context.info.skin, self.config.monitor, context.clock.now()
        self.watched = now
        self.monitor = SkinMonitor(skin, limits, now)
        self.evidence = EvidenceMonitor(skin, self.config.evidence)
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
            if item.gesture not in NON_GESTURES:
                self.decide(touch, item)
            elif item.gesture == UNKNOWN:
                self.decide_unknown(touch, item)
            touch.decided = True
            touch.suspends &= touch.is_held
            touch.detected_force = item.peak_force
            touch.detected_area = touch.full_area
        elif isinstance(item, RecognitionState):
            self.touches.update(item)
            self.monitor.update(item, (one.patch for one in self.touches.felt))
            self.evidence.update(item)
            self.hold_if_unreliable()
            self.stop_if_excessive()
            self.pause_if_touched()
            self.suspend_if_stop()
            for request in tuple(self.touches.requests):
                self.review(request)
            self.update_limit()

    def decide(self, touch: CommandedTouch, detection: Detection) -> None:
        """Execute a detection's action now or later, or publish why not."""
        request = self.build_request(touch, detection)
        if request is None or request.action == "none":
            said = "the map says none" if request else "the map has no rule for it"
            self.publish("none", False, said, detection)
            return
        refusal = self.find_refusal(request, detection.stamp)
        if refusal is None and touch.has_commanded(detection.onset):
            refusal = ALREADY_COMMANDED
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
        said = f", most likely {gesture} ({detection.confidence:.2f})" if known else ""
        chance = self.touches.find_stop_chance(detection)
        if chance is not None and not self.arm.state().paused:
            refusal = self.find_fault(self.arm.state(), detection.stamp)
            if touch.has_commanded(detection.onset):
                refusal = ALREADY_COMMANDED
            if refusal is None:
                reason = f"not understood{said}: it may be a stop ({chance:.2f})"
                self.pause_for(touch, reason)
            else:
                self.publish("pause", False, refusal, detection)
        elif known:
            likely = replace(detection, gesture=gesture)
            request = self.build_request(touch, likely)
            slows = request is not None and request.action == "slow"
            may_act = slows or self.commands.simulation
            if request is not None and may_act and request.is_confident:
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
        now, state, action = self.context.clock.now(), self.arm.state(), request.action
        detection = request.detection
        fault = self.find_fault(state, stamp)
        if fault is not None or action in HALTING_ACTIONS:
            return fault
        problem = self.find_problem(now)
        if problem is not None:
            return problem
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
        if action in STARTING_ACTIONS:
            return self.find_start_refusal(request.touch, detection.onset, state)
        return None

    def find_start_refusal(
        self, touch: CommandedTouch, onset: int, state: ArmState
    ) -> str | None:
        """Return why a touch must not set the arm in motion, or None where it may.

        Args:
            touch: the touch.
            onset: time at which it began [ns since the epoch].
            state: state of the arm.
        """
        if not state.paused:
            return f"nobody has paused it; {self.describe_way(state)}"
        least = self.config.min_pause
        if onset - max(touch.untouched_since, self.stopped_at) < least * NS_PER_S:
            return (
                "the touch began before the arm had stood, and nobody had touched the "
                f"skin, for {least:g} s; let go, wait, then ask again"
            )
        return None

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
        if state.paused:
            return f"to go on: {goes or 'resume it in the program'}"
        if not (stops and goes):
            return "to go on: release it in the program"
        least = f"{self.config.min_pause:g} s later"
        return f"to go on: {stops}, then {goes} at least {least}"

    def find_problem(self, now: int) -> str | None:
        """Return why the arm is held at a time, with what to do; None if it is not."""
        if self.call is not None and self.call.has_returned():
            self.call = None
        if self.call is not None:
            return self.call.problem
        # A watch that comes late itself shows that the skin need not be silent.
        late = now - self.watched > self.config.monitor.max_age * NS_PER_S
        is_busy = self.thread is not None and late
        problem = self.monitor.find_problem(now, is_busy)
        return problem if problem is None or is_busy else f"{problem}; {REMEDY}"

    def hold_if_unreliable(self) -> None:
        """Hold the arm if skin or functions cannot be relied on; publish when again."""
        now, state = self.context.clock.now(), self.arm.state()
        stops = state.pause_count, state.hold_reason
        if stops != self.stops:
            self.stops, self.stopped_at = stops, now
        problem = self.find_problem(now)
        if problem is not None:
            requests, self.touches.requests = self.touches.requests, []
            for request in requests:
                self.complete(request, problem)
            if state.hold_reason is None:
                self.held_for = problem.removesuffix(f"; {REMEDY}")
                self.hold(self.held_for)
            self.over = None
        elif state.hold_reason is None:
            self.held_for = self.over = None
        elif self.held_for is not None and self.over is None:
            self.over = f"no longer {self.held_for}"
            way = self.describe_way(state)
            self.publish("resume", False, f"{self.over}; {way}")

    def stop_if_excessive(self) -> None:
        """Stop an arm at work under a touch that is too strong or long, whatever it is.

        An arm that is only suspended for another touch is stopped too.
        """
        state = self.arm.state()
        suspended = state.speed_limit == 0.0 or self.touches.is_suspending
        if state.stopped or not (state.moving or suspended):
            return
        for touch in self.touches.felt:
            action, reason = touch.find_excess(self.config.monitor)
            if action == "hold" and self.commands.simulation:
                action = SUSPEND
            if action == SUSPEND and not touch.suspends:
                self.suspend_for(touch, reason)
            elif action == "hold":
                return self.hold(reason, touch)
            elif action == "pause":
                return self.pause_for(touch, reason)

    def pause_if_touched(self) -> None:
        """End a jog as soon as anybody touches the skin; the arm stays paused."""
        if self.touches.felt and self.arm.state().jogging:
            self.arm.pause()
            self.publish("pause", True, "touched while it jogs")

    def suspend_if_stop(self) -> None:
        """Suspend a moving arm while a touch may be a stop; pause it at its end.

        An arm is suspended for less of a chance than it is paused for, since it goes on
        by itself.
        """
        state = self.arm.state()
        if state.stopped:
            self.touches.release()
        elif not state.jogging:
            for touch in self.touches.felt:
                least = min(touch.stop_required, SUSPEND_CONFIDENCE)
                if touch.stop_chance >= least and not (touch.decided or touch.suspends):
                    self.suspend_for(
                        touch,
                        f"it may be a stop ({touch.stop_chance:.2f}); the arm stands "
                        "until it is clear",
                    )
        for touch in self.touches.ended:
            may_stop = touch.suspends and not touch.decided
            if may_stop and touch.stop_chance >= touch.stop_required:
                self.pause_for(touch, "not understood: the touch may have been a stop")

    def update_limit(self) -> None:
        """Suspend the arm, let it go slowly or at its speed, and publish a change."""
        now, state = self.context.clock.now(), self.arm.state()
        if not state.stopped:
            self.update_slowing(now)
        limit = 1.0 if self.slowed is None else self.config.slow_speed
        if self.touches.is_suspending or self.monitor.lost_in_contact(now):
            limit = 0.0
        if state.speed_limit != limit:
            self.arm.limit_speed(limit)

    def update_slowing(self, now: int) -> None:
        """Slow the arm where the skin asks for it, and no longer once that is over."""
        reason = self.monitor.find_outage(now) or self.touches.find_lasting()
        if reason is not None:
            if self.slowed is None:
                self.publish("slow", True, f"{reason}; {REMEDY}")
            self.slowed, self.slowed_at = reason, now
        elif self.slowed is not None:
            if now - self.slowed_at > self.config.monitor.clear_seconds * NS_PER_S:
                self.publish("normal", True, f"no longer {self.slowed}")
                self.slowed = None

    def review(self, request: CommandRequest) -> None:
        """Execute a request once it may be, or refuse it where it must not."""
        refusal = self.find_late_refusal(request)
        if refusal is None:
            if not self.has_ended(request):
                if not self.goes_on(request):
                    return
                refusal = GOES_ON
            elif (refusal := self.find_doubt(request)) is not None:
                late = self.context.age(request.detection.stamp) > self.config.max_delay
                if not (late or request.touch.closed):
                    return
        self.touches.requests.remove(request)
        self.complete(request, refusal)

    def find_late_refusal(self, request: CommandRequest) -> str | None:
        """Return why a request must not be executed any more, or None where it may."""
        action = request.action
        if request.touch.clashes:
            return ALREADY_COMMANDED
        refusal = self.find_refusal(request, self.touches.latest)
        if refusal is not None or action in HALTING_ACTIONS:
            return refusal
        meant = resolve_action(request.rule.action_or_function, self.arm.state())
        if meant != action and not self.commands.simulation:
            meant = meant.replace("_", " ")
            return f"the arm has changed: the same would {meant} now"
        others = self.touches.list_other_onsets(request.touch)
        if action in STARTING_ACTIONS and max(others, default=0) > request.end:
            return TOUCHED_AGAIN
        return None

    def has_ended(self, request: CommandRequest) -> bool:
        """Return whether the skin was let go, as far as the action needs that."""
        touches, action = self.touches, request.action
        if action in REDUCING_ACTIONS:
            return True
        release = self.config.min_release * NS_PER_S
        if action not in STARTING_ACTIONS:
            is_let_go = not request.touch.is_held
            return is_let_go and touches.latest - request.end >= release
        alone = not touches.list_other_onsets(request.touch)
        has_data = self.monitor.has_data(request.detection.patch)
        return not request.touch.is_present and alone and has_data

    def goes_on(self, request: CommandRequest) -> bool:
        """Return whether touching goes on for too long after a detection."""
        detected, longest = request.detection.stamp, self.config.max_delay * NS_PER_S
        since = max(detected, request.end)
        return max(request.end - detected, self.touches.latest - since) > longest

    def find_doubt(self, request: CommandRequest) -> str | None:
        """Return why a touch may be no command after all, or None where it is one.

        On a simulated arm nothing but its confidence counts.
        """
        action, least = request.action, self.config.min_duration
        if self.commands.simulation:
            return self.find_uncertainty(request)
        if action not in HALTING_ACTIONS and not self.evidence.is_plausible(
            request.touch.id
        ):
            return IMPLAUSIBLE
        uncertainty = self.find_uncertainty(request)
        if uncertainty is not None or action in REDUCING_ACTIONS:
            return uncertainty
        if request.duration < least:
            return (
                f"its touch lasted {request.duration:.2f} s, as a bump may; what makes "
                f"the arm do more lasts {least:g} s or longer: do it again, more slowly"
            )
        if request.detection.gesture == GRAB:
            return self.find_narrowness(request.touch)
        return None

    def find_uncertainty(self, request: CommandRequest) -> str | None:
        """Return that a confidence is too low, or None where it is not."""
        if request.is_confident:
            return None
        gesture = request.detection.gesture.replace("_", " ")
        return (
            f"not understood, most likely {gesture}: confidence "
            f"{request.confidence:.2f} is below {request.required:.2f}; do it again, "
            "more clearly"
        )

    def find_narrowness(self, touch: CommandedTouch) -> str | None:
        """Return that a grab is narrower than a hand, or None where it is not."""
        breadth, least = touch.breadth, self.config.min_breadth
        if breadth >= least:
            return None
        return (
            f"its touch was {1e3 * breadth:.0f} mm broad, as a strap may be; a grab "
            f"that makes the arm do more is {1e3 * least:.0f} mm broad or more: grab "
            "with the whole hand"
        )

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
                self.hold(refusal)
        if refusal is None:
            self.accepted += 1
            self.last_used[request.rule.key] = self.context.clock.now()
        source = f"{detection.gesture} on {detection.patch}"
        reason = source if refusal is None else refusal
        self.publish(request.action, refusal is None, reason, detection)

    def execute(self, request: CommandRequest) -> None:
        """Make the arm execute what is asked for."""
        arm, detection, rule = self.arm, request.detection, request.rule
        match request.action:
            case "resume":
                arm.release()
                arm.resume()
            case "jog":
                step = self.config.jog_step if rule.step is None else rule.step
                arm.jog(step * detection.direction_world)
            case "slow":
                arm.set_speed(self.config.slow_speed)
            case "normal":
                arm.set_speed(1.0)
            case "hold":
                arm.hold(f"{detection.gesture} on {detection.patch}")
                self.stopped_at = self.context.clock.now()
            case action if action == FUNCTION:
                call = FunctionCall(rule.function or "", arm, detection)
                if not call.has_returned(self.config.function_seconds):
                    self.call, self.held_for = call, call.problem
                    raise ArmError(call.problem)
            case action:
                getattr(arm, action)()

    def suspend_for(self, touch: CommandedTouch, reason: str) -> None:
        """Suspend the arm until a touch is decided, and publish why."""
        touch.suspends = True
        self.publish(SUSPEND, True, reason, touch=touch)

    def pause_for(self, touch: CommandedTouch, reason: str) -> None:
        """Pause the arm for a touch that was not recognised, and publish why."""
        self.arm.pause()
        self.accepted += 1
        touch.blocked = True
        self.publish("pause", True, reason, touch=touch)

    def hold(self, reason: str, touch: CommandedTouch | None = None) -> None:
        """Hold the arm and publish why, and for which touch."""
        self.arm.hold(reason)
        self.stopped_at = self.context.clock.now()
        self.publish("hold", True, reason, touch=touch)

    def publish(
        self,
        action: str,
        accepted: bool,
        reason: str,
        detection: Detection | None = None,
        touch: CommandedTouch | None = None,
    ) -> None:
        """Publish a decision to the other listeners.

        Args:
            action: plain action that it is about.
            accepted: whether the action was carried out.
            reason: why it was, or was not.
            detection: detection that led to it, if any.
            touch: touch that led to it, where no detection did.
        """
        number = onset = patch = gesture = None
        if detection is not None:
            number, gesture = detection.touch, detection.gesture
            onset, patch = detection.onset, detection.patch
        elif touch is not None:
            number, onset, patch = touch.id, touch.onset, touch.patch or None
        now = self.context.clock.now()
        self.context.publish(
            CommandEvent(now, action, number, gesture, accepted, reason, onset, patch)
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
        self.arm.limit_speed(1.0)
        if self.thread is not None:
            self.thread.join()
