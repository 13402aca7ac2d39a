"""Where a live view listens."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address

from fmucorrect.errors import LiveError

PORT = 8765
"""The port that Foxglove proposes."""


@dataclass(frozen=True)
class Address:
    """An IP address of this machine, and a port; 0: any that is free."""

    host: str = "127.0.0.1"
    port: int = PORT

    @property
    def loopback(self) -> bool:
        """Whether only this machine reaches it."""
        return ip_address(self.host).is_loopback

    @property
    def url(self) -> str:
        """What to open in Foxglove."""
        host = f"[{self.host}]" if isinstance(ip_address(self.host), IPv6Address) else self.host
        return f"ws://{host}:{self.port}"


def address(text: str) -> Address:
    """`ADDRESS` or `ADDRESS:PORT`, an IPv6 address with a port in brackets. Raises LiveError."""
    host, port = text, str(PORT)
    if text.startswith("[") and "]" in text:
        host, _, rest = text[1:].partition("]")
        port = rest.removeprefix(":") if rest else port
    elif text.count(":") == 1:
        host, port = text.split(":")
    try:
        ip_address(host)
        if not (port.isascii() and port.isdigit() and int(port) < 2**16):
            raise ValueError
    except ValueError:
        raise LiveError(
            "this is no address to listen at",
            expected="ADDRESS or ADDRESS:PORT, as 192.0.2.7, 127.0.0.1:8766 or [::1]:8765",
            got=repr(text),
        ) from None
    return Address(host, int(port))
