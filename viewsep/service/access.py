"""Who may do what on Zenoh: the access control that follows from the register of keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from viewsep.keys import KeyRole
from viewsep.service.names import PREFIX, PUBLISHED, Keys

_ANY = Keys("*")
_ASKED = (_ANY.status, _ANY.manifest)
_COMMANDS = (_ANY.command("*"),)
_STREAMS = tuple(_ANY.key(topic) for topic in PUBLISHED)
_ALIVE = (_ANY.alive("*"),)
_LEASE = (_ANY.lease("*"),)
_EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
)


def _rule(name: str, flow: Sequence[str], messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flow),
        "messages": list(messages),
        "key_exprs": list(keys),
    }


_SERVE = (_rule("serve", ("ingress", "egress"), _EVERYTHING, (f"{PREFIX}/**",)),)
_SEE = (
    _rule("ask", ("ingress",), ("query",), _ASKED),
    _rule("be-answered", ("egress",), ("reply", "declare_queryable"), _ASKED),
    _rule("subscribe", ("ingress",), ("declare_subscriber",), _STREAMS),
    _rule("receive", ("egress",), ("put",), _STREAMS),
    _rule("watch", ("ingress",), ("declare_liveliness_subscriber", "liveliness_query"), _ALIVE),
    _rule("be-told", ("egress",), ("liveliness_token",), _ALIVE),
)
_COMMAND = (
    _rule("command", ("ingress",), ("query",), _COMMANDS),
    _rule("be-obeyed", ("egress",), ("reply", "declare_queryable"), _COMMANDS),
    _rule("hold", ("ingress",), ("liveliness_token",), _LEASE),
)
_RULES = {
    KeyRole.RIG: _SERVE,
    KeyRole.ENGINE: _SERVE,
    KeyRole.OPERATOR: _SEE + _COMMAND,
    KeyRole.VIEWER: _SEE,
}


def access_control(names: Mapping[str, KeyRole]) -> dict[str, Any]:
    """Zenoh's `access_control` table for a serving session; `names` are the common names of the certificates.

    What no rule allows is denied. A query, a subscription or a token must lie within one key expression of its rule.
    Rig and engine may do everything: they pass on what the clients of the other say. Only they publish and answer.
    """
    holders = {role: sorted(name for name, held in names.items() if held is role) for role in KeyRole}
    present = [role for role, held in holders.items() if held]  # a subject without names would be everybody
    rules = {rule["id"]: rule for role in present for rule in _RULES[role]}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(rules.values()),
        "subjects": [{"id": role.value, "cert_common_names": holders[role]} for role in present],
        "policies": [{"subjects": [role.value], "rules": [rule["id"] for rule in _RULES[role]]} for role in present],
    }
