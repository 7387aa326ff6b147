"""This module loads every number of the simulation, with its unit and its source.

`constants.yaml` holds them. A constant is a value, or a distribution to draw from; it
names its source, or says that it is an estimate and how far it may be off.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, final

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field, model_validator

CONSTANTS_FILE = Path(__file__).with_name("constants.yaml")

MM = 1e-3
"""Metres in a millimetre."""

RANGE_DEVIATION = 0.4
"""Standard deviation of a range, where its typical value is 0 and its ends are +-1."""

MAX_DRAWS = 1000
"""Draws after which a distribution counts as outside its own limits."""


class StrictModel(BaseModel):
    """A strict model refuses keys that it does not declare."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Distribution(StrictModel):
    """A distribution of one number is drawn again until it lies in `low` to `high`."""

    law: Literal["normal", "lognormal", "uniform", "range"]
    mean: float | None = None
    """Mean of a normal law."""
    sd: float | None = None
    """Standard deviation of a normal law."""
    median: float | None = None
    """Median of a lognormal law."""
    gsd: float | None = None
    """Geometric standard deviation of a lognormal law."""
    typical: float | None = None
    """Median of a range, whose ends are `low` and `high`."""
    low: float = -np.inf
    high: float = np.inf

    @model_validator(mode="after")
    def check_parameters(self) -> "Distribution":
        """Refuse a law that lacks its parameters."""
        needed = {
            "normal": (self.mean, self.sd),
            "lognormal": (self.median, self.gsd),
            "uniform": (self.low, self.high),
            "range": (self.low, self.typical, self.high),
        }[self.law]
        if any(part is None or not np.isfinite(part) for part in needed):
            raise ValueError(f"a {self.law} law lacks a parameter")
        if not self.low <= (self.typical or self.low) <= self.high:
            raise ValueError(f"typical is {self.typical}; allowed is low to high")
        return self


class Constant(StrictModel):
    """A constant is a number, a list of numbers, a distribution, or weights."""

    value: float | list[float] | None = None
    spread: Distribution | None = None
    weights: dict[str, float] | None = None
    unit: str
    """Unit, `1` where there is none."""
    source: str | None = None
    """Key of `sources`; None for an estimate."""
    estimate: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    """Factors by which an estimate may be too large or too small: [least, most]."""
    note: str = ""

    @model_validator(mode="after")
    def check_one_number(self) -> "Constant":
        """Refuse an entry without exactly one kind of number and one source."""
        kinds = (self.value, self.spread, self.weights)
        if sum(kind is not None for kind in kinds) != 1:
            raise ValueError("give exactly one of value, spread, weights")
        if (self.source is None) == (self.estimate is None):
            raise ValueError("give a source, or else estimate: [least, most] factors")
        return self


class ConstantsFile(StrictModel):
    """This model validates the whole file."""

    sources: dict[str, str]
    constants: dict[str, Constant]


@final
@dataclass(frozen=True, eq=False)
class Constants:
    """This class holds the constants of one simulation."""

    entries: dict[str, Constant]
    """Constants by name, such as `poke.force`."""
    sources: dict[str, str]
    """Citations by key."""
    factors: dict[str, float]
    """Factors on single constants, as in a sensitivity sweep."""

    def get_constant(self, name: str) -> Constant:
        """Return one constant.

        Raises:
            ValueError: there is none of that name.
        """
        if name not in self.entries:
            raise ValueError(f"no constant '{name}'; they are in {CONSTANTS_FILE.name}")
        return self.entries[name]

    def value(self, name: str) -> float:
        """Return a constant that is one number."""
        number = self.get_constant(name).value
        if not isinstance(number, float | int):
            raise ValueError(f"constant '{name}' is not one number; draw or list it")
        return float(number) * self.factors.get(name, 1.0)

    def array(self, name: str) -> Float[np.ndarray, "item"]:
        """Return a constant that is a list of numbers."""
        numbers = self.get_constant(name).value
        if not isinstance(numbers, list):
            raise ValueError(f"constant '{name}' is not a list of numbers")
        return np.array(numbers, dtype=np.float64) * self.factors.get(name, 1.0)

    def weights(self, name: str) -> dict[str, float]:
        """Return a constant that is a set of weights, scaled to sum to 1."""
        weights = self.get_constant(name).weights
        if weights is None:
            raise ValueError(f"constant '{name}' has no weights")
        total = sum(weights.values())
        return {key: weight / total for key, weight in weights.items()}

    def draw(self, name: str, rng: np.random.Generator, widen: float = 1.0) -> float:
        """Draw one number.

        `widen` multiplies the deviation of a normal law, or of the logarithm of a
        lognormal one; a uniform law does not widen.
        """
        spread = self.get_constant(name).spread
        if spread is None:
            raise ValueError(f"constant '{name}' is not drawn; take its value")
        number = draw_within(spread, rng, widen)
        return number * self.factors.get(name, 1.0)

    def at_level(self, name: str, level: Literal["low", "typical", "high"]) -> float:
        """Return an end of a range, or its typical value."""
        spread = self.get_constant(name).spread
        if spread is None or spread.law != "range":
            raise ValueError(f"constant '{name}' is not a range; take its value")
        number = getattr(spread, level)
        return float(number) * self.factors.get(name, 1.0)

    def choose(self, name: str, rng: np.random.Generator) -> str:
        """Draw one of the names of a set of weights."""
        weights = self.weights(name)
        return str(rng.choice(list(weights), p=list(weights.values())))

    def scaled(self, factors: dict[str, float]) -> "Constants":
        """Return constants of which some are multiplied, distributions as a whole.

        Raises:
            ValueError: a name is unknown.
        """
        for name in factors:
            self.get_constant(name)
        return Constants(self.entries, self.sources, self.factors | factors)


def draw_within(spread: Distribution, rng: np.random.Generator, widen: float) -> float:
    """Draw until the number lies within the limits."""
    for _ in range(MAX_DRAWS):
        number = draw_once(spread, rng, widen)
        if spread.low <= number <= spread.high:
            return number
    raise ValueError(f"{spread} hardly ever lies within its own limits")


def draw_once(spread: Distribution, rng: np.random.Generator, widen: float) -> float:
    """Draw from the law without its limits."""
    match spread.law:
        case "normal":
            return float(rng.normal(spread.mean or 0.0, (spread.sd or 0.0) * widen))
        case "lognormal":
            sigma = np.log(spread.gsd or 1.0) * widen
            return float((spread.median or 0.0) * np.exp(sigma * rng.normal()))
        case "range":
            return place_in_range(spread, RANGE_DEVIATION * widen * rng.normal())
        case _:
            return float(rng.uniform(spread.low, spread.high))


def place_in_range(spread: Distribution, place: float) -> float:
    """Return the number at a place of a range: its ends at -1 and 1, typical at 0.

    Between two positive numbers the logarithm grows evenly. To or from zero the number
    grows with the cube, so that it is near the typical one for most places.
    """
    typical = spread.typical or 0.0
    end = spread.high if place > 0.0 else spread.low
    if typical > 0.0 and end > 0.0:
        return typical * (end / typical) ** abs(place)
    return typical + (end - typical) * abs(place) ** 3


@lru_cache(maxsize=1)
def load_constants() -> Constants:
    """Load the constants that are published with the package."""
    content = ConstantsFile.model_validate(yaml.safe_load(CONSTANTS_FILE.read_text()))
    return Constants(content.constants, content.sources, {})
