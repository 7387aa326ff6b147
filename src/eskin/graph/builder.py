"""From a reading and the active taxels of a touch to its graph."""

from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.arrays import (
    MANY,
    GraphMemory,
    Instant,
    graph_memory,
    ground_of,
    loads_of,
)
from eskin.graph.batch import NOTHING, GraphBatch
from eskin.graph.builder_kernels import build_graph, take_in
from eskin.graph.config import GraphConfig
from eskin.skin import MountedSkin
from eskin.touch import LinkPoseCache, Reading

LONGEST_STEP = 0.5  # [s] between readings that a rate is taken over
SHORTEST_STEP = 1e-4  # [s]
LONG_AGO = -1_000_000_000  # [ns], so that no first reading follows another
NO_SHEAR = np.zeros((0, 2), np.float32)


@final
class GraphBuilder:
    """Builds the graphs of one stream of readings, oldest first.

    It remembers one reading and since when each taxel has been active, so `advance`
    must be called once for every reading, before `graph`.

    Attributes:
        ground: the skin.
        loads: what has been felt on it.
        instant: the latest reading.
        T_world_link: of every link at that reading.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: GraphConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Find the fixed neighbours of a skin on a robot.

        Args:
            mounted: the skin on its robot.
            config: of the graph.
            poses: of the robot's links, shared with who else asks for them.
        """
        self.mounted = mounted
        self.config = config or GraphConfig()
        self.poses = poses or LinkPoseCache(mounted, self.config.posed)
        self.ground = ground_of(mounted, self.config)
        self.loads = loads_of(mounted.skin.count)
        self.instant = Instant(0, LONG_AGO, LONGEST_STEP, False)
        self.T_world_link = np.empty((0, 4, 4))
        self.memory = graph_memory(MANY, self.ground)

    def advance(self, reading: Reading, active: Int[np.ndarray, "active"]) -> None:
        """Take in the next reading.

        Args:
            reading: later than the one before.
            active: the taxels that are touched in it, in any order; all of them valid.
        """
        shear = self.begin(reading)
        take_in(active, reading.pressure, shear, self.instant, self.loads)

    def begin(self, reading: Reading) -> Float[np.ndarray, "taxel_or_none 2"]:
        """Go on to the next reading; who takes it in is told its shear, if any."""
        step = (reading.stamp - self.instant.stamp) * 1e-9
        self.instant = Instant(
            self.instant.reading + 1,
            reading.stamp,
            min(max(step, SHORTEST_STEP), LONGEST_STEP),
            step <= LONGEST_STEP,
        )
        self.T_world_link = self.poses.get(reading.q)
        return NO_SHEAR if reading.shear is None else reading.shear

    def room_for(self, active: int) -> GraphMemory:
        """Memory for the graph of so many taxels, active now or one reading ago."""
        taxels, fixed = self.ground.table.shape
        nodes = min(active * (1 + fixed), taxels)
        if nodes > len(self.memory.taxels):
            self.memory = graph_memory(min(2 * nodes, taxels), self.ground)
        return self.memory

    def graph(
        self,
        taxels: Int[np.ndarray, "active"],
        earlier: Int[np.ndarray, "earlier"],
        history: Float[np.ndarray, "column"] = NOTHING,
    ) -> GraphBatch:
        """The graph of one touch at the latest reading, as a batch of one.

        Args:
            taxels: active taxels of the touch now.
            earlier: active taxels of the same touch at the reading before.
            history: what the touch has been so far.
        """
        memory = self.room_for(len(taxels) + len(earlier))
        nodes = build_graph(
            *(taxels, earlier, history, self.T_world_link, self.instant),
            *(self.ground, self.loads, memory),
        )
        return GraphBatch(
            taxels=memory.taxels[:nodes].copy(),
            pressure=memory.pressure[:nodes].copy(),
            before=memory.before[:nodes].copy(),
            age=memory.age[:nodes].copy(),
            areas=memory.areas[:nodes].copy(),
            positions=memory.positions[:nodes].copy(),
            normals=memory.normals[:nodes].copy(),
            shear=memory.shear[:nodes].copy(),
            shear_before=memory.shear_before[:nodes].copy(),
            neighbours=memory.neighbours[:nodes].copy(),
            offsets=np.array([0, nodes]),
            seconds=np.array([self.instant.seconds], np.float32),
            history=memory.history[None].copy(),
        )
