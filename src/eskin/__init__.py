"""Touch gestures from a robot's electronic skin."""

__all__: list[str] = []
