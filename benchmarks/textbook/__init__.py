"""Textbook touches: plain formulas on a perfect sensor, never trained on."""
