"""This package makes simulated clips and streams with labels: plans, sets and files."""

from eskin.sim.dataset.clip import get_build
from eskin.sim.dataset.clip_generator import ClipGenerator, Simulator
from eskin.sim.dataset.generate import GenerationResult, generate
from eskin.sim.dataset.index import ClipRow, read_index, remake_clip
from eskin.sim.dataset.pairs import ClipPair, make_pair, simulate_pair
from eskin.sim.dataset.plan import ClipPlan, build_seed, plan_single_pair
from eskin.sim.dataset.settings import GenerationSettings

__all__ = [
    "ClipGenerator",
    "ClipPair",
    "ClipPlan",
    "ClipRow",
    "GenerationResult",
    "GenerationSettings",
    "Simulator",
    "build_seed",
    "generate",
    "get_build",
    "make_pair",
    "plan_single_pair",
    "read_index",
    "remake_clip",
    "simulate_pair",
]
