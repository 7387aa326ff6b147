"""The commands of the leaf `sim`."""
