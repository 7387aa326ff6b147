"""Things that hold something open, and let it go at the end of `with`."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self


class Closing(ABC):
    """Holds files, ports or threads until it is closed."""

    @abstractmethod
    def close(self) -> None:
        """Let everything go; may be called twice."""

    def __enter__(self) -> Self:
        """The thing itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, whether or not something went wrong."""
        self.close()
