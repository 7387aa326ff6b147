"""Halve and double each tuned number of the front end, and see which figures move."""
