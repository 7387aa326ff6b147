"""Pairs of clips whose counts are the same: only where the taxels are tells them apart.

Bending and temporary merging, as in Fig. 7 of arXiv 2506.18256.
"""
