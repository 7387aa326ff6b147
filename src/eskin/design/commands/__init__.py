"""The commands of the leaf `design`."""
