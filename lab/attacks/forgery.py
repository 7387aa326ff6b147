"""Forge packets of a patch that has a key, and count those that are accepted.

    python -m lab.attacks forgery [--packets 1000000]

The attacker sees and sends everything on the line, and has every packet of an earlier
run, but not the key. Packets go the way of real ones: decoder, session, registry,
assembler. The true patch sends all the while. The exit code is 1 where a forged packet
is accepted, a forged request is answered, or a true packet is refused.
"""

import random
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, final

from eskin.drivers import Request, SessionSeal, decode_packet, encode_packet
from eskin.drivers.packet import CRC, SEAL
from eskin.drivers.sessions import COUNTER_WINDOW
from lab.attacks.sealed_line import SealedLine
from lab.tables import format_head, format_row

BATCH = 50
"""Number of forged packets between two scans of the true patch."""
KEPT = 2 * COUNTER_WINDOW
"""Number of true packets that the attacker keeps of a session."""
WARM_UP = 1500
"""Number of scans before the attack, more than the window of counters."""
OTHER_KEY = b"\x5a" * 32
SEAL_START = -SEAL.size - CRC.size


@dataclass(frozen=True)
class Command:
    """Attack the seals of protocol version 2."""

    packets: int = 1_000_000
    """Number of forged packets; a tenth as many forged requests follow."""
    seed: int = 0
    """Seed of the attack."""


class Attack(NamedTuple):
    """One way to forge packets."""

    name: str
    forge: "Callable[[Attacker], bytes]"


@final
class Attacker:
    """Knows all that was ever sent, but not the key.

    Attributes:
        line: the line under attack.
        fresh: true packets that have not arrived yet.
        seen: true packets of this session that were accepted, oldest first.
        earlier: packets of an earlier run of the host, and of an earlier session.
        requests: requests of an earlier run of the host.
    """

    def __init__(self, key: bytes, seed: int) -> None:
        """Watch an earlier run, a session before a reboot, and the present one."""
        self.rng = random.Random(seed)
        self.other_key = OTHER_KEY
        self.earlier: list[bytes] = []
        self.seen: list[bytes] = []
        self.requests: list[bytes] = []
        self.boot: list[bytes] = []
        self.true = self.refused = 0
        self.line = SealedLine(1, 2, key, seed)
        self.watch(self.line, WARM_UP)
        self.earlier = self.seen
        self.seen = []
        self.line = SealedLine(1, 2, key, seed + 1)
        self.watch(self.line, 100)
        self.earlier += self.seen
        self.reboot()
        self.watch(self.line, WARM_UP)
        self.fresh = self.line.build_scan()

    def reboot(self) -> None:
        """Let the patch power up anew and get another session."""
        patch = self.line.patches[0]
        patch.power_up(self.line.now)
        self.seen = []
        self.boot = self.line.build_hellos()
        self.line.deliver(self.boot)
        self.line.step()

    def watch(self, line: SealedLine, scans: int) -> None:
        """Keep what the patch and the host send during some scans."""
        for _ in range(scans):
            self.requests += line.line.requests
            self.arrive(line.wait_period() + line.build_scan())

    def arrive(self, packets: list[bytes]) -> None:
        """Let true packets arrive; all must be accepted."""
        self.true += len(packets)
        self.refused += len(packets) - self.line.deliver(packets)
        self.seen = [*self.seen, *packets][-KEPT:]

    def advance(self) -> None:
        """Let the true packets arrive that the attack was made of, and make others."""
        self.arrive(self.fresh)
        answers = self.line.wait_period()
        self.arrive(answers)
        self.fresh = self.line.build_scan()

    def choose(self, packets: list[bytes]) -> bytes:
        """Return one of some packets."""
        return self.rng.choice(packets)

    @property
    def challenge(self) -> bytes:
        """Challenge of the session, which requests show to everybody."""
        address = self.line.patches[0].address
        sessions = self.line.source.sessions.sessions[address]
        return next(session.challenge for session in sessions if session.is_open)


def correct(content: bytes) -> bytes:
    """Return bytes with their CRC, so that the checks behind it are reached."""
    return content + CRC.pack(zlib.crc32(content))


def flip(data: bytes, rng: random.Random) -> bytes:
    """Return bytes with one to eight bits flipped."""
    changed = bytearray(data)
    for place in rng.sample(range(8 * len(data)), rng.randint(1, 8)):
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)


def strip(data: bytes, version: int) -> bytes:
    """Return a packet without its seal, in a version."""
    return encode_packet(decode_packet(data), version)


def guess_tag(attacker: Attacker) -> bytes:
    """Forge a packet with a random tag and a counter that is due."""
    content = attacker.choose(attacker.fresh)[: -16 - CRC.size]
    return correct(content + attacker.rng.randbytes(16))


def redirect(attacker: Attacker) -> bytes:
    """Send a fresh packet to the address of another patch."""
    data = attacker.choose(attacker.fresh)
    return correct(data[:2] + bytes([data[2] ^ 1]) + data[3 : -CRC.size])


def splice(attacker: Attacker) -> bytes:
    """Send the body of one packet with the seal of a fresh one."""
    body = attacker.choose(attacker.seen)[:SEAL_START]
    return correct(body + attacker.choose(attacker.fresh)[SEAL_START : -CRC.size])


def renew(attacker: Attacker) -> bytes:
    """Send an old packet with the session and counter of a fresh one."""
    old = attacker.choose(attacker.earlier)
    fresh = attacker.choose(attacker.fresh)
    numbers = fresh[SEAL_START : SEAL_START + 8]
    return correct(old[:SEAL_START] + numbers + old[SEAL_START + 8 : -CRC.size])


def use_other_key(attacker: Attacker, challenge: bytes) -> bytes:
    """Seal a packet with another key, or for another challenge."""
    packet = strip(attacker.choose(attacker.fresh), 2)
    return SessionSeal(attacker.other_key, challenge).close(packet, 10**6)


def cut(attacker: Attacker) -> bytes:
    """Cut the end off a fresh packet."""
    data = attacker.choose(attacker.fresh)[: -CRC.size]
    return correct(data[: attacker.rng.randrange(10, len(data))])


ATTACKS = (
    Attack("version 1", lambda a: strip(a.choose(a.fresh), 1)),
    Attack("version 2 without seal", lambda a: strip(a.choose(a.seen), 2)),
    Attack("guessed tag", guess_tag),
    Attack("wrong key", lambda a: use_other_key(a, a.challenge)),
    Attack("wrong key, no session", lambda a: use_other_key(a, bytes(16))),
    Attack("bits flipped", lambda a: flip(a.choose(a.fresh), a.rng)),
    Attack(
        "bits flipped, CRC corrected",
        lambda a: correct(flip(a.choose(a.fresh)[: -CRC.size], a.rng)),
    ),
    Attack("cut, CRC corrected", cut),
    Attack(
        "extended, CRC corrected",
        lambda a: correct(a.choose(a.fresh)[: -CRC.size] + a.rng.randbytes(2)),
    ),
    Attack("to another address", redirect),
    Attack("body and seal of two packets", splice),
    Attack("old packet, new counter", renew),
    Attack("replayed, in the window", lambda a: a.choose(a.seen[-500:])),
    Attack("replayed, before the window", lambda a: a.choose(a.seen[:500])),
    Attack("replayed, earlier session or run", lambda a: a.choose(a.earlier)),
    Attack("replayed hello of no session", lambda a: a.choose(a.boot)),
    Attack("request of the host sent back", lambda a: a.choose(a.requests)),
)
REQUEST_ATTACKS = (
    Attack("request without seal", lambda a: strip(a.choose(a.requests), 2)),
    Attack("request, wrong key", lambda a: forge_request(a)),
    Attack(
        "request, bits flipped, CRC corrected",
        lambda a: correct(flip(a.choose(a.requests)[: -CRC.size], a.rng)),
    ),
    Attack("request replayed", lambda a: a.choose(a.requests)),
)


def forge_request(attacker: Attacker) -> bytes:
    """Ask the patch for another session, or for an answer in this one."""
    rng = attacker.rng
    challenge = rng.choice((attacker.challenge, rng.randbytes(16)))
    number = rng.choice((0, 10**6))
    request = Request(attacker.line.patches[0].address, number, challenge)
    seal = SessionSeal(attacker.other_key, challenge)
    return seal.close(encode_packet(request, 2), number)


def attack_host(attacker: Attacker, packets: int) -> dict[str, tuple[int, int]]:
    """Send forged packets to the host; return numbers sent and accepted by kind."""
    result = {attack.name: (0, 0) for attack in ATTACKS}
    for batch in range(-(-packets // BATCH)):
        attack = ATTACKS[batch % len(ATTACKS)]
        size = min(BATCH, packets - batch * BATCH)
        forged = [attack.forge(attacker) for _ in range(size)]
        accepted = attacker.line.deliver(forged)
        sent, before = result[attack.name]
        result[attack.name] = sent + size, before + accepted
        attacker.advance()
    return result


def attack_patch(attacker: Attacker, packets: int) -> dict[str, tuple[int, int]]:
    """Send forged requests to the patch; return numbers sent and answered by kind."""
    result = {attack.name: (0, 0) for attack in REQUEST_ATTACKS}
    for number in range(packets):
        attack = REQUEST_ATTACKS[number % len(REQUEST_ATTACKS)]
        answered = len(attacker.line.build_answers([attack.forge(attacker)]))
        sent, before = result[attack.name]
        result[attack.name] = sent + 1, before + answered
        if number % BATCH == 0:
            attacker.advance()
    return result


def main(command: Command) -> None:
    """Attack, print what was accepted, and exit with 1 if anything was."""
    attacker = Attacker(random.Random(command.seed).randbytes(32), command.seed)
    found = attack_host(attacker, command.packets)
    found |= attack_patch(attacker, command.packets // 10)
    rows = [(name, f"{sent:,}", f"{taken:,}") for name, (sent, taken) in found.items()]
    print(format_head(("forged", "sent", "accepted or answered")))
    for row in rows:
        print(format_row(row))
    accepted = sum(taken for _, taken in found.values())
    print(
        f"{sum(sent for sent, _ in found.values()):,} forged, {accepted:,} accepted; "
        f"{attacker.true:,} true packets, {attacker.refused:,} of them refused"
    )
    sys.exit(bool(accepted or attacker.refused))
