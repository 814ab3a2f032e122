"""Places that webhooks may be delivered to: a closed grammar, and what the administrator lists.

=============================================  ====================================================================
an entry of ``webhook_places``                 lets webhooks go to
=============================================  ====================================================================
``https://erp.example``                        this name and port, while it resolves to addresses of the internet
``https://erp.example:8443 in 192.0.2.0/24``   this name and port, while it resolves into this network
``http://192.0.2.7:8080``                      this address and port
=============================================  ====================================================================

The address that a name resolved to is looked at and then connected to, so a name that leads elsewhere meanwhile, to
this computer say, is refused. A name in the site's own network needs that network.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Callable, Collection
from dataclasses import dataclass
from urllib.parse import urlsplit

from daq.errors import BadValueError
from daq.machine.bus_places import host_name

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Network = ipaddress.IPv4Network | ipaddress.IPv6Network
#: Addresses of a host and port, as text; OSError if there are none.
Resolver = Callable[[str, int], Collection[str]]
_ENTRY = re.compile(r"(?P<origin>\S+)(?: in (?P<network>\S+))?")
_PATH = re.compile(r"[A-Za-z0-9._~!$&'()*+,;=:@%/?\-]*")
_PORTS = {"https": 443, "http": 80}
#: In which an address of this site may hide: NAT64 and 6to4.
_WRAPPED = (ipaddress.ip_network("64:ff9b::/96"), ipaddress.ip_network("2002::/16"))


@dataclass(frozen=True)
class Receiver:
    """Listener to webhooks; ``target``: path and query, ``network``: into which its name has to resolve."""

    scheme: str
    host: str
    port: int
    target: str = "/"
    network: Network | None = None

    def same_place(self, other: Receiver) -> bool:
        """Test whether both are one scheme, host and port."""
        return (self.scheme, self.host, self.port) == (other.scheme, other.host, other.port)


def receiver(url: str) -> Receiver:
    """Parse what a URL leads to (ValueError, one line, for what is not https or http, has a user or fragment)."""
    try:
        if not url.isascii() or not url.isprintable():  # what urlsplit would take out is refused as well
            raise ValueError
        parts = urlsplit(url)
        port = parts.port or _PORTS.get(parts.scheme, 0)
        host = host_name((parts.hostname or "").lower())
    except ValueError:
        raise BadValueError("server.leads_nowhere", url=url) from None
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    if parts.scheme not in _PORTS or "@" in parts.netloc or parts.fragment or not _PATH.fullmatch(target):
        raise BadValueError("server.no_receiver", url=url)
    return Receiver(parts.scheme, host, port, target)


def entry(text: str) -> Receiver:
    """Parse what an entry of the list lets through (ValueError if it is none)."""
    found = _ENTRY.fullmatch(text)
    if found is None:
        raise BadValueError("server.no_webhook_place", text=text)
    place = receiver(found["origin"])
    if place.target != "/":
        raise BadValueError("server.no_path_here", text=text)
    network = None if found["network"] is None else ipaddress.ip_network(found["network"])
    return Receiver(place.scheme, place.host, place.port, network=network)


def check_receiver_entry(text: str) -> str:
    """Return an entry as it is (ValueError if it is none)."""
    entry(text)
    return text


def listed(wanted: Receiver, places: Collection[str]) -> tuple[Receiver, ...]:
    """List the entries that name the place of a receiver."""
    return tuple(own for own in map(entry, places) if own.same_place(wanted))


def resolved(host: str, port: int) -> tuple[str, ...]:
    """Resolve a host to addresses (OSError if there are none)."""
    return tuple(str(found[4][0]) for found in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))


def address_of(wanted: Receiver, places: Collection[str], resolve: Resolver = resolved) -> str | None:
    """Choose the address to connect to: the first of the receiver's that the list allows; None without one."""
    entries = listed(wanted, places)
    for text in resolve(wanted.host, wanted.port) if entries else ():
        address = ipaddress.ip_address(text.partition("%")[0])
        if any(_lets(own, address) for own in entries):
            return str(address)
    return None


def _lets(own: Receiver, address: Address) -> bool:
    mapped = getattr(address, "ipv4_mapped", None)
    if mapped is not None:
        address = mapped
    if own.network is not None:
        return address in own.network
    if own.host == str(address):
        return True
    wrapped = any(address in network for network in _WRAPPED)
    return address.is_global and not address.is_multicast and not wrapped
