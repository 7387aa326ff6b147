"""A gesture sample draws everything that varies in one touch.

A constant gives the law over the whole population. A person's own scale and the repeats
of one person are part of it; the rest is how a person does that one gesture.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants, Distribution
from eskin.sim.contact.press import ContactPads, ContactSite, Press, SoftTissue
from eskin.sim.people.person import Person

Series = Float[np.ndarray, "time"]


def count_steps(duration: float, step: float) -> int:
    """Return the length of a series of some duration [s], both ends counted.

    It is at least 3.
    """
    return max(3, round(duration / step) + 1)


def build_bell(steps: int, exponent: float) -> Series:
    """Build a series that rises and falls as sin(pi x) to a power, largest value 1."""
    shape = np.sin(np.linspace(0, np.pi, steps)) ** exponent
    return pin_ends(shape / shape.max())


def build_trapezoid(steps: int, rise: float, fall: float, smooth: int) -> Series:
    """Build a series that rises, holds and falls, largest value 1.

    It rises and falls in shares of its length; corners are rounded over `smooth` steps
    to either side.
    """
    x = np.linspace(0, 1, steps)
    shape = np.interp(x, [0, rise, max(rise, 1 - fall), 1], [0.0, 1.0, 1.0, 0.0])
    kernel = np.hanning(2 * smooth + 3)[1:-1]
    if len(kernel) > steps:
        return pin_ends(shape / shape.max())
    shape = pin_ends(np.convolve(shape, kernel / kernel.sum(), mode="same"))
    return shape / shape.max()


def pin_ends(shape: Series) -> Series:
    """Set both ends of a series to exactly zero."""
    shape = np.clip(shape, 0.0, None)
    shape[[0, -1]] = 0.0
    return shape


def scale_to_peak(shape: Series, force: float) -> Series:
    """Scale a series to a largest value of `force`."""
    return shape * (force / shape.max())


def build_minimum_jerk(steps: int) -> Series:
    """Build the smoothest way from 0 to 1 (Flash and Hogan 1985)."""
    x = np.linspace(0, 1, steps)
    return x**3 * (10 - 15 * x + 6 * x**2)


def draw_slow_noise(
    steps: int,
    step: float,
    band: tuple[float, float],
    tones: int,
    rng: np.random.Generator,
) -> Series:
    """Draw slow noise with mean square 1 and equal power in each octave, as 1/f.

    `band` is the lowest and highest frequency [Hz], `step` the time between two values
    [s], `tones` the number of sines.
    """
    rates = np.geomspace(*band, tones)
    phases = rng.uniform(0, 2 * np.pi, tones)
    times = np.arange(steps) * step
    waves = np.sin(2 * np.pi * rates[:, None] * times + phases[:, None])
    return waves.sum(axis=0) * np.sqrt(2 / tones)


def draw_tremor(
    steps: int, step: float, rate: float, rng: np.random.Generator
) -> Series:
    """Draw a sine of amplitude 1 and frequency `rate` [Hz], with a random phase."""
    return np.sin(2 * np.pi * (rate * np.arange(steps) * step + rng.random()))


Regime = Literal["paper", "cost"]


@dataclass(frozen=True, eq=False)
class GestureSample:
    """A gesture sample draws one touch and records what it drew."""

    kind: str
    """Variant of the gesture."""
    person: Person
    """Person who touches."""
    site: ContactSite
    """Site of the touch."""
    constants: Constants
    """Constants of the simulation."""
    rng: np.random.Generator
    """Random generator."""
    difficulty: float
    """Lambda: how much touches vary and overlap."""
    regime: Regime
    """Law of durations: as in arXiv 2506.18256 or as in Jung et al. 2017."""
    drawn: dict[str, float | str] = field(default_factory=dict)
    """Values that were drawn so far, by name."""
    requested: dict[str, float] = field(default_factory=dict)
    """Values that replace the drawn ones, by name."""

    @property
    def step(self) -> float:
        """Return the time between two values [s]."""
        return self.constants.value("time.step")

    def record(self, name: str, value: float) -> float:
        """Record a value, or the one requested instead, and return it."""
        value = float(self.requested.get(name, value))
        self.drawn[self.find_free_name(name)] = value
        return value

    def find_free_name(self, name: str) -> str:
        """Return a name that is not recorded yet, with a number if it is in use."""
        taken = sum(key == name or key.startswith(f"{name}#") for key in self.drawn)
        return f"{name}#{taken + 1}" if taken else name

    def draw(self, name: str, widen: float = 1.0) -> float:
        """Draw a constant and record it."""
        return self.record(name, self.constants.draw(name, self.rng, widen))

    def choose(self, name: str) -> str:
        """Draw one of a constant's names, by the person's own weights if any."""
        chosen = choose_style(
            name, self.person, self.constants, self.rng, self.difficulty
        )
        self.drawn[self.find_free_name(name)] = chosen
        return chosen

    def draw_event(self, name: str, chance: float) -> bool:
        """Draw whether something happens, and record it."""
        return bool(self.record(name, float(self.rng.random() < chance)))

    def count_steps(self, duration: float) -> int:
        """Return the length of the series of a touch of some duration [s]."""
        return count_steps(duration, self.step)

    def draw_pads(self, group: str) -> ContactPads:
        """Draw pads of the person's hand, with a random splay of the fingers."""
        return self.person.select_pads(group, self.draw("hand.splay"))

    def draw_tissue(self) -> SoftTissue:
        """Draw how the person's hand gives way this time."""
        limits = self.constants.get_constant("person.conformity").spread
        assert limits is not None
        deviation = self.constants.value("person.conformity_repeat")
        own = self.person.tissue.conformity
        drawn = own + deviation * (1 + self.difficulty) * self.rng.normal()
        conformity = float(np.clip(drawn, limits.low, limits.high))
        return replace(
            self.person.tissue, conformity=self.record("conformity", conformity)
        )

    def draw_angle(self) -> float:
        """Draw the angle of the hand on the chart [rad]."""
        return self.record("angle", self.site.angle + self.draw("hand.turn"))

    def draw_wander(self, steps: int) -> Float[np.ndarray, "time 2"]:
        """Draw how a body wanders that a person holds in place, from (0, 0) [m].

        One law holds for every contact, gestures and others alike: how still a hand is
        must not tell what it does.
        """
        size = self.draw("hand.wander")
        band = self.get_band("hand.wander_band")
        axes = [self.draw_tones(band, steps) for _ in "st"]
        path = size * np.column_stack(axes)
        return path - path[0]

    def draw_push(self, steps: int) -> Series:
        """Draw the force of one push through time, largest value 1.

        All pushes share the law.
        """
        if self.choose("push.shape") == "bell":
            return build_bell(steps, self.constants.value("force.bell"))
        smooth = round(self.constants.value("force.smooth") / self.step / 2)
        return build_trapezoid(
            steps, self.draw("push.rise"), self.draw("push.fall"), smooth
        )

    def draw_ripple(self, steps: int) -> Series:
        """Draw how the force of a sliding body varies, around 1."""
        rate = self.draw("slide.ripple_rate")
        depth = self.draw("slide.ripple")
        return 1 + depth * draw_tremor(steps, self.step, rate, self.rng)

    def draw_held_noise(self, steps: int) -> Series:
        """Draw the noise of a force that a hand holds, around 1."""
        fast = draw_tremor(steps, self.step, self.draw("force.tremor_rate"), self.rng)
        noise = self.draw_slow_force("force.noise_band", steps)
        return np.clip(1 + noise + self.draw("force.tremor") * fast, 0.0, None)

    def draw_leaning_noise(self, steps: int) -> Series:
        """Draw the noise of a force that a body leans with, around 1: no tremor."""
        return np.clip(
            1 + self.draw_slow_force("none.lean.sway_band", steps), 0.0, None
        )

    def draw_slow_force(self, name: str, steps: int) -> Series:
        """Draw the slow noise of a force in a band of frequencies, around 0."""
        return self.draw("force.noise") * self.draw_tones(self.get_band(name), steps)

    def get_band(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest frequency of a constant [Hz]."""
        low, high = self.constants.array(name)
        return low, high

    def draw_tones(self, band: tuple[float, float], steps: int) -> Series:
        """Draw slow noise with mean square 1, equal power in each octave of a band."""
        count = int(self.constants.value("force.noise_tones"))
        return draw_slow_noise(steps, self.step, band, count, self.rng)

    def build_press(
        self,
        pads: ContactPads,
        force: Series,
        path: Float[np.ndarray, "time 2"] | None = None,
        tissue: SoftTissue | None = None,
        angle: float | Series | None = None,
    ) -> Press:
        """Build a press at the site, `path` away from its centre.

        A hand that stays in place, its tissue and its angle are drawn unless given.
        """
        tissue = tissue or self.draw_tissue()
        path = self.draw_wander(len(force)) if path is None else path
        angle = self.draw_angle() if angle is None else angle
        turned = np.broadcast_to(np.asarray(angle, dtype=np.float64), force.shape)
        centre = np.asarray(self.site.centre) + path
        return Press(self.site.chart, 0, force, centre, turned.copy(), pads, tissue)


def choose_style(
    name: str,
    person: Person,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
) -> str:
    """Draw one of a constant's names; rare ones more often at a higher difficulty."""
    usual = constants.weights(name)
    weights = person.styles.get(name, usual)
    rare = min(
        constants.value("difficulty.rare") * difficulty,
        constants.value("difficulty.most"),
    )
    common = max(usual, key=lambda key: usual[key])
    if name not in person.styles or rng.random() >= rare:
        return str(rng.choice(list(weights), p=list(weights.values())))
    return str(rng.choice([key for key in usual if key != common]))


AMOUNT_TRIES = 30
"""Draws after which a number outside its limits is clipped."""


def draw_force(
    sample: GestureSample,
    name: str,
    gesture: str,
    max_amount: float = np.inf,
    firmer: float = 1.0,
) -> float:
    """Draw the largest force of a touch [N]; difficulty widens the law.

    The habit of `gesture` applies, or is drawn anew where it is no habit. `max_amount`
    is the upper limit [N]; `firmer` multiplies the force.
    """
    habit = sample.person.firmness.get(gesture)
    usual = sample.constants.value("force.repeat")
    repeat = np.log(
        usual + sample.constants.value("force.repeat_growth") * sample.difficulty
    )
    scale = sample.person.force_scale
    rest = compute_remaining_deviation(
        sample.constants, name, "person.force_scale", np.log(usual)
    )
    return sample.record(
        "force",
        firmer * draw_amount(sample, name, scale, rest, repeat, habit, max_amount),
    )


def draw_duration(
    sample: GestureSample, gesture: str, habit: str | None = None
) -> float:
    """Draw the duration of a touch [s].

    Difficulty moves spread from between people to within them and leaves the law over
    the population as published.
    """
    name = f"duration.{sample.regime}.{gesture}"
    pace = sample.person.pace.get(habit or gesture)
    repeat = np.log(
        sample.constants.value("duration.repeat")
        + sample.constants.value("duration.repeat_growth") * sample.difficulty
    )
    scale = sample.person.tempo_scale
    rest = compute_remaining_deviation(
        sample.constants, name, "person.tempo_scale", repeat
    )
    return sample.record(
        "duration", draw_amount(sample, name, scale, rest, repeat, pace, np.inf)
    )


def draw_amount(
    sample: GestureSample,
    name: str,
    scale: float,
    rest: float,
    repeat: float,
    habit: float | None,
    max_amount: float,
) -> float:
    """Draw median x person x habit x repeat, within the law's limits."""
    law = get_lognormal(sample.constants, name)
    own = sample.rng.normal() if habit is None else habit
    middle = (law.median or 0.0) * scale * np.exp(rest * own)
    middle *= sample.constants.factors.get(name, 1.0)
    high = min(law.high, max_amount)
    number = middle
    for _ in range(AMOUNT_TRIES):
        number = float(middle * np.exp(repeat * sample.rng.normal()))
        if law.low <= number <= high:
            return number
    return float(np.clip(number, min(law.low, high), high))


def compute_remaining_deviation(
    constants: Constants, name: str, person: str, repeat: float
) -> float:
    """Return the log deviation of a law that person and repeats leave."""
    total = np.log(get_lognormal(constants, name).gsd or 1.0)
    own = np.log(get_lognormal(constants, person).gsd or 1.0)
    return float(np.sqrt(max(total**2 - own**2 - repeat**2, 0.0)))


def get_lognormal(constants: Constants, name: str) -> Distribution:
    """Return the law of a constant, which must be lognormal."""
    spread = constants.get_constant(name).spread
    if spread is None or spread.law != "lognormal":
        raise ValueError(f"constant '{name}' must have a lognormal law")
    return spread
