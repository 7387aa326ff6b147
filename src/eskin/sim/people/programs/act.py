"""What a program knows and what it draws."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.contact.press import Flesh, Press, Stamps
from eskin.sim.people.person import Person
from eskin.sim.people.series import (
    Series,
    bell,
    steps_of,
    trapezoid,
    tremor,
    wander,
)
from eskin.sim.site.site import Site

Regime = Literal["paper", "cost"]


@dataclass(frozen=True, eq=False)
class Act:
    """One touch while it is drawn up."""

    kind: str
    """Way of doing the gesture."""
    person: Person
    """Who touches."""
    site: Site
    """Where."""
    constants: Constants
    """Numbers of the world."""
    rng: np.random.Generator
    """To draw from."""
    difficulty: float
    """Lambda: how much touches vary and overlap."""
    regime: Regime
    """Whether touches last as in arXiv 2506.18256 or in Jung et al. 2017."""
    drawn: dict[str, float | str] = field(default_factory=dict)
    """What was drawn so far, by name."""
    asked: dict[str, float] = field(default_factory=dict)
    """What is as it was asked for, whatever is drawn, by name."""

    @property
    def step(self) -> float:
        """Time between two values [s]."""
        return self.constants.value("time.step")

    def note(self, name: str, value: float) -> float:
        """Write down what was drawn or asked for; a name taken gets a number."""
        value = float(self.asked.get(name, value))
        self.drawn[self.free(name)] = value
        return value

    def free(self, name: str) -> str:
        """A name under which nothing is written down yet."""
        taken = sum(key == name or key.startswith(f"{name}#") for key in self.drawn)
        return f"{name}#{taken + 1}" if taken else name

    def draw(self, name: str, widen: float = 1.0) -> float:
        """Draw a constant and write it down."""
        return self.note(name, self.constants.draw(name, self.rng, widen))

    def choose(self, name: str) -> str:
        """Draw one of a constant's names, by the person's taste if they have one."""
        chosen = pick(name, self.person, self.constants, self.rng, self.difficulty)
        self.drawn[self.free(name)] = chosen
        return chosen

    def happens(self, name: str, chance: float) -> bool:
        """Draw whether something happens, and write it down."""
        return bool(self.note(name, float(self.rng.random() < chance)))

    def steps(self, duration: float) -> int:
        """Length of the series of a touch."""
        return steps_of(duration, self.step)

    def stamps(self, group: str) -> Stamps:
        """Parts of the person's hand, fingers as close as it happens."""
        return self.person.part(group, self.draw("hand.splay"))

    def flesh(self) -> Flesh:
        """How the person's hand gives way this time."""
        limits = self.constants.entry("person.conformity").spread
        assert limits is not None
        deviation = self.constants.value("person.conformity_repeat")
        own = self.person.flesh.conformity
        drawn = own + deviation * (1 + self.difficulty) * self.rng.normal()
        conformity = float(np.clip(drawn, limits.low, limits.high))
        return replace(
            self.person.flesh, conformity=self.note("conformity", conformity)
        )

    def turn(self) -> float:
        """Angle of the hand on the chart [rad]."""
        return self.note("angle", self.site.angle + self.draw("hand.turn"))

    def wander(self, steps: int) -> Float[np.ndarray, "time 2"]:
        """Slow wandering of what a person holds in place, from (0, 0) [m].

        One law for every contact, gestures and others alike: what a hand does must not
        be told by how still it is.
        """
        size = self.draw("hand.wander")
        band = self.band("hand.wander_band")
        axes = [self.tones(band, steps) for _ in "st"]
        path = size * np.column_stack(axes)
        return path - path[0]

    def push(self, steps: int) -> Series:
        """Force of one push through time, largest value 1; one law for all pushes."""
        if self.choose("push.shape") == "bell":
            return bell(steps, self.constants.value("force.bell"))
        smooth = round(self.constants.value("force.smooth") / self.step / 2)
        return trapezoid(steps, self.draw("push.rise"), self.draw("push.fall"), smooth)

    def rippled(self, steps: int) -> Series:
        """How the force of what slides comes and goes, around 1."""
        rate, depth = self.draw("slide.ripple_rate"), self.draw("slide.ripple")
        return 1 + depth * tremor(steps, self.step, rate, self.rng)

    def held(self, steps: int) -> Series:
        """The noise of a force that a hand holds, around 1."""
        fast = tremor(steps, self.step, self.draw("force.tremor_rate"), self.rng)
        noise = self.slow("force.noise_band", steps)
        return np.clip(1 + noise + self.draw("force.tremor") * fast, 0.0, None)

    def leant(self, steps: int) -> Series:
        """The noise of a force that a body leans with, around 1: no hand trembles."""
        return np.clip(1 + self.slow("none.lean.sway_band", steps), 0.0, None)

    def slow(self, name: str, steps: int) -> Series:
        """The slow noise of a force, in a band of frequencies, around 0."""
        return self.draw("force.noise") * self.tones(self.band(name), steps)

    def band(self, name: str) -> tuple[float, float]:
        """Lowest and highest frequency of a constant [Hz]."""
        low, high = self.constants.array(name)
        return low, high

    def tones(self, band: tuple[float, float], steps: int) -> Series:
        """Slow noise with mean square 1, equal power in each octave of a band."""
        count = int(self.constants.value("force.noise_tones"))
        return wander(steps, self.step, band, count, self.rng)

    def press(
        self,
        stamps: Stamps,
        flesh: Flesh,
        force: Series,
        path: Float[np.ndarray, "time 2"],
        angle: float | Series,
    ) -> Press:
        """A press at the site, `path` away from its centre."""
        turned = np.broadcast_to(np.asarray(angle, dtype=np.float64), force.shape)
        centre = np.asarray(self.site.centre) + path
        return Press(self.site.chart, 0, stamps, flesh, force, centre, turned.copy())


def pick(
    name: str,
    person: Person,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
) -> str:
    """Draw one of a constant's names; rarer ones the more difficult it is."""
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
