"""This package writes recordings in formats of other programs, and reports of them."""
