"""Clips and streams: from a plan to what is counted and what was done."""
