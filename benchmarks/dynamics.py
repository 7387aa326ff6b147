"""What the simulated arm with masses and servos does, and costs.

python -m benchmarks.dynamics: a minute of the task at full speed, pauses at 200 moments
of it, pushes across the forearm 30 cm from the elbow, and how the wrench on the arm of
some simulated touches compares with their true force.
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
"""Where they push, in the forearm's frame [m]."""
GESTURES = ("poke", "double_pat", "stroke", "grab")


def dynamic_arm() -> tuple[SimulatedArm, DynamicPlant, ManualClock]:
    """An arm at the beginning of its task."""
    clock, plant = ManualClock(), DynamicPlant()
    return SimulatedArm(clock=clock, plant=plant), plant, clock


def off(arm: SimulatedArm) -> float:
    """How far a joint is from its set-point, at most [rad]."""
    return float(np.abs(arm.state().q - arm.executor.trajectory.q).max())


def show_task(seconds: float = 60.0) -> None:
    """Deviation, torque and cost over a stretch of the task."""
    arm, plant, clock = dynamic_arm()
    begun = time.process_time()
    deviations, torques = [], []
    for _ in range(round(seconds / STEP)):
        clock.sleep(STEP)
        deviations.append(off(arm))
        torques.append(float(np.abs(plant.dynamics.torque).max()))
    cost = (time.process_time() - begun) / seconds
    print(
        f"{seconds:g} s of the task: at most {max(deviations):.4f} rad from the "
        f"set-points, at most {max(torques):.0f} Nm, {cost:.1%} of a core"
    )


def show_pauses(times: int = 200) -> None:
    """How the arm stands after a pause."""
    worst, latest = 0.0, 0.0
    for n in range(times):
        arm, plant, clock = dynamic_arm()
        clock.sleep(1.0 + 0.02 * n)
        arm.pause()
        clock.sleep(arm.executor.trajectory.config.brake_seconds)
        for step in range(200):
            clock.sleep(STEP)
            worst = max(worst, off(arm))
            if np.abs(plant.dynamics.velocity).max() > STANDS:
                latest = max(latest, step * STEP)
    print(
        f"{times} pauses: once set-points stand, at most {worst:.4f} rad from them, "
        f"and above {STANDS:g} rad/s for {latest:.2f} s at most"
    )


def show_pushes() -> None:
    """What pushes across the forearm do for 2 s."""
    for force in PUSHES:
        arm, _, clock = dynamic_arm()
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
    """The force that the arm feels of touches, beside their true force."""
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
