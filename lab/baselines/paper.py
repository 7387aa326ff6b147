"""This module trains the paper's network on windows of the whole skin."""

from copy import copy
from typing import final

from eskin_paper_network import Distance, PaperNetwork, Pooling

from eskin.skin import MountedSkin
from lab.baselines.interface import BaselineStream, WindowStream
from lab.baselines.network import CachedStream, FitConfig, NetworkBaseline


@final
class PaperBaseline(NetworkBaseline):
    """This baseline is the EGNN on all taxels and 100 graphs (see `PaperNetwork`)."""

    def __init__(
        self,
        mounted: MountedSkin,
        config: FitConfig | None = None,
        k: int = 8,
        pooling: Pooling = "max",
        distance: Distance = "kinematic",
        stride: int = 1,
    ) -> None:
        """Create an untrained baseline.

        Args:
            mounted: the skin on its robot.
            config: settings of the training.
            k: number of neighbours of a taxel inside its patch.
            pooling: pooling over the nodes of a reading.
            distance: distance between taxels.
            stride: of so many readings of a window one is used.
        """
        super().__init__(mounted, config)
        self.k = k
        self.pooling: Pooling = pooling
        self.distance: Distance = distance
        self.stride = stride

    def build(self) -> PaperNetwork:
        """Return the network."""
        return PaperNetwork(
            self.mounted,
            self.classes,
            self.k,
            self.pooling,
            self.distance,
            self.stride,
        )

    def build_streams(self) -> dict[str, BaselineStream]:
        """Return streams that compute all nodes of 100 graphs, those of one, or few.

        The first is what the paper describes; the second computes the newest graph, the
        last one only the nodes of it that a touch changes.
        """
        assert isinstance(self.network, PaperNetwork)
        whole = copy(self)
        whole.network = all_nodes = copy(self.network)
        all_nodes.whole = True
        return {
            "": WindowStream(whole),
            "cached": CachedStream(self.mounted, all_nodes),
            "cached, sparse": CachedStream(self.mounted, self.network),
        }
