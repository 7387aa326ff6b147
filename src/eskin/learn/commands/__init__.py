"""The commands of the leaf `learn`."""
