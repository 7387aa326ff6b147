"""This module estimates gains, exponent and activation from presses of a fingertip.

What is measured of a press under a trial calibration gives the force that a fingertip
must have had; the estimate is the calibration under which these forces agree best with
the known ones, or with those that people usually apply, and with the data sheet.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from eskin.calibration.fingertip import (
    PA_PER_KPA,
    FingertipResponse,
    tabulate_response,
)
from eskin.skin import Skin
from eskin.touch import Calibration

ROUNDS = 2
"""Number of estimates, each with the deviations of the presses under the last one."""
LEAST_FORCE = 1e-3
"""Force that is taken for measured where nothing is [N]."""


@dataclass(frozen=True, eq=False)
class Press:
    """A press of one fingertip at its greatest force."""

    patch: int
    """Index of its patch in the skin."""
    taxels: Int[np.ndarray, "some"]
    """Taxels of the contact."""
    above: Float[np.ndarray, "some"]
    """Their counts above rest, without crosstalk."""
    force: float | None = None
    """True force [N]; None where it is not known."""


@dataclass(frozen=True)
class GainPrior:
    """What is known before any press. Deviations are those of natural logarithms."""

    device: float = 0.4
    """Standard deviation of the gain of a whole skin from its data sheet."""
    patch: float = 0.35
    """Standard deviation of the gain of a patch from that of the skin."""
    taxel: float = 0.35
    """Standard deviation of the gain of a taxel from that of its patch."""
    exponent: float = 0.12
    """Standard deviation of the exponent."""
    unfelt: float = 0.7
    """Standard deviation of the activation pressure."""
    force: float = 4.0
    """Median force of a fingertip that is asked to press [N]."""
    person: float = 0.5
    """Standard deviation of the usual force between people."""
    press: float = 0.3
    """Standard deviation of the force between presses of one person."""
    known: float = 0.05
    """Standard deviation of a force that is given."""
    repeat: float = 0.1
    """Standard deviation of what is measured of the same force again: creep and
    hysteresis."""


@dataclass(frozen=True, eq=False)
class GainEstimate:
    """An estimate, with the standard deviations that presses leave."""

    ln_gain: Float[np.ndarray, "patch"]
    """ln of the gain of each patch over the one that was assumed."""
    gain_deviation: Float[np.ndarray, "patch"]
    """Standard deviation of `ln_gain`."""
    exponent: float
    exponent_deviation: float | None
    """Standard deviation of ln exponent; None where it is not estimated."""
    unfelt: float
    """Activation pressure [kPa]."""
    unfelt_deviation: float | None
    """Standard deviation of ln unfelt; None where it is not estimated."""
    covariance: Float[np.ndarray, "patch patch"]
    """Covariance of `ln_gain`."""

    def apply(self, calibration: Calibration, skin: Skin) -> Calibration:
        """Return a calibration with these constants."""
        return replace(
            calibration,
            gain=calibration.gain * np.exp(self.ln_gain)[skin.patch_index],
            exponent=self.exponent,
            unfelt=self.unfelt,
            source="presses",
            gain_deviation=self.gain_deviation,
            exponent_deviation=self.exponent_deviation,
            unfelt_deviation=self.unfelt_deviation,
        )


def estimate_gains(
    skin: Skin,
    calibration: Calibration,
    presses: tuple[Press, ...],
    prior: GainPrior | None = None,
) -> GainEstimate:
    """Estimate the gain of each patch, and exponent and activation of the skin.

    The estimate is the most probable one (maximum a posteriori), its deviations are
    those of the normal law of the same curvature. A patch without a press follows the
    others as far as patches of one skin resemble each other.

    Args:
        skin: skin that was pressed.
        calibration: calibration that was assumed: the middle of the prior.
        presses: presses, of any patches.
        prior: spreads that are usual.
    """
    problem = PressProblem(skin, calibration, presses, prior or GainPrior())
    found = np.zeros(problem.size)
    jacobian = np.eye(problem.size)
    for _ in range(ROUNDS if presses else 0):
        problem.update_deviations(found)
        result = least_squares(problem.compute_residuals, found)
        found, jacobian = result.x, result.jac
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    return problem.build_estimate(found, covariance)


@final
class PressProblem:
    """The residuals of a trial calibration, each in units of its deviation.

    A trial is a vector of standard normal deviates: gain of the skin, usual force of
    the person, exponent, activation, then gain of each patch.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        presses: tuple[Press, ...],
        prior: GainPrior,
    ) -> None:
        """Join the presses."""
        self.skin, self.calibration = skin, calibration
        self.presses, self.prior = presses, prior
        self.size = 4 + len(skin.patches)
        empty = np.zeros(0, np.int64)
        self.taxels = np.concatenate([empty, *(press.taxels for press in presses)])
        self.above = np.concatenate([np.zeros(0), *(press.above for press in presses)])
        sizes = [len(press.taxels) for press in presses]
        self.press_of = np.repeat(np.arange(len(presses)), sizes)
        self.areas = PA_PER_KPA * skin.areas[self.taxels]
        self.patch_of = skin.patch_index[self.taxels]
        self.deviation = np.ones(len(presses))
        self.has_exponent = calibration.curve == "divider"
        self.has_unfelt = calibration.unfelt > 0.0

    @cached_property
    def responses(self) -> dict[int, FingertipResponse]:
        """Response of the taxels of each patch that was pressed."""
        patches = {press.patch for press in self.presses}
        areas = {n: self.skin.areas[self.skin.patch_index == n] for n in patches}
        return {
            n: tabulate_response(float(area.mean()), not self.has_unfelt)
            for n, area in areas.items()
        }

    def get_constants(
        self, trial: Float[np.ndarray, "size"]
    ) -> tuple[Float[np.ndarray, "patch"], float, float]:
        """Return ln gain of each patch, exponent and activation [kPa] of a trial."""
        prior = self.prior
        ln_gain = prior.device * trial[0] + prior.patch * trial[4:]
        exponent = self.calibration.exponent
        exponent *= np.exp(prior.exponent * trial[2] * self.has_exponent)
        unfelt = self.calibration.unfelt
        unfelt *= np.exp(prior.unfelt * trial[3] * self.has_unfelt)
        return ln_gain, float(exponent), float(unfelt)

    def measure(self, trial: Float[np.ndarray, "size"]) -> Float[np.ndarray, "pressed"]:
        """Return the force on each pressed taxel under a trial [N]."""
        ln_gain, exponent, unfelt = self.get_constants(trial)
        gain = self.calibration.gain[self.taxels] * np.exp(ln_gain)[self.patch_of]
        changed = replace(
            self.calibration,
            gain=gain,
            exponent=exponent,
            unfelt=unfelt,
            noise=None,
            rest=None,
        )
        return self.areas * changed.compute_pressure(self.above)

    def infer_forces(
        self, trial: Float[np.ndarray, "size"]
    ) -> tuple[Float[np.ndarray, "press"], Float[np.ndarray, "press"]]:
        """Return ln force of each press under a trial, and its deviation."""
        forces = self.measure(trial)
        unfelt = self.get_constants(trial)[2]
        count, prior = len(self.presses), self.prior
        total = np.maximum(
            np.bincount(self.press_of, forces, minlength=count), LEAST_FORCE
        )
        squares = np.bincount(self.press_of, forces**2, minlength=count) / total**2
        result, deviation = np.empty(count), np.empty(count)
        for n, press in enumerate(self.presses):
            response = self.responses[press.patch]
            result[n], by_place, slope = response.infer_force(total[n], unfelt)
            measured = prior.taxel**2 * squares[n] + prior.repeat**2
            deviation[n] = np.sqrt(by_place**2 + measured / slope**2)
        return result, deviation

    def update_deviations(self, trial: Float[np.ndarray, "size"]) -> None:
        """Set the deviation of each press to that under a trial."""
        deviation = self.infer_forces(trial)[1]
        usual = [
            self.prior.press if press.force is None else self.prior.known
            for press in self.presses
        ]
        self.deviation = np.hypot(deviation, usual)

    def compute_residuals(
        self, trial: Float[np.ndarray, "size"]
    ) -> Float[np.ndarray, "residual"]:
        """Return the residuals of the presses, then those of the prior."""
        forces = self.infer_forces(trial)[0]
        usual = np.log(self.prior.force) + self.prior.person * trial[1]
        expected = np.array(
            [usual if p.force is None else np.log(p.force) for p in self.presses]
        )
        return np.concatenate([(forces - expected) / self.deviation, trial])

    def build_estimate(
        self, trial: Float[np.ndarray, "size"], covariance: Float[np.ndarray, "n n"]
    ) -> GainEstimate:
        """Build the estimate of the best trial from the covariance of its deviates."""
        prior, patches = self.prior, len(self.skin.patches)
        linear = np.zeros((patches, self.size))
        linear[:, 0] = prior.device
        linear[:, 4:] = prior.patch * np.eye(patches)
        ln_gain, exponent, unfelt = self.get_constants(trial)
        gains = linear @ covariance @ linear.T
        spread = np.sqrt(np.diag(covariance))
        return GainEstimate(
            ln_gain,
            np.sqrt(np.diag(gains)),
            exponent,
            float(prior.exponent * spread[2]) if self.has_exponent else None,
            unfelt,
            float(prior.unfelt * spread[3]) if self.has_unfelt else None,
            gains,
        )
