"""What a run gives, shown while it runs: to Foxglove, and to whatever else speaks its protocol."""

from fmucorrect.live.address import Address, address
from fmucorrect.live.view import Live, live_layout

__all__ = ["Address", "Live", "address", "live_layout"]
