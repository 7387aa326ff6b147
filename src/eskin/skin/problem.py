"""One thing that is wrong with a skin."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a skin, and where."""

    text: str
    """What is wrong, what was got and what is allowed."""

    patch: str | None = None
    """The patch it lies in, where one is known."""

    taxel: int | None = None
    """The taxel's id, where one is known."""

    def __str__(self) -> str:
        """One line that names the patch and taxel."""
        where = []
        if self.patch is not None:
            where.append(f"patch '{' '.join(self.patch.split())}'")
        if self.taxel is not None:
            where.append(f"taxel {self.taxel}")
        return f"{', '.join(where)}: {self.text}" if where else self.text
