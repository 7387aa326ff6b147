"""The network of arXiv 2506.18256 on the graph of all taxels, trained and live."""

from eskin_paper_network.neighbours import Distance
from eskin_paper_network.network import PaperNetwork, Pooling

__all__ = ["Distance", "PaperNetwork", "Pooling"]
