"""From what is felt to what the arm does: the rules in between."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
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
from eskin.command.arm import Arm
from eskin.command.command_map import NON_GESTURES, CommandMap, Rule
from eskin.command.pending import CommandedTouches, PendingCommand, StopTimes
from eskin.command.skin_monitor import SkinMonitor, SkinMonitorConfig
from eskin.errors import ArmError, JogError
from eskin.live import Detection
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S

COMMANDED = "its touch has commanded already"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PolicyConfig:
    """How careful commands are."""

    watch: SkinMonitorConfig = field(default_factory=SkinMonitorConfig)
    """When the arm is held because of its skin."""

    pause_seconds: float = 1.0
    """How long a pause lasts at least [s]."""

    lifted_seconds: float = 0.1
    """How long nobody may have touched the skin before the arm is set in motion [s]."""

    patience: float = 2.0
    """How long after a detection it may still be obeyed: a touch that is to set the arm
    in motion may go on so long, and one that is not sure enough become so [s]."""

    slow: float = 0.3
    """Share of full speed when slow."""

    step: float = 0.05
    """How far a jog goes, where its rule says nothing [m]."""

    tick: float | None = 0.02
    """How often it is looked whether the skin is stale, though nothing comes [s]; None
    where `look` is called by others."""


@final
class Policy(Listener):
    """Hears detections and moments, commands an arm, and tells what it decided and why.

    What can make the arm do less needs little; what can start it needs much. Whatever
    goes wrong in here holds the arm. This is no certified safety function.

    Attributes:
        arm: what is commanded.
        accepted: how many commands of touches were obeyed.
        held: how often the arm was held.
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
        """Nothing is commanded before the stream starts.

        Args:
            arm: that is commanded; whoever opened it closes it.
            commands: what touch commands what.
            vocabulary: of the model, in the order of the probabilities.
            config: how careful it is.
        """
        self.arm = arm
        self.commands = commands
        self.vocabulary = vocabulary
        self.config = config or PolicyConfig()
        self.lock = RLock()
        self.accepted = self.held = 0
        self.spent = CommandedTouches()
        self.stops = StopTimes()
        self.rested: dict[object, int] = {}
        self.waiting: list[PendingCommand] = []
        self.failure: BaseException | None = None
        self.over = Flag()
        self.thread: Thread | None = None

    def start(self, context: Context) -> None:
        """Begin to watch.

        Raises:
            ArmError: the skin gives too few readings to be relied on.
        """
        oldest, rate = self.config.watch.oldest, context.info.rate
        if rate * oldest < 2:
            raise ArmError(
                f"the skin gives {rate:g} readings a second; allowed are {2 / oldest:g}"
                " or more, so that what is old is noticed; run it without an arm"
            )
        self.context = context
        self.watch = SkinMonitor(
            context.info.skin, self.config.watch, context.clock.now()
        )
        if self.config.tick is not None:
            self.thread = Thread(target=self.look_on, name="eskin watch", daemon=True)
            self.thread.start()

    def on_message(self, item: Message) -> None:
        """Take in a detection or a moment."""
        if self.failure is not None:
            raise self.failure
        self.guarded(lambda: self.take(item))

    def take(self, item: Message) -> None:
        """Do what a detection or a moment asks for."""
        if isinstance(item, Detection):
            self.watch.recognise(item)
            if item.gesture not in NON_GESTURES:
                self.decide(item)
            elif item.likeliest not in ("", *NON_GESTURES):
                self.decide_doubtful(item)
        elif isinstance(item, RecognitionState):
            self.watch.push(item)
            self.look()
            self.hold_if_unrecognised(item)
            self.stop_if_touched()
            for waiting in tuple(self.waiting):
                self.wait_on(waiting, item)
            self.spent.forget(item.state.closed)

    def look(self) -> None:
        """Hold the arm if its skin cannot be relied on."""
        with self.lock:
            now, state = self.context.clock.now(), self.arm.state()
            self.stops.look(state, now)
            trouble = self.watch.trouble(now)
            if trouble is not None:
                for waiting in tuple(self.waiting):
                    self.end(waiting, trouble)
                if state.hold_reason is None:
                    self.hold(trouble)

    def look_on(self) -> None:
        """Look again and again, though nothing may come."""
        while not self.over.wait(self.config.tick):
            try:
                self.guarded(self.look)
            except BaseException as error:
                logger.exception("the watch over the skin has failed")
                self.failure = error
                return

    def guarded(self, action: Callable[[], None]) -> None:
        """Do something; the arm is held where that fails."""
        try:
            with self.lock:
                action()
        except BaseException as error:
            self.arm.hold(f"the policy failed: {type(error).__name__}")
            raise

    def hold_if_unrecognised(self, moment: RecognitionState) -> None:
        """Hold a moving arm that is touched in a way that nobody understands."""
        why = self.watch.unrecognised(moment)
        if why is not None:
            state = self.arm.state()
            if state.moving and not state.stopped:
                self.hold(why)

    def stop_if_touched(self) -> None:
        """End a jog as soon as anybody touches the skin; the arm stays paused."""
        watch = self.watch
        if watch.touching == watch.heard and self.arm.state().jogging:
            self.pause()
            self.tell("pause", None, True, "touched while it jogs")

    def pause(self) -> None:
        """Pause the arm, from now on."""
        self.arm.pause()
        self.stops.pause(self.arm.state(), self.context.clock.now())

    def hold(self, why: str) -> None:
        """Hold the arm and tell."""
        self.arm.hold(why)
        self.stops.hold(self.context.clock.now())
        self.held += 1
        self.tell("hold", None, True, why)

    def decide(self, detection: Detection) -> None:
        """Obey a detection, or tell why not."""
        rule = self.commands.find_rule(
            detection.gesture, detection.link, detection.patch
        )
        if rule is None:
            self.tell("none", detection, False, "the map has no rule for it")
            return
        state = self.arm.state()
        action = resolve_action(rule.what, state)
        if action == "none":
            self.tell("none", detection, False, "the map says none")
            return
        why = self.objection(action, detection, rule, detection.stamp)
        if why is None and self.spent.has(detection.touch, detection.onset):
            why = COMMANDED
        needed = required_confidence(action, rule.confidence)
        if why is None and (
            action not in HALTING_ACTIONS or detection.confidence < needed
        ):
            self.spent.add(detection.touch, detection.onset)
            self.waiting.append(
                PendingCommand(
                    *(detection, rule, action, needed),
                    *(detection.confidence, detection.touch),
                )
            )
            return
        self.finish(action, detection, rule, why)

    def decide_doubtful(self, detection: Detection) -> None:
        """Halt the arm where an unknown touch most likely asks for it, nothing else."""
        gesture = detection.likeliest
        rule = self.commands.find_rule(gesture, detection.link, detection.patch)
        if (
            rule is not None
            and resolve_action(rule.what, self.arm.state()) in HALTING_ACTIONS
        ):
            self.decide(replace(detection, gesture=gesture))

    def objection(
        self, action: str, detection: Detection, rule: Rule, stamp: int
    ) -> str | None:
        """Why a touch must not command that, whatever its confidence; None: it may.

        Args:
            action: that it asks for.
            detection: what was said of it.
            rule: that it asks by.
            stamp: of the latest that is known of it [ns since the epoch].
        """
        now, state = self.context.clock.now(), self.arm.state()
        trouble = self.watch.trouble(now)
        age = self.context.age(stamp)
        rest = rule.cool_down if rule.cool_down is not None else COOL_DOWN
        rested = (now - self.rested.get(rule.place, -NS_PER_S * 3600)) / NS_PER_S
        if state.protective_stop:
            return "the arm is in protective stop"
        if not state.connected:
            return "the arm is not connected"
        if trouble is not None:
            return trouble
        if age > self.config.watch.oldest:
            return f"it was felt {1e3 * age:.0f} ms ago"
        if detection.patch in self.watch.out:
            return f"patch '{detection.patch}' is out"
        if rested < rest and action not in HALTING_ACTIONS:
            return f"the same was done {rested:.1f} s ago, it rests {rest:g} s"
        if state.hold_reason is not None and action not in (
            *REDUCING_ACTIONS,
            "resume",
        ):
            return f"the arm is held: {state.hold_reason}; pause it, then resume"
        if action == "jog" and not detection.direction_world.any():
            return "the touch did not travel"
        if action in STARTING_ACTIONS:
            if not state.paused:
                return "nobody has paused it"
            least = self.config.pause_seconds
            return self.stops.objection(detection.onset, now, least)
        return None

    def wait_on(self, waiting: PendingCommand, moment: RecognitionState) -> None:
        """Obey a touch once it is sure, and over if it sets the arm in motion."""
        before, detection = waiting.touch, waiting.detection
        waiting.follow(moment, self.vocabulary)
        stamp = moment.state.reading.stamp
        why = self.objection(waiting.action, detection, waiting.rule, stamp)
        if self.spent.joins(waiting.touch, before, moment.state.closed):
            why = COMMANDED
        meant = resolve_action(waiting.rule.what, self.arm.state())
        if (
            why is None
            and waiting.action not in HALTING_ACTIONS
            and meant != waiting.action
        ):
            why = f"the arm has changed: the same would {meant.replace('_', ' ')} now"
        lifted = self.watch.heard - self.watch.touching
        ended = lifted >= self.config.lifted_seconds * NS_PER_S
        ended = ended and self.watch.hears(detection.patch)
        late = self.context.age(detection.stamp) > self.config.patience
        if why is None and waiting.action in STARTING_ACTIONS and not ended:
            if late:
                self.end(waiting, "touching went on")
        elif why is not None or waiting.sure:
            self.end(waiting, why)
        elif late or waiting.closed:
            self.end(waiting, waiting.doubt)

    def end(self, waiting: PendingCommand, why: str | None) -> None:
        """Wait for a touch no longer; obey it where nothing is against it."""
        self.waiting.remove(waiting)
        self.finish(waiting.action, waiting.detection, waiting.rule, why)

    def finish(
        self, action: str, detection: Detection, rule: Rule, why: str | None
    ) -> None:
        """Do it where nothing is against it, and tell."""
        if why is None:
            try:
                self.do(action, detection, rule)
            except JogError as error:
                why = str(error)
            except ArmError as error:
                why = str(error)
                self.hold(why)
        if why is None:
            self.accepted += 1
            self.spent.add(detection.touch, detection.onset)
            self.rested[rule.place] = self.context.clock.now()
        reason = f"{detection.gesture} on {detection.patch}" if why is None else why
        self.tell(action, detection, why is None, reason)

    def do(self, action: str, detection: Detection, rule: Rule) -> None:
        """Make the arm do it."""
        arm = self.arm
        match action:
            case "pause":
                self.pause()
            case "resume":
                arm.release()
                arm.resume()
                self.stops.resume()
            case "jog":
                step = self.config.step if rule.step is None else rule.step
                arm.jog(step * detection.direction_world)
            case "slow":
                arm.set_speed(self.config.slow)
            case "normal":
                arm.set_speed(1.0)
            case "hold":
                arm.hold(f"{detection.gesture} on {detection.patch}")
                self.stops.hold(self.context.clock.now())
            case _ if action == FUNCTION:
                COMMAND_FUNCTIONS[rule.function or ""](arm, detection)
            case _:
                getattr(arm, action)()

    def tell(
        self, action: str, detection: Detection | None, accepted: bool, why: str
    ) -> None:
        """Tell the other listeners what was decided."""
        touch = None if detection is None else detection.touch
        gesture = None if detection is None else detection.gesture
        now = self.context.clock.now()
        self.context.publish(CommandEvent(now, action, touch, gesture, accepted, why))

    def close(self) -> None:
        """Hold the arm: nobody listens to the skin any more."""
        self.over.set()
        self.arm.hold("the stream has ended")
        if self.thread is not None:
            self.thread.join()
