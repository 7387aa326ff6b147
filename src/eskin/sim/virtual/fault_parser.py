"""This module parses the fault language `KIND[:WHERE][@FROM[-TO]][=AMOUNT]`.

`docs/devices.md` has the table of kinds.
"""

import re

import numpy as np
from jaxtyping import Int

from eskin.drivers.packet import MAX_ADDRESS
from eskin.sim.virtual.fault import FOREVER, DeviceFault, FaultSpec
from eskin.sim.virtual.fault_kinds import FAULT_KINDS
from eskin.skin import Skin
from eskin.units import NS_PER_S

NUMBER = r"[0-9]+(?:\.[0-9]*)?"
FORM = re.compile(
    r"(?P<kind>[a-z_]+)"
    r"(?::(?P<where>[^@=]+))?"
    rf"(?:@(?P<start>{NUMBER})(?:-(?P<end>{NUMBER}))?)?"
    rf"(?:=(?P<amount>-?{NUMBER}))?"
)
PLACE = re.compile(
    r"(?P<patch>[^/]+)(?:/(?:r(?P<row>[0-9]+))?(?:c(?P<column>[0-9]+))?)?"
)


def parse_fault(text: str, skin: Skin, seed: int = 0) -> DeviceFault:
    """Parse a fault such as `lose=0.1`, `unplug:forearm@5-8` or `stuck:forearm/r3c5`.

    `seed` starts the random generator that the fault draws from.

    Raises:
        ValueError: the text is not a valid fault of this skin.
    """
    found = FORM.fullmatch(text)
    if found is None:
        raise ValueError(
            f"fault '{text}' cannot be read; allowed is KIND[:WHERE][@FROM[-TO]]"
            "[=AMOUNT], such as lose=0.1 or unplug:forearm@5-8; times are in seconds"
        )
    kind = FAULT_KINDS.get(found["kind"])
    if kind is None:
        raise ValueError(
            f"fault '{text}' is of no known kind; allowed are {', '.join(FAULT_KINDS)}"
        )
    patches, taxels = parse_place(text, found["where"], kind, skin)
    start, end = parse_span(text, found["start"], found["end"], kind)
    spec = FaultSpec(
        text=text,
        patches=patches,
        taxels=taxels,
        start=start,
        end=end,
        amount=parse_amount(text, found["amount"], kind),
        unused=find_unused_address(skin),
    )
    return kind(spec, np.random.default_rng(seed))


def parse_place(
    text: str, where: str | None, kind: type[DeviceFault], skin: Skin
) -> tuple[tuple[int, ...], Int[np.ndarray, "part"]]:
    """Return the affected patches and taxels: all unless some are named."""
    if where is None and not kind.needs_pair:
        return tuple(range(len(skin.patches))), np.arange(skin.count)
    names = (where or "").split(",")
    if len(names) != 1 + kind.needs_pair:
        pair = "are 2, as in KIND:ONE,OTHER"
        one = "is 1, or none for all"
        allowed = pair if kind.needs_pair else one
        raise ValueError(
            f"fault '{text}' names {len(names) if where else 0} patches; allowed "
            f"{allowed}"
        )
    places = [parse_patch_place(text, name, skin) for name in names]
    patches = tuple(patch for patch, _ in places)
    if len(set(patches)) != len(patches):
        raise ValueError(f"fault '{text}' names one patch twice; name two")
    return patches, np.concatenate([taxels for _, taxels in places])


def parse_patch_place(
    text: str, name: str, skin: Skin
) -> tuple[int, Int[np.ndarray, "part"]]:
    """Return one affected patch and its affected taxels."""
    found = PLACE.fullmatch(name)
    ids = [patch.id for patch in skin.patches]
    if found is None or found["patch"] not in ids:
        raise ValueError(
            f"fault '{text}' is at '{name}'; allowed are PATCH, PATCH/rROW, "
            f"PATCH/cCOLUMN and PATCH/rROWcCOLUMN with a patch of {', '.join(ids)}"
        )
    patch = ids.index(found["patch"])
    meant = skin.patch_index == patch
    if found["row"] is not None:
        meant &= skin.rows == int(found["row"])
    if found["column"] is not None:
        meant &= skin.columns == int(found["column"])
    if not meant.any():
        rows, columns = skin.patches[patch].rows, skin.patches[patch].columns
        raise ValueError(
            f"fault '{text}' is where patch {found['patch']} has no taxel; allowed are "
            f"rows 0 to {rows - 1} and columns 0 to {columns - 1} that hold some"
        )
    return patch, np.flatnonzero(meant)


def parse_span(
    text: str, start: str | None, end: str | None, kind: type[DeviceFault]
) -> tuple[int, int]:
    """Return start and end [ns]."""
    first = round(float(start or 0.0) * NS_PER_S)
    if end is None:
        return first, FOREVER
    last = round(float(end) * NS_PER_S)
    if not kind.has_end:
        raise ValueError(
            f"fault '{text}' has an end, but happens at an instant; allowed is @FROM"
        )
    if last <= first:
        raise ValueError(
            f"fault '{text}' ends at {end} s, not after its start; allowed is later"
        )
    return first, last


def parse_amount(text: str, amount: str | None, kind: type[DeviceFault]) -> float:
    """Return the amount, or the default; 1 for a kind without amount."""
    if amount is None:
        return 1.0 if kind.default is None else kind.default
    if kind.default is None:
        raise ValueError(f"fault '{text}' takes no amount; leave out ={amount}")
    if not kind.min_amount <= float(amount) <= kind.max_amount:
        raise ValueError(
            f"fault '{text}' has the amount {amount}; allowed are "
            f"{kind.min_amount:g} to {kind.max_amount:g}"
        )
    return float(amount)


def find_unused_address(skin: Skin) -> int:
    """Return the largest address that no patch has."""
    used = {patch.address for patch in skin.patches}
    return next(at for at in range(MAX_ADDRESS, -1, -1) if at not in used)
