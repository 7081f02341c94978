"""The access control that follows from a register. What Zenoh makes of it: test_service_security.py."""

from __future__ import annotations

from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from viewsep.keys import KeyRole
from viewsep.service.access import access_control
from viewsep.service.names import Keys

EVERYBODY = {"rig1": KeyRole.RIG, "engine1": KeyRole.ENGINE, "op1": KeyRole.OPERATOR, "view1": KeyRole.VIEWER}
STREAMS = ("camera/image", "motion/state", "percept", "event", "command", "estimate", "result", "log")
WRITES = ("put", "delete", "declare_queryable", "reply", "liveliness_token", "query")


def allowed(table: dict[str, Any], name: str, flow: str, message: str, key: str) -> bool:
    """Whether Zenoh would let `name` do this: a rule must hold all of the key."""
    subjects = {subject["id"] for subject in table["subjects"] if name in subject["cert_common_names"]}
    rules = {rule["id"]: rule for rule in table["rules"]}
    granted = [
        rules[rule] for policy in table["policies"] if subjects & set(policy["subjects"]) for rule in policy["rules"]
    ]
    return any(
        flow in rule["flows"]
        and message in rule["messages"]
        and any(zenoh.KeyExpr(held).includes(zenoh.KeyExpr(key)) for held in rule["key_exprs"])
        for rule in granted
    )


rig = Keys("bench")
TABLE = access_control(EVERYBODY)


@pytest.mark.parametrize("name", ["op1", "view1"])
def test_clients_see_everything_and_say_nothing(name: str) -> None:
    for key in (rig.status, rig.manifest, Keys("*").status):
        assert allowed(TABLE, name, "ingress", "query", key)
        assert allowed(TABLE, name, "egress", "reply", key)
    for topic in STREAMS:
        assert allowed(TABLE, name, "ingress", "declare_subscriber", rig.key(topic))
        assert allowed(TABLE, name, "egress", "put", rig.key(topic))
    for key in ("viewsep/*/alive/*", rig.alive("*")):
        assert allowed(TABLE, name, "ingress", "liveliness_query", key)
        assert allowed(TABLE, name, "ingress", "declare_liveliness_subscriber", key)
    assert allowed(TABLE, name, "egress", "liveliness_token", rig.alive("rig"))
    for key in (rig.status, rig.key("percept"), rig.command("stop"), rig.alive("rig"), rig.remote("move")):
        for message in ("put", "delete", "declare_queryable", "reply"):
            assert not allowed(TABLE, name, "ingress", message, key)
    for flow in ("ingress", "egress"):
        for message in (*WRITES, "declare_subscriber"):
            assert not allowed(TABLE, name, flow, message, rig.remote("move"))
    assert not allowed(TABLE, name, "ingress", "liveliness_token", rig.alive("rig"))


def test_operators_command_and_hold_leases_and_viewers_do_not() -> None:
    for name, may in (("op1", True), ("view1", False)):
        assert allowed(TABLE, name, "ingress", "query", rig.command("stop")) is may
        assert allowed(TABLE, name, "egress", "reply", rig.command("stop")) is may
        assert allowed(TABLE, name, "ingress", "liveliness_token", rig.lease("abc")) is may


@pytest.mark.parametrize("name", ["rig1", "engine1"])
def test_rigs_and_engines_speak_for_each_other_below_viewsep_only(name: str) -> None:
    for flow in ("ingress", "egress"):
        for message in (*WRITES, "declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"):
            assert allowed(TABLE, name, flow, message, rig.remote("move"))
            assert not allowed(TABLE, name, flow, message, "other/move")
            assert not allowed(TABLE, name, flow, message, "@/**")


@given(st.dictionaries(st.from_regex(r"[A-Za-z0-9_.-]{1,64}", fullmatch=True), st.sampled_from(KeyRole)))
def test_every_subject_has_names_and_everybody_gets_his_role_alone(names: dict[str, KeyRole]) -> None:
    table = access_control(names)
    assert (table["enabled"], table["default_permission"]) == (True, "deny")
    assert all(subject["cert_common_names"] for subject in table["subjects"])  # without names it would be everybody
    held = [(name, subject["id"]) for subject in table["subjects"] for name in subject["cert_common_names"]]
    assert sorted(held) == sorted((name, role.value) for name, role in names.items())
    rules = {rule["id"] for rule in table["rules"]}
    assert len(rules) == len(table["rules"])
    assert rules == {rule for policy in table["policies"] for rule in policy["rules"]}
    assert not allowed(table, "stranger!", "ingress", "query", rig.status)
