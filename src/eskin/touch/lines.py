"""Rows, columns and patches as groups of taxels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin.skin import Skin


@dataclass(frozen=True, eq=False)
class Lines:
    """Each taxel belongs to one line; a line is a row, a column or a whole patch."""

    line_index: Int[np.ndarray, "taxel"]
    """The line of each taxel."""

    sizes: Int[np.ndarray, "line"]
    """Taxels of each line."""

    patches: Int[np.ndarray, "line"]
    """The patch of each line."""

    numbers: Int[np.ndarray, "line"]
    """Its row or column number; for a patch that of the patch."""

    @classmethod
    def of(cls, skin: Skin, numbers: Int[np.ndarray, "taxel"]) -> "Lines":
        """Group the taxels of each patch by a number: rows, columns or patch."""
        keys = np.stack([np.asarray(skin.patch_index), np.asarray(numbers)])
        kinds, index, sizes = np.unique(
            keys, axis=1, return_inverse=True, return_counts=True
        )
        return cls(index.reshape(-1), sizes, kinds[0], kinds[1])

    def all_of(self, flags: Bool[np.ndarray, "taxel"]) -> Bool[np.ndarray, "line"]:
        """Lines all of whose taxels are flagged."""
        return self.share_of(flags) == 1.0

    def share_of(self, flags: Bool[np.ndarray, "taxel"]) -> Float[np.ndarray, "line"]:
        """Share of each line's taxels that are flagged."""
        marked = np.bincount(self.line_index, flags, minlength=len(self.sizes))
        return marked / self.sizes
