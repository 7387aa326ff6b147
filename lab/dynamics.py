"""Measure the motion and the cost of the simulated arm with masses and servos.

python -m lab.dynamics: a minute of the task at full speed, pauses at 200 moments
of it, pushes across the forearm 30 cm from the elbow, and the ratio of the wrench on
the arm to the true force of simulated touches.
"""

import time

import numpy as np

from eskin.command import DynamicPlant, SimulatedArm
from eskin.drivers import ManualClock
from eskin.robot import Wrench
from eskin.sim.interactive import InteractiveSkin

STEP = 0.002
STANDS = 0.01
"""Joint speed below which the arm stands [rad/s]."""
PUSHES = (50.0, 100.0, 200.0, 300.0, 500.0)
"""Forces across the forearm [N]."""
OUT = np.array([0.0, 0.0, 0.3])
"""Point of application of the pushes, in the frame of the forearm [m]."""
GESTURES = ("poke", "double_pat", "stroke", "grab")


def build_dynamic_arm() -> tuple[SimulatedArm, DynamicPlant, ManualClock]:
    """Build an arm at the start of its task."""
    clock, plant = ManualClock(), DynamicPlant()
    return SimulatedArm(clock=clock, plant=plant), plant, clock


def compute_deviation(arm: SimulatedArm) -> float:
    """Return the greatest distance of a joint from its set-point [rad]."""
    return float(np.abs(arm.state().q - arm.executor.trajectory.q).max())


def show_task(seconds: float = 60.0) -> None:
    """Print deviation, torque and processor time over a part of the task."""
    arm, plant, clock = build_dynamic_arm()
    begun = time.process_time()
    deviations, torques = [], []
    for _ in range(round(seconds / STEP)):
        clock.sleep(STEP)
        deviations.append(compute_deviation(arm))
        torques.append(float(np.abs(plant.dynamics.torque).max()))
    cost = (time.process_time() - begun) / seconds
    print(
        f"{seconds:g} s of the task: at most {max(deviations):.4f} rad from the "
        f"set-points, at most {max(torques):.0f} Nm, {cost:.1%} of a core"
    )


def show_pauses(times: int = 200) -> None:
    """Print how the arm comes to rest after pauses."""
    worst, latest = 0.0, 0.0
    for n in range(times):
        arm, plant, clock = build_dynamic_arm()
        clock.sleep(1.0 + 0.02 * n)
        arm.pause()
        clock.sleep(arm.executor.trajectory.config.brake_seconds)
        for step in range(200):
            clock.sleep(STEP)
            worst = max(worst, compute_deviation(arm))
            if np.abs(plant.dynamics.velocity).max() > STANDS:
                latest = max(latest, step * STEP)
    print(
        f"{times} pauses: once set-points stand, at most {worst:.4f} rad from them, "
        f"and above {STANDS:g} rad/s for {latest:.2f} s at most"
    )


def show_pushes() -> None:
    """Print the effect of pushes of 2 s across the forearm."""
    for force in PUSHES:
        arm, _, clock = build_dynamic_arm()
        arm.pause()
        clock.sleep(2.0)
        stood = arm.state().q
        force_link = np.array([force, 0.0, 0.0])
        arm.apply_wrenches(
            [Wrench("forearm_link", force_link, np.cross(OUT, force_link))]
        )
        clock.sleep(2.0)
        state = arm.state()
        moved = np.abs(state.q - stood).max()
        stop = ", protective stop" if state.protective_stop else ""
        print(f"{force:4g} N on the forearm: a joint turned by {moved:.3f} rad{stop}")


def show_wrenches(seeds: tuple[int, ...] = (100, 101, 102, 103)) -> None:
    """Print the net force of touches on the arm beside their true force."""
    shares: dict[str, list[float]] = {gesture: [] for gesture in GESTURES}
    for seed in seeds:
        skin, stamps = InteractiveSkin("ur5", seed), iter(range(20, 10**6, 20))
        q = SimulatedArm(clock=ManualClock()).executor.trajectory.q
        for gesture in GESTURES:
            skin.hand.perform(gesture)
            highest, net = 0.0, 0.0
            while skin.hand.touching:
                skin.scan(next(stamps) * 1_000_000, q)
                force = sum(truth.force for truth in skin.hand.truths())
                if force > highest:
                    highest = force
                    each = (np.linalg.norm(w.force_link) for w in skin.wrenches)
                    net = float(sum(each))
            if highest > 0:
                shares[gesture].append(net / highest)
    for gesture, found in shares.items():
        words = " ".join(f"{share:.2f}" for share in found)
        print(f"{gesture}: net push by true force at its peak {words}")


if __name__ == "__main__":
    show_task()
    show_pauses()
    show_pushes()
    show_wrenches()
