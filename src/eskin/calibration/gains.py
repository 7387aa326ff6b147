"""This module estimates gains, exponent and activation from presses of a fingertip.

The estimate is the calibration under which fingertips of the known forces, or of those
that people usually apply, show what was measured, as far as the data sheet allows.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from eskin.calibration.fingertip import (
    FORCES,
    MIN_FORCE,
    PA_PER_KPA,
    FingertipResponse,
)
from eskin.skin import Skin
from eskin.touch import Calibration

ROUNDS = 6
"""Number of estimates, each with the deviations of the presses under the last one."""
FREEDOM = 4.0
"""Degrees of freedom of the errors of presses."""
SHARED = 5
"""Number of deviates that belong to the whole skin."""
STEP = 1e-3
"""Step of the numerical derivatives, in deviations of the prior."""
TOLERANCE = 1e-4
"""Relative change of the estimate, or of what it minimises, that is none."""
LN_FORCES = np.log(FORCES)
NODES, NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = NODE_WEIGHTS / NODE_WEIGHTS.sum()
"""Nodes and weights of means over a standard normal law."""


@dataclass(frozen=True, eq=False)
class FingertipPress:
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
    """Assumptions before any press. Deviations are of natural logarithms."""

    device: float = 0.4
    """Standard deviation of the gain of a whole skin from its data sheet."""
    patch: float = 0.4
    """Standard deviation of the gain of a patch from that of the skin, where what its
    own exponent and activation change counts as gain."""
    taxel: float = 0.35
    """Standard deviation of the gain of a taxel from the gain of its patch."""
    exponent: float = 0.12
    """Standard deviation of the exponent of a whole skin."""
    unfelt: float = 0.7
    """Standard deviation of the activation pressure of a whole skin."""
    force: float = 4.0
    """Median force of a fingertip that is asked to press [N]."""
    person: float = 0.5
    """Standard deviation of the usual force between people."""
    press: float = 0.3
    """Standard deviation of the force between presses of one person."""
    known: float = 0.05
    """Standard deviation of a force that is given."""
    finger: float = 0.15
    """Standard deviation of what all presses together show by the law of a fingertip:
    finger, layers of the skin, and pace differ from it."""
    repeat: float = 0.2
    """Standard deviation of what is measured of the same force again: creep,
    hysteresis, and how the finger is held."""


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
    misfit: float
    """Negative logarithm of the probability density of the presses' counts and of the
    constants, less what is the same whichever calibration is assumed."""

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
    presses: tuple[FingertipPress, ...],
) -> GainEstimate:
    """Estimate the gain of each patch, and exponent and activation of the skin.

    The estimate is the most probable one (maximum a posteriori), with the deviations of
    the normal law of the same curvature. A patch without a press follows the
    others as far as patches of one skin resemble each other.

    Args:
        skin: skin that was pressed.
        calibration: calibration that was assumed: the middle of the prior.
        presses: presses, of any patches.
    """
    problem = PressProblem(skin, calibration, presses)
    found = np.zeros(problem.size)
    jacobian = np.eye(problem.size)
    for _ in range(ROUNDS if presses else 0):
        problem.update_deviations(found)
        result = least_squares(
            problem.compute_residuals,
            found,
            jac=problem.compute_jacobian,  # type: ignore[arg-type]
            xtol=TOLERANCE,
            ftol=TOLERANCE,
        )
        found = result.x
        jacobian = result.jac
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    return problem.build_estimate(found, covariance)


@final
class PressProblem:
    """A problem computes the residuals of a trial calibration, by their deviations.

    What is compared is the force that the assumed calibration shows of a press, which
    is the same in every trial. A trial is a vector of standard normal deviates: gain of
    the skin, usual force of the person, exponent, activation, error of the law of a
    fingertip, then gain of each patch.
    The whole skin has one exponent and one activation: a few presses of one patch tell
    hardly more about them than the data sheet.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        presses: tuple[FingertipPress, ...],
    ) -> None:
        """Measure the presses with the assumed calibration."""
        self.skin = skin
        self.calibration = calibration
        self.presses = presses
        self.prior = GainPrior()
        self.size = SHARED + len(skin.patches)
        self.shown = np.array([self.measure(press) for press in presses])
        self.deviation = np.ones(len(presses))
        self.has_exponent = calibration.curve != "linear"
        self.has_unfelt = calibration.unfelt > 0.0

    def measure(self, press: FingertipPress) -> float:
        """Return ln of the force that the assumed calibration shows of a press."""
        assumed = replace(
            self.calibration,
            gain=self.calibration.gain[press.taxels],
            noise=None,
            rest=None,
        )
        areas = self.skin.areas[press.taxels]
        force = PA_PER_KPA * float(areas @ assumed.compute_pressure(press.above))
        return float(np.log(max(force, MIN_FORCE)))

    @cached_property
    def responses(self) -> dict[int, FingertipResponse]:
        """Response of the taxels of each patch that was pressed."""
        found = {}
        for patch in {press.patch for press in self.presses}:
            members = self.skin.patch_index == patch
            found[patch] = FingertipResponse(
                float(self.skin.areas[members].mean()),
                self.calibration,
                float(np.exp(np.log(self.calibration.gain[members]).mean())),
                self.prior.taxel,
            )
        return found

    def get_constants(
        self, trial: Float[np.ndarray, "size"]
    ) -> tuple[Float[np.ndarray, "patch"], float, float]:
        """Return ln gain of each patch, exponent and activation [kPa] of a trial."""
        prior = self.prior
        ln_gain = prior.device * trial[0] + prior.patch * trial[SHARED:]
        exponent = self.calibration.exponent
        exponent *= np.exp(prior.exponent * trial[2] * self.has_exponent)
        unfelt = self.calibration.unfelt
        unfelt *= np.exp(prior.unfelt * trial[3] * self.has_unfelt)
        return ln_gain, float(exponent), float(unfelt)

    def predict(
        self, trial: Float[np.ndarray, "size"]
    ) -> tuple[Float[np.ndarray, "press"], Float[np.ndarray, "press"]]:
        """Return mean and deviation of what a trial shows of each press."""
        prior = self.prior
        ln_gain, exponent, unfelt = self.get_constants(trial)
        usual = np.log(prior.force) + prior.person * trial[1]
        mean = np.empty(len(self.presses))
        deviation = np.empty(len(self.presses))
        for n, press in enumerate(self.presses):
            response = self.responses[press.patch]
            gain = float(ln_gain[press.patch])
            means, variances = response.compute(gain, exponent, unfelt)
            middle = usual
            spread = prior.press
            if press.force is not None:
                middle = np.log(press.force)
                spread = prior.known
            forces = middle + spread * NODES
            shown = np.interp(forces, LN_FORCES, means)
            mean[n] = WEIGHTS @ shown
            variance = WEIGHTS @ ((shown - mean[n]) ** 2)
            mean[n] += prior.finger * trial[4]
            variance += WEIGHTS @ np.interp(forces, LN_FORCES, variances)
            deviation[n] = np.sqrt(variance + prior.repeat**2)
        return mean, deviation

    def update_deviations(self, trial: Float[np.ndarray, "size"]) -> None:
        """Set the deviation of each press to that under a trial.

        It is larger for a press that hardly fits, such as one beside a dead taxel, as
        by a t distribution of few degrees of freedom.
        """
        mean, deviation = self.predict(trial)
        squares = ((self.shown - mean) / deviation) ** 2
        worse = np.maximum((FREEDOM + squares) / (FREEDOM + 1.0), 1.0)
        self.deviation = deviation * np.sqrt(worse)

    def compute_residuals(
        self, trial: Float[np.ndarray, "size"]
    ) -> Float[np.ndarray, "residual"]:
        """Return the residuals of the presses, then of the prior."""
        mean = self.predict(trial)[0]
        return np.concatenate([(self.shown - mean) / self.deviation, trial])

    def compute_jacobian(
        self, trial: Float[np.ndarray, "size"]
    ) -> Float[np.ndarray, "residual size"]:
        """Return the derivatives of the residuals by each deviate."""
        base = self.compute_residuals(trial)
        steps = trial + STEP * np.eye(self.size)
        moved = np.stack([self.compute_residuals(step) for step in steps], axis=1)
        return (moved - base[:, None]) / STEP

    def build_estimate(
        self, trial: Float[np.ndarray, "size"], covariance: Float[np.ndarray, "n n"]
    ) -> GainEstimate:
        """Build the estimate of the best trial from the covariance of its deviates."""
        prior = self.prior
        count = len(self.skin.patches)
        linear = np.zeros((count, self.size))
        linear[:, 0] = prior.device
        linear[:, SHARED:] = prior.patch * np.eye(count)
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
            self.compute_misfit(trial),
        )

    def compute_misfit(self, trial: Float[np.ndarray, "size"]) -> float:
        """Compute the negative logarithm of the density of counts and constants."""
        grown = [replace(each, above=each.above * (1 + STEP)) for each in self.presses]
        more = np.array([self.measure(each) for each in grown])
        slopes = np.maximum(more - self.shown, STEP**2) / STEP
        squares = self.compute_residuals(trial) ** 2
        return float(squares.sum() / 2 + np.log(self.deviation / slopes).sum())
