"""A viewer: python viewer.py URL"""

from __future__ import annotations

import asyncio
import json
import sys

import websockets


async def watch(url: str) -> None:
    """Subscribe to all that is there, and take it until the server ends."""
    numbers: set[int] = set()
    async with websockets.connect(
        url, subprotocols=[websockets.Subprotocol("foxglove.sdk.v1")], max_size=None
    ) as server:
        async for message in server:
            told = json.loads(message) if isinstance(message, str) else {"op": "data"}
            numbers |= {channel["id"] for channel in told.get("channels", [])}
            if told["op"] == "advertise" or told.get("level") == 2:  # an error: it did not know its own channel yet
                wanted = [{"id": number, "channelId": number} for number in numbers]
                await server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


if __name__ == "__main__":
    asyncio.run(watch(sys.argv[1]))
