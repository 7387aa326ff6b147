"""The paper's recogniser behind the interface of the baselines."""

from copy import copy
from typing import final

from eskin.learn.baselines.egnn import PaperNetwork, Pooling
from eskin.learn.baselines.interface import Stream, WindowStream
from eskin.learn.baselines.network import CachedStream, FitConfig, NetworkBaseline
from eskin.skin import MountedSkin


@final
class PaperBaseline(NetworkBaseline):
    """The EGNN on all taxels and 100 graphs; see `eskin.learn.baselines.egnn`."""

    def __init__(
        self,
        mounted: MountedSkin,
        config: FitConfig | None = None,
        k: int = 8,
        pooling: Pooling = "max",
    ) -> None:
        """Make one that knows nothing yet.

        Args:
            mounted: the skin on its robot.
            config: how it is trained.
            k: neighbours a taxel inside its patch.
            pooling: over the nodes of a reading.
        """
        super().__init__(mounted, config)
        self.k = k
        self.pooling: Pooling = pooling

    def build(self) -> PaperNetwork:
        """Make the network."""
        return PaperNetwork(self.mounted, self.classes, self.k, self.pooling)

    def on(self, mounted: MountedSkin) -> "PaperBaseline":
        """The same weights on a skin that lies elsewhere."""
        assert isinstance(self.network, PaperNetwork)
        other = copy(self)
        other.mounted = mounted
        network = other.build()
        places = {"positions": network.positions}
        network.load_state_dict(self.network.state_dict() | places)
        other.network = network.eval()
        return other

    def streams(self) -> dict[str, Stream]:
        """All nodes of 100 graphs, of the newest graph, and only what a touch changes.

        The first is what the paper describes.
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
