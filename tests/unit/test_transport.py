"""Which endpoints may be used. Real sessions: test_service_security.py, test_service_network.py."""

from __future__ import annotations

from ipaddress import IPv4Address, IPv6Address
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.config import ServiceConfig
from viewsep.errors import BadConfig
from viewsep.service.transport import Endpoint, check_endpoint, client_session, parse_endpoint, serving_session

labels = st.from_regex(r"[a-z]([a-z0-9-]{0,10}[a-z0-9])?", fullmatch=True)
hosts = st.one_of(
    st.ip_addresses(v=4).map(str),
    st.ip_addresses(v=6).map(str),
    st.lists(labels, min_size=1, max_size=4).map(".".join),
)


@given(protocol=st.sampled_from(["tcp", "tls", "quic"]), host=hosts, port=st.integers(0, 65535))
def test_endpoints_are_read_as_they_are_written(protocol: str, host: str, port: int) -> None:
    written = f"[{host}]" if ":" in host else host
    assert parse_endpoint(f"{protocol}/{written}:{port}", "listen") == Endpoint(protocol, host, port)


@given(st.text(alphabet="tcps/:[]0123456789.#?=-a*%@ \n", max_size=24).map(lambda tail: f"tcp/{tail}"))
def test_what_is_used_without_keys_is_a_loopback_address(text: str) -> None:
    try:
        endpoint = check_endpoint(text, "listen", secure=False)
    except BadConfig as error:
        assert "key 'listen' = " in str(error)  # noqa: PT017
        return
    assert endpoint.host == "localhost" or IPv4Address(endpoint.host).is_loopback


@given(st.ip_addresses(v=4))
def test_of_ipv4_only_127_is_loopback(address: IPv4Address) -> None:
    assert Endpoint("tcp", str(address), 1).loopback == str(address).startswith("127.")


@given(st.ip_addresses(v=6))
def test_of_ipv6_only_1_is_loopback(address: IPv6Address) -> None:
    assert Endpoint("tcp", str(address), 1).loopback == (int(address) == 1)


@pytest.mark.parametrize("text", ["tcp/127.0.0.1:7447", "tcp/127.9.9.9:0", "tcp/[::1]:7447", "tcp/localhost:7447"])
def test_loopback_needs_no_keys(text: str) -> None:
    check_endpoint(text, "listen", secure=False)


@pytest.mark.parametrize("text", ["tls/0.0.0.0:7447", "quic/[::]:7447", "tls/rig.example.org:1", "tls/127.0.0.1:0"])
def test_with_keys_every_address_may_be_used(text: str) -> None:
    check_endpoint(text, "listen", secure=True)


SYNTAX = "is no endpoint: write tcp/127.0.0.1:7447 or tls/"
PLAIN = "without keys anybody could listen in or pose as the rig, .*: make keys with `viewsep keys init` and use tls"
WITHOUT_KEYS = {
    "": SYNTAX,
    "127.0.0.1:7447": SYNTAX,
    "tcp/127.0.0.1": SYNTAX,
    "tcp/127.0.0.1:65536": SYNTAX,
    "tcp/127.0.0.1:-1": SYNTAX,
    "tcp/127.0.0.1:٣": SYNTAX,
    "tcp/127.0.0.1:7447 ": SYNTAX,
    "tcp/127.0.0.1:7447\n": SYNTAX,
    "tcp/127.0.0.1:7447#iface=eth0": SYNTAX,
    "tcp/127.0.0.1:7447?rel=1": SYNTAX,
    "tcp/127.0.0.1:7447;tcp/0.0.0.0:7447": SYNTAX,
    "tcp/::1:7447": SYNTAX,
    "tcp/[127.0.0.1]:7447": SYNTAX,
    "tcp/[::1%lo]:7447": SYNTAX,
    "tcp/127.1:7447": SYNTAX,
    "tcp/127.0.0.01:7447": SYNTAX,
    "tcp/2130706433:7447": SYNTAX,
    "tcp/*:7447": SYNTAX,
    "tcp/local_host:7447": SYNTAX,
    "unixsock-stream/tmp:1": SYNTAX,
    "tcp/0.0.0.0:7447": PLAIN,
    "tcp/[::]:7447": PLAIN,
    "tcp/[::ffff:127.0.0.1]:7447": PLAIN,
    "tcp/192.0.2.7:7447": PLAIN,
    "tcp/rig.example.org:7447": PLAIN,
    "tcp/localhost.example.org:7447": PLAIN,
    "tcp/0x7f000001:7447": PLAIN,
    "udp/127.0.0.1:7447": "use tcp on a loopback address, or tls with keys",
    "udp/224.0.0.224:7446": "use tcp on a loopback address, or tls with keys",
    "ws/127.0.0.1:7447": "use tcp on a loopback address, or tls with keys",
    "tls/127.0.0.1:7447": "tls needs keys: make them with `viewsep keys init`",
}


@pytest.mark.parametrize(("text", "words"), WITHOUT_KEYS.items())
def test_what_is_refused_without_keys(text: str, words: str) -> None:
    with pytest.raises(BadConfig, match=f"^key 'service.listen' = .*{words}"):
        serving_session(ServiceConfig(), [text], ())
    with pytest.raises(BadConfig, match=f"^key 'service.connect' = .*{words}"):
        serving_session(ServiceConfig(), (), [text])
    with pytest.raises(BadConfig, match=f"^key 'connect' = .*{words}"):
        client_session([text], None, "", 0.1)


def test_pictures_are_not_forgotten() -> None:
    service = ServiceConfig(listen_images=("tcp/0.0.0.0:7448",))
    with pytest.raises(BadConfig, match=r"key 'service\.listen_images' = 'tcp/0\.0\.0\.0:7448': without keys"):
        serving_session(service, service.listen_images, ())


def test_what_is_refused_with_keys(tmp_path: Path) -> None:
    words = r"key 'connect' = 'tcp/127.0.0.1:1': with keys only tls/ and quic/ are used: write tls/127.0.0.1:1"
    with pytest.raises(BadConfig, match=words):
        client_session(["tcp/127.0.0.1:1"], tmp_path, "op", 0.1)
    with pytest.raises(BadConfig, match=r"there is no .*op.key: copy ca.pem, op.pem and op.key"):
        client_session(["tls/127.0.0.1:1"], tmp_path, "op", 0.1)
    with pytest.raises(BadConfig, match="port 0 cannot be connected to"):
        client_session(["tls/127.0.0.1:0"], tmp_path, "op", 0.1)
    with pytest.raises(BadConfig, match="no endpoint to connect to"):
        client_session([], tmp_path, "op", 0.1)
