"""This package holds a robot in its skin: its poses, its motion, sites and scenes."""
