"""A function that the command map beside it names."""


def wave(event: object) -> None:
    """Do nothing."""
