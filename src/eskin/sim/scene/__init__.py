"""The environment holds a robot in its skin: poses, motion, places and scenes."""
