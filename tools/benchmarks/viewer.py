"""A viewer: python viewer.py URL"""

from __future__ import annotations

import asyncio
import json
import sys

import websockets


async def watch(url: str) -> None:
    """Subscribe to all that is there, and take it until the server ends."""
    async with websockets.connect(
        url, subprotocols=[websockets.Subprotocol("foxglove.sdk.v1")], max_size=None
    ) as server:
        async for message in server:
            if isinstance(message, str) and (told := json.loads(message))["op"] == "advertise":
                wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in told["channels"]]
                await server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


if __name__ == "__main__":
    asyncio.run(watch(sys.argv[1]))
