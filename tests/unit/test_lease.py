"""One holder at a time, as long as it is heard from."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.errors import LeaseLost
from viewsep.service.lease import Lease
from viewsep.service.requests import Code, Refused

LEASE_S = 2.0


class Hands:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Hands:
    return Hands()


@pytest.fixture
def lease(clock: Hands) -> Lease:
    return Lease(LEASE_S, clock)


def test_another_one_is_refused_and_told_who_holds_it(lease: Lease) -> None:
    lease.acquire("anna")
    with pytest.raises(Refused, match="anna") as refusal:
        lease.acquire("ben")
    assert refusal.value.code is Code.BUSY
    assert lease.holder == "anna"


def test_who_was_stopped_is_told_why_and_anybody_may_go_on(lease: Lease) -> None:
    lease.acquire("anna")
    lease.revoke("somebody pressed the button")
    with pytest.raises(LeaseLost, match="somebody pressed the button"):
        lease.renew("anna")
    lease.acquire("ben")
    with pytest.raises(LeaseLost, match="somebody pressed the button"):
        lease.renew("anna")
    lease.release("ben")
    lease.acquire("anna")
    assert not lease.renew("anna")


def test_who_lapsed_may_go_on_unless_somebody_else_came(lease: Lease, clock: Hands) -> None:
    lease.acquire("anna")
    clock.now_s += LEASE_S
    assert lease.lapsed()
    assert lease.renew("anna")
    assert not lease.lapsed()
    clock.now_s += LEASE_S
    assert lease.acquire("ben")
    with pytest.raises(LeaseLost, match="ben has taken the rig after 2 s of silence"):
        lease.renew("anna")
    lease.release("ben")
    with pytest.raises(LeaseLost):
        lease.renew("anna")


def test_nobody_is_no_holder(lease: Lease) -> None:
    assert not lease.lapsed()
    with pytest.raises(LeaseLost, match="nobody does not hold the rig"):
        lease.renew("")
    assert not lease.release("")


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["acquire", "renew", "release", "revoke", "wait"]),
        st.sampled_from(["anna", "ben", "cleo"]),
        st.sampled_from([0.5, 1.9, 2.0, 5.0]),
    ),
    max_size=40,
)


@given(STEPS)
def test_it_does_what_a_list_of_all_that_happened_says(steps: list[tuple[str, str, float]]) -> None:
    """The model remembers who holds it and since when nobody has heard of them, and nothing else."""
    clock = Hands()
    lease = Lease(LEASE_S, clock)
    holder, heard_s = "", 0.0
    for what, who, wait_s in steps:
        silent = holder != "" and clock.now_s - heard_s >= LEASE_S
        match what:
            case "wait":
                clock.now_s += wait_s
            case "acquire" if holder in ("", who) or silent:
                assert lease.acquire(who) == silent
                holder, heard_s = who, clock.now_s
            case "acquire":
                with pytest.raises(Refused, match=holder):
                    lease.acquire(who)
            case "renew" if holder == who:
                assert lease.renew(who) == silent
                heard_s = clock.now_s
            case "renew":
                with pytest.raises(LeaseLost):
                    lease.renew(who)
            case "release":
                assert lease.release(who) == (holder == who)
                holder = "" if holder == who else holder
            case _:
                lease.revoke("stopped")
                holder = ""
        assert lease.holder == holder
        assert lease.lapsed() == (holder != "" and clock.now_s - heard_s >= LEASE_S)
