"""This module hands tuples of arrays to compiled code once instead of at every call.

Handing over an array costs 0.2 us and handing one back 0.8 us; a recogniser's step
needs a hundred of them.
"""

from typing import Any, no_type_check

from numba import types
from numba.experimental import structref

from eskin.compiled import compiled


@no_type_check
@structref.register
class PackedType(types.StructRef):
    """Describes `Packed` to numba, once for each type of tuple."""

    def preprocess_fields(self, fields: Any) -> Any:  # noqa: ANN401
        """Return the fields with literal types replaced by the types they are of."""
        return tuple((name, types.unliteral(type_)) for name, type_ in fields)


@no_type_check
class Packed(structref.StructRefProxy):
    """A reference to a named tuple of arrays and numbers that compiled code reads.

    The arrays are shared with the tuple, not copied.
    """


structref.define_proxy(Packed, PackedType, ["parts"])


@compiled
@no_type_check
def pack(parts: tuple) -> Packed:
    """Return a reference to a named tuple, which may hold further ones."""
    return Packed(parts)


@compiled
@no_type_check
def unpack(packed: Packed) -> Any:  # noqa: ANN401
    """Return the named tuple that a reference refers to."""
    return packed.parts
