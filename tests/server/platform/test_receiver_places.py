"""Where webhooks may go: the grammar of the list, and what a name may lead to."""

from __future__ import annotations

import ipaddress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.platform.receiver_places import address_of, entry, listed, receiver


@pytest.mark.parametrize(
    ("url", "place"),
    [
        ("https://erp.example/hooks?a=b", ("https", "erp.example", 443, "/hooks?a=b")),
        ("http://ERP.example:8080", ("http", "erp.example", 8080, "/")),
        ("https://[2001:db8::7]:8443/x", ("https", "2001:db8::7", 8443, "/x")),
    ],
)
def test_a_receiver_is_scheme_host_port_and_path(url: str, place: tuple[str, str, int, str]) -> None:
    found = receiver(url)
    assert (found.scheme, found.host, found.port, found.target) == place


@pytest.mark.parametrize(
    "url",
    [
        "", "erp.example", "file:///etc/passwd", "https://", "https://a@b/", "https://a:b@c/", "https://a/#x",
        "https://a/\r\nx", "https://a b/", "https://a:99999/", "https://a:x/", "gopher://a/", "https://a\\b/", "https://-a/",
    ],
)  # fmt: skip
def test_what_is_no_receiver_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="write https://"):
        receiver(url)


@pytest.mark.parametrize(
    "text", ["https://a/path", "https://a in 300.0.0.0/8", "https://a in", "a", "https://a in 10.0.0.1/8"]
)
def test_what_is_no_entry_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        entry(text)


#: Addresses where no receiver of the internet is: this computer, its links, private networks, metadata of clouds.
INSIDE = [
    "127.0.0.1", "127.8.8.8", "::1", "0.0.0.0", "::", "169.254.169.254", "fe80::1", "10.0.0.1", "172.16.0.1",
    "192.168.1.1", "100.64.0.1", "fc00::1", "224.0.0.1", "ff02::1", "255.255.255.255", "::ffff:127.0.0.1",
    "::ffff:10.0.0.1", "64:ff9b::7f00:1", "2002:7f00:1::", "192.0.2.1",
]  # fmt: skip


@pytest.mark.parametrize("address", INSIDE)
def test_a_name_of_the_internet_leads_nowhere_inside(address: str) -> None:
    wanted = receiver("https://erp.example/")
    assert address_of(wanted, ["https://erp.example"], lambda host, port: [address]) is None
    assert address_of(wanted, ["https://erp.example"], lambda host, port: [address, "1.1.1.1"]) == "1.1.1.1"


def test_a_name_of_the_site_leads_into_its_network_only() -> None:
    wanted, places = receiver("https://erp.local/"), ["https://erp.local in 192.168.7.0/24"]
    for address, allowed in (("192.168.7.4", True), ("192.168.8.4", False), ("1.1.1.1", False), ("127.0.0.1", False)):
        found = address_of(wanted, places, lambda host, port, address=address: [address])  # type: ignore[misc]
        assert (found == address) is allowed


def test_an_address_that_is_listed_is_let_through() -> None:
    assert address_of(receiver("http://127.0.0.1:80/"), ["http://127.0.0.1"], lambda host, port: [host]) == "127.0.0.1"
    assert address_of(receiver("http://127.0.0.2:80/"), ["http://127.0.0.1"], lambda host, port: [host]) is None


def test_nothing_is_resolved_for_what_is_not_listed() -> None:
    def never(host: str, port: int) -> list[str]:
        raise AssertionError(host)

    assert address_of(receiver("https://other.example/"), ["https://erp.example"], never) is None
    assert listed(receiver("https://erp.example:444/"), ["https://erp.example"]) == ()


@given(st.ip_addresses(), st.sampled_from(["10.0.0.0/8", "2001:db8::/32", "127.0.0.0/8"]))
def test_a_network_lets_through_its_addresses_and_no_others(
    address: ipaddress.IPv4Address | ipaddress.IPv6Address, network: str
) -> None:
    found = address_of(
        receiver("https://a.example/"), [f"https://a.example in {network}"], lambda host, port: [str(address)]
    )
    assert (found is not None) is (address in ipaddress.ip_network(network))
