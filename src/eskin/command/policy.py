"""This module decides which touches command the arm, and holds it on trouble."""

import logging
from collections.abc import Callable
from dataclasses import replace
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

from eskin.command.actions import (
    COMMAND_FUNCTIONS,
    COOL_DOWN,
    FUNCTION,
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    required_confidence,
    resolve_action,
)
from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import NON_GESTURES, CommandMap, Rule
from eskin.command.evidence import EvidenceMonitor
from eskin.command.pending import (
    CommandedTouches,
    PendingCommand,
    StopTimes,
    describe_doubt,
)
from eskin.command.policy_config import PolicyConfig
from eskin.command.possible_stops import PossibleStops, StopRules
from eskin.command.skin_monitor import SkinMonitor
from eskin.errors import ArmError, JogError
from eskin.live import UNKNOWN, Detection
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S

ALREADY_COMMANDED = "its touch has commanded already; lift the hand before the next"
UNSOUND = (
    "too few sound taxels felt it, or too briefly: it may be a fault of the skin; "
    "touch more firmly"
)
REMEDY = "see to its cable or its cover; it goes on being felt elsewhere"
GOES_ON = "touching went on for too long; let go, then ask again"
TOUCHED_AGAIN = "the skin was touched again meanwhile; let go, then ask again"
WAIT = "wait"
"""Action of events that tell that the arm stands until a touch is recognised."""
logger = logging.getLogger(__name__)


@final
class Policy(Listener):
    """A policy turns detections into commands of an arm, and publishes each decision.

    What can make the arm do less needs little; what can start it needs much. A moving
    arm stands while a touch may be a stop, and goes on once it is recognised as
    something else. Whatever fails in here holds the arm. This is no certified safety
    function.

    Attributes:
        arm: the arm that is commanded.
        accepted: number of commands of touches that were executed.
        held: how often the policy held the arm.
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
        self.accepted = self.held = 0
        self.commanded = CommandedTouches()
        self.stop_times = StopTimes()
        self.last_used: dict[object, int] = {}
        self.pending: list[PendingCommand] = []
        self.slowed: str | None = None
        self.slowed_at = 0
        self.held_for: str | None = None
        self.over: str | None = None
        self.failure: BaseException | None = None
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
                f"the skin gives {rate:g} readings a second; allowed are "
                f"{2 / max_age:g} or more, so that what is old is noticed; run it "
                "without an arm"
            )
        self.context = context
        now = context.clock.now()
        self.monitor = SkinMonitor(context.info.skin, self.config.monitor, now)
        self.evidence = EvidenceMonitor(context.info.skin, self.config.evidence)
        rules = StopRules.build(self.commands, self.vocabulary, context.info.skin)
        self.possible_stops = PossibleStops(rules)
        if self.config.check_period is not None:
            self.thread = Thread(target=self.run, name="eskin watch", daemon=True)
            self.thread.start()

    def on_message(self, item: Message) -> None:
        """Handle a detection or a recognition state."""
        if self.failure is not None:
            raise self.failure
        self.hold_on_error(lambda: self.handle(item))

    def handle(self, item: Message) -> None:
        """Execute what a detection or a recognition state asks for."""
        if isinstance(item, Detection):
            self.monitor.add_detection(item)
            if item.gesture not in NON_GESTURES:
                self.decide(item)
            elif item.gesture == UNKNOWN:
                self.decide_unknown(item)
            self.possible_stops.add_detection(item)
        elif isinstance(item, RecognitionState):
            self.monitor.update(item)
            self.evidence.update(item)
            self.hold_if_unreliable()
            self.stop_if_unrecognised(item)
            self.pause_if_touched()
            self.update_possible_stops(item)
            for pending in tuple(self.pending):
                self.update_pending(pending, item)
            self.commanded.forget(item.state.closed)
            self.update_limit()

    def check_skin(self) -> None:
        """Hold or slow the arm if its skin cannot be relied on."""
        with self.lock:
            self.hold_if_unreliable()
            self.update_limit()

    def hold_if_unreliable(self) -> None:
        """Hold the arm if its skin cannot be relied on; publish when it can again."""
        now, state = self.context.clock.now(), self.arm.state()
        self.stop_times.update(state, now)
        problem = self.monitor.find_problem(now)
        if problem is not None:
            for pending in tuple(self.pending):
                self.complete_pending(pending, f"{problem}; {REMEDY}")
            if state.hold_reason is None:
                self.hold(problem)
                self.held_for = problem
            self.over = None
        elif state.hold_reason is None:
            self.held_for = self.over = None
        elif self.held_for is not None and self.over is None:
            self.over = f"no longer {self.held_for}"
            way = self.describe_way(state)
            self.publish("resume", False, f"{self.over}; {way}")

    def update_limit(self) -> None:
        """Let the arm stand, go slowly or at its speed, and publish a change of it."""
        now, state = self.context.clock.now(), self.arm.state()
        if not state.stopped:
            self.update_slowing(now)
        limit = 1.0 if self.slowed is None else self.config.slow_speed
        if self.possible_stops.waiting or self.monitor.is_hand_lost(now):
            limit = 0.0
        if state.speed_limit != limit:
            self.arm.limit_speed(limit)

    def update_slowing(self, now: int) -> None:
        """Slow the arm where the skin asks for it, and no longer once that is over."""
        reason = self.monitor.find_slowing(now)
        clear = now - self.slowed_at > self.config.monitor.clear_seconds * NS_PER_S
        if reason is not None:
            if self.slowed is None:
                self.publish("slow", True, f"{reason}; {REMEDY}")
            self.slowed, self.slowed_at = reason, now
        elif self.slowed is not None and clear:
            self.publish("normal", True, f"no longer {self.slowed}")
            self.slowed = None

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
            with self.lock:
                action()
        except BaseException as error:
            self.arm.hold(f"the policy failed: {type(error).__name__}")
            raise

    def stop_if_unrecognised(self, recognition: RecognitionState) -> None:
        """Stop an arm at work under a strong or long touch that was not recognised.

        A strong one holds it, also where it only stands for another touch. Under a long
        one it stands until the touch has ended, and if that takes too long, it is
        paused.
        """
        found = self.monitor.find_unrecognised(recognition)
        state, waiting = self.arm.state(), self.possible_stops.waiting
        is_working = state.moving or waiting or state.speed_limit == 0.0
        if found is None or state.stopped or not is_working:
            return
        if found.effect == "hold":
            self.hold(found.reason, found.touch)
        elif found.effect == "pause":
            self.pause_for(found.touch, found.reason)
        elif found.touch not in waiting:
            waiting.add(found.touch)
            reason = f"{found.reason}; the arm stands until it has ended"
            self.publish(WAIT, True, reason, touch=found.touch)

    def update_possible_stops(self, recognition: RecognitionState) -> None:
        """Let a moving arm stand while a touch may be a stop; pause it at its end."""
        stops, state = self.possible_stops, self.arm.state()
        if state.stopped:
            stops.waiting.clear()
        works = not state.stopped and not state.jogging
        for touch, chance in stops.update(recognition, works):
            reason = (
                f"it may be a stop ({chance:.2f}); the arm stands until it is clear"
            )
            self.publish(WAIT, True, reason, touch=touch)
        for touch in stops.ended:
            self.pause_for(touch, "not understood: the touch may have been a stop")

    def pause_for(self, touch: int, reason: str) -> None:
        """Pause the arm for a touch that was not recognised, and publish why."""
        self.pause()
        self.accepted += 1
        self.commanded.block(touch)
        self.publish("pause", True, reason, touch=touch)

    def pause_if_touched(self) -> None:
        """End a jog as soon as anybody touches the skin; the arm stays paused."""
        monitor = self.monitor
        if monitor.last_contact == monitor.latest and self.arm.state().jogging:
            self.pause()
            self.publish("pause", True, "touched while it jogs")

    def pause(self) -> None:
        """Pause the arm from now on."""
        self.arm.pause()
        self.stop_times.pause(self.arm.state(), self.context.clock.now())

    def hold(self, reason: str, touch: int | None = None) -> None:
        """Hold the arm and publish why, and for which touch."""
        self.arm.hold(reason)
        self.stop_times.hold(self.context.clock.now())
        self.held += 1
        self.publish("hold", True, reason, touch=touch)

    def decide(self, detection: Detection) -> None:
        """Execute a detection's action now or later, or publish why not."""
        rule = self.commands.find_rule(
            detection.gesture, detection.link, detection.patch, detection.heading
        )
        if rule is None:
            self.publish("none", False, "the map has no rule for it", detection)
            return
        state = self.arm.state()
        action = resolve_action(rule.action_or_function, state)
        if action == "none":
            self.publish("none", False, "the map says none", detection)
            return
        refusal = self.find_refusal(action, detection, rule, detection.stamp)
        if refusal is None and self.commanded.contains(
            detection.touch, detection.onset
        ):
            refusal = ALREADY_COMMANDED
        required = required_confidence(action, rule.confidence)
        doubtful = detection.confidence < required
        if refusal is None:
            self.commanded.add(detection.touch, detection.onset)
        if refusal is None and (action not in HALTING_ACTIONS or doubtful):
            pending = PendingCommand(
                detection=detection,
                rule=rule,
                action=action,
                required=required,
                confidence=detection.confidence,
                touch=detection.touch,
                end=detection.end,
            )
            self.pending.append(pending)
            return
        self.complete(action, detection, rule, refusal)

    def decide_unknown(self, detection: Detection) -> None:
        """Stop or slow the arm if an unknown touch may ask for it; do nothing else."""
        gesture = detection.likeliest
        chance = self.possible_stops.find_chance(detection)
        known = gesture not in ("", *NON_GESTURES)
        said = f", most likely {gesture} ({detection.confidence:.2f})" if known else ""
        if chance is not None and not self.arm.state().paused:
            refusal = self.find_refusal("pause", detection, None, detection.stamp)
            if self.commanded.contains(detection.touch, detection.onset):
                refusal = ALREADY_COMMANDED
            if refusal is None:
                reason = f"not understood{said}: it may be a stop ({chance:.2f})"
                self.pause_for(detection.touch, reason)
            else:
                self.publish("pause", False, refusal, detection)
        elif known and self.is_slowing(likely := replace(detection, gesture=gesture)):
            self.decide(likely)
        elif known:
            reason = f"not understood{said}; do it again, more clearly"
            self.publish("none", False, reason, detection)

    def is_slowing(self, detection: Detection) -> bool:
        """Return whether a gesture slows the arm and is likely enough for that."""
        rule = self.commands.find_rule(
            detection.gesture, detection.link, detection.patch, detection.heading
        )
        if rule is None:
            return False
        action = resolve_action(rule.action_or_function, self.arm.state())
        if action != "slow":
            return False
        return detection.confidence >= required_confidence(action, rule.confidence)

    def find_refusal(
        self, action: str, detection: Detection, rule: Rule | None, stamp: int
    ) -> str | None:
        """Return why a touch must not command an action, or None where it may.

        Its confidence is not considered. The reason is the one that holds now, and says
        what to do.

        Args:
            action: plain action that it asks for.
            detection: detection of the touch.
            rule: rule that maps the detection to the action; None for a stop that no
                rule asks for.
            stamp: time of the latest reading of the touch [ns since the epoch].
        """
        now, state = self.context.clock.now(), self.arm.state()
        age = self.context.age(stamp)
        if state.protective_stop:
            return "the arm is in protective stop; unlock it at the robot"
        if not state.connected:
            return "the arm is not connected; see to its cable and its controller"
        if age > self.config.monitor.max_age:
            return f"it was felt {1e3 * age:.0f} ms ago; touch again"
        if action in HALTING_ACTIONS:
            return None
        problem = self.monitor.find_problem(now)
        if problem is not None:
            return f"{problem}; {REMEDY}"
        if self.monitor.is_out(detection.patch, now):
            return f"patch '{detection.patch}' is out; touch elsewhere"
        rested = self.find_rest(rule, now)
        if rested is not None:
            return rested
        if state.hold_reason is not None and action not in (
            *REDUCING_ACTIONS,
            "resume",
        ):
            reason = self.over or state.hold_reason
            return f"the arm is held: {reason}; {self.describe_way(state)}"
        if action == "jog" and not detection.direction_world.any():
            return "the touch did not travel; stroke farther"
        if action in STARTING_ACTIONS:
            if not state.paused:
                return f"nobody has paused it; {self.describe_way(state)}"
            min_pause = self.config.min_pause
            return self.stop_times.find_refusal(detection.onset, now, min_pause)
        return None

    def find_rest(self, rule: Rule | None, now: int) -> str | None:
        """Return why a rule rests at a time, or None where it does not."""
        if rule is None or rule.key not in self.last_used:
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
        least = f"{self.config.min_pause:g} s later"
        if state.paused:
            return f"to go on: {goes or 'resume it in the program'}"
        if not (stops and goes):
            return "to go on: release it in the program"
        return f"to go on: {stops}, then {goes} at least {least}"

    def update_pending(
        self, pending: PendingCommand, recognition: RecognitionState
    ) -> None:
        """Execute a pending command once it may be, or drop it where it must not."""
        before, detection = pending.touch, pending.detection
        pending.update(recognition, self.vocabulary)
        refusal = self.find_pending_refusal(pending, before, recognition)
        doubt = self.find_doubt(pending)
        late = self.context.age(detection.stamp) > self.config.max_delay
        if refusal is None and not self.has_ended(pending):
            if self.goes_on(pending):
                self.complete_pending(pending, GOES_ON)
        elif refusal is not None or doubt is None:
            self.complete_pending(pending, refusal)
        elif late or pending.closed:
            self.complete_pending(pending, doubt)

    def find_pending_refusal(
        self, pending: PendingCommand, before: int, recognition: RecognitionState
    ) -> str | None:
        """Return why a pending command must not be executed, or None where it may.

        Args:
            pending: the command, updated by the recognition state.
            before: id of its touch until then.
            recognition: the latest recognition state.
        """
        state, action = recognition.state, pending.action
        if self.commanded.merges(pending.touch, before, state.closed):
            return ALREADY_COMMANDED
        refusal = self.find_refusal(
            action, pending.detection, pending.rule, state.reading.stamp
        )
        if refusal is not None or action in HALTING_ACTIONS:
            return refusal
        meant = resolve_action(pending.rule.action_or_function, self.arm.state())
        if meant != action:
            meant = meant.replace("_", " ")
            return f"the arm has changed: the same would {meant} now"
        if action not in STARTING_ACTIONS:
            return None
        begun = self.monitor.find_latest_onset(pending.touch)
        again = begun is not None and begun > pending.end
        return TOUCHED_AGAIN if again else None

    def has_ended(self, pending: PendingCommand) -> bool:
        """Return whether the skin was let go, as far as the action needs that."""
        monitor, action = self.monitor, pending.action
        if action in REDUCING_ACTIONS:
            return True
        release = self.config.min_release * NS_PER_S
        if action not in STARTING_ACTIONS:
            return monitor.latest - pending.end >= release
        untouched = monitor.latest - monitor.last_contact >= release
        alone = monitor.find_latest_onset(pending.touch) is None
        has_data = monitor.has_data(pending.detection.patch)
        return pending.closed and untouched and alone and has_data

    def goes_on(self, pending: PendingCommand) -> bool:
        """Return whether touching goes on for too long after a detection."""
        detected, latest = pending.detection.stamp, self.config.max_delay * NS_PER_S
        since = max(detected, pending.end)
        return max(pending.end - detected, self.monitor.latest - since) > latest

    def find_doubt(self, pending: PendingCommand) -> str | None:
        """Return why a touch may be no command after all, or None where it is one."""
        action, least = pending.action, self.config.min_duration
        if action not in HALTING_ACTIONS and not self.evidence.suffices(pending.touch):
            return UNSOUND
        if not pending.confident:
            return describe_doubt(pending)
        if action not in REDUCING_ACTIONS and pending.duration < least:
            return (
                f"its touch lasted {pending.duration:.2f} s, as a bump may; what makes "
                f"the arm do more lasts {least:g} s or longer: do it again, more slowly"
            )
        return None

    def complete_pending(self, pending: PendingCommand, refusal: str | None) -> None:
        """Remove a pending command; execute it unless it is refused."""
        self.pending.remove(pending)
        self.complete(pending.action, pending.detection, pending.rule, refusal)

    def complete(
        self, action: str, detection: Detection, rule: Rule, refusal: str | None
    ) -> None:
        """Execute an action unless it is refused, and publish the decision."""
        if refusal is None:
            try:
                self.execute(action, detection, rule)
            except JogError as error:
                refusal = str(error)
            except ArmError as error:
                refusal = str(error)
                self.hold(refusal)
        if refusal is None:
            self.accepted += 1
            self.last_used[rule.key] = self.context.clock.now()
        source = f"{detection.gesture} on {detection.patch}"
        reason = source if refusal is None else refusal
        self.publish(action, refusal is None, reason, detection)

    def execute(self, action: str, detection: Detection, rule: Rule) -> None:
        """Make the arm execute an action."""
        arm = self.arm
        match action:
            case "pause":
                self.pause()
            case "resume":
                arm.release()
                arm.resume()
                self.stop_times.resume()
            case "jog":
                step = self.config.jog_step if rule.step is None else rule.step
                arm.jog(step * detection.direction_world)
            case "slow":
                arm.set_speed(self.config.slow_speed)
            case "normal":
                arm.set_speed(1.0)
            case "hold":
                arm.hold(f"{detection.gesture} on {detection.patch}")
                self.stop_times.hold(self.context.clock.now())
            case _ if action == FUNCTION:
                COMMAND_FUNCTIONS[rule.function or ""](arm, detection)
            case _:
                getattr(arm, action)()

    def publish(
        self,
        action: str,
        accepted: bool,
        reason: str,
        detection: Detection | None = None,
        touch: int | None = None,
    ) -> None:
        """Publish a decision to the other listeners.

        Args:
            action: plain action that it is about.
            accepted: whether the action was carried out.
            reason: why it was, or was not.
            detection: detection that led to it, if any.
            touch: id of the touch that led to it, where no detection did.
        """
        onset, patch = self.monitor.find_touch(touch)
        gesture = None
        if detection is not None:
            touch, gesture = detection.touch, detection.gesture
            onset, patch = detection.onset, detection.patch
        now = self.context.clock.now()
        event = CommandEvent(
            now, action, touch, gesture, accepted, reason, onset, patch
        )
        self.context.publish(event)

    def close(self) -> None:
        """Hold the arm: nothing monitors the skin any more."""
        self.closing.set()
        self.arm.hold("the stream has ended")
        self.arm.limit_speed(1.0)
        if self.thread is not None:
            self.thread.join()
