"""This package simulates the arm that touches command, with or without its dynamics."""

from eskin.sim.arm.dynamics import Dynamics, ServoConfig, Wrench
from eskin.sim.arm.simulated_arm import DynamicPlant, ProtectiveStopConfig, SimulatedArm

__all__ = [
    "DynamicPlant",
    "Dynamics",
    "ProtectiveStopConfig",
    "ServoConfig",
    "SimulatedArm",
    "Wrench",
]
