"""Formats in which other projects describe where taxels are."""
