"""This module defines objects that release their resources at the end of `with`."""

from abc import ABC, abstractmethod
from typing import Self


class Closing(ABC):
    """Holds files, ports or threads until it is closed."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources; a second call does nothing."""

    def __enter__(self) -> Self:
        """Return the object itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the object, whether or not an error occurred."""
        self.close()
