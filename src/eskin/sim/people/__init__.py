"""This package draws people: their bodies, their hands, and their gestures."""
