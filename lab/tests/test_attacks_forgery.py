"""Tests of `lab.attacks.forgery`: nothing forged is accepted."""

import pytest

from lab.attacks.forgery import (
    ATTACKS,
    BATCH,
    REQUEST_ATTACKS,
    Attacker,
    attack_host,
    attack_patch,
)

pytestmark = pytest.mark.slow

KEY = bytes(range(32))


@pytest.fixture(scope="module")
def attacker():
    return Attacker(KEY, seed=3)


def test_no_forged_packet_is_accepted_and_no_true_one_refused(attacker):
    found = attack_host(attacker, BATCH * 3 * len(ATTACKS))
    found |= attack_patch(attacker, 100)
    assert {accepted for _, accepted in found.values()} == {0}
    assert len(found) == len(ATTACKS) + len(REQUEST_ATTACKS)
    assert min(sent for sent, _ in found.values()) > 20
    assert attacker.true > 0 == attacker.refused


def test_who_has_the_key_is_accepted(attacker):
    attacker.other_key = KEY
    found = attack_host(attacker, BATCH * 4)
    assert found["wrong key"][1] == 1
