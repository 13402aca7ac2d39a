"""The live view, seen by a stranger: a WebSocket client that knows the protocol from its specification alone.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

from __future__ import annotations

import base64
import json
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import by_pythonfmu
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from test_cli import STUDY, call, log, model, refused  # noqa: F401 (a fixture)

from fmucorrect import live as viewing
from fmucorrect import records
from fmucorrect.errors import LiveError, MissingExtra
from fmucorrect.live import Address, Live, address, live_layout
from fmucorrect.records.message import message_type
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import ReplayStepper, corrected_channels, corrections, grid, run

websockets = pytest.importorskip("websockets.sync.client")
pytest.importorskip("foxglove")

ONE = (Channel("x", unit="mm"),)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@dataclass
class Viewer(threading.Thread):
    """Subscribes to the topics (all, where none are named) and keeps what comes: by topic, stamp and fields."""

    url: str
    topics: tuple[str, ...] = ()
    protocol: str = "foxglove.sdk.v1"
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    got: dict[str, list[tuple[int, dict[str, Any]]]] = field(default_factory=lambda: defaultdict(list))
    times: list[int] = field(default_factory=list)
    info: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)
        self.start()

    __hash__ = threading.Thread.__hash__

    def run(self) -> None:
        until = time.monotonic() + 60.0
        while True:
            try:
                connection = websockets.connect(self.url, subprotocols=[self.protocol], max_size=None, close_timeout=1)
                break
            except OSError:
                assert time.monotonic() < until, "nobody listens"
                time.sleep(0.02)
        kinds: dict[int, tuple[str, Any]] = {}
        with connection as server:
            assert server.subprotocol == self.protocol
            for message in server:
                if isinstance(message, str):
                    told = json.loads(message)
                    if told["op"] == "serverInfo":
                        self.info = told
                    for channel in told.get("channels", []):
                        self.channels[channel["topic"]] = channel
                        if not self.topics or channel["topic"] in self.topics:
                            kinds[100 + channel["id"]] = channel["topic"], self.message_class(channel)
                    if (
                        told["op"] == "advertise" or told.get("level") == 2
                    ):  # an error, where it knows its channel too late
                        wanted = [{"id": number, "channelId": number - 100} for number in kinds]
                        server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                elif message[0] == 1:  # message data: subscription, time of receipt, payload
                    number, stamp = struct.unpack("<IQ", message[1:13])
                    topic, kind = kinds[number]
                    read = kind.FromString(message[13:])
                    self.got[topic].append((stamp, {f.name: getattr(read, f.name) for f in read.DESCRIPTOR.fields}))
                elif message[0] == 2:
                    self.times.append(struct.unpack("<Q", message[1:9])[0])

    @staticmethod
    def message_class(channel: dict[str, Any]) -> Any:
        assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))

    def column(self, topic: str, name: str) -> np.ndarray:
        return np.array([fields[name] for _, fields in self.got[topic]])

    def stamps(self, topic: str) -> list[int]:
        """Sample times, ns, which every message carries itself."""
        return [10**9 * fields["stamp"].sec + fields["stamp"].nsec for _, fields in self.got[topic]]


def test_a_run_is_shown_as_it_is_written(model: Path, tmp_path: Path) -> None:  # noqa: F811
    port, out = free_port(), tmp_path / "run.mcap"
    viewer = Viewer(f"ws://127.0.0.1:{port}")
    run = ["run", STUDY, "--condition", "385", "--corrector", model, "--duration", 2]
    result = call(*run, "-o", out, "--listen", f"127.0.0.1:{port}")
    assert result.exit_code == 0, result.output
    assert f"ws://127.0.0.1:{port}" in result.output
    assert "live: 2001 samples shown\n" in result.output
    viewer.join(10)
    assert viewer.info["capabilities"] == ["time"]
    assert set(viewer.got) == {"/simulation", "/corrected", "/band"}
    for topic in ("/simulation", "/corrected"):
        written = records.read(out, topic=topic)
        assert viewer.stamps(topic) == written.t_ns.tolist() == [stamp for stamp, _ in viewer.got[topic]]
        for name in written.names:
            assert viewer.channels[topic]["metadata"][f"unit.{name}"] == written.channels[written.index(name)].unit
            assert np.array_equal(viewer.column(topic, name), written[name])
    corrected = records.read(out, topic="/corrected")
    for end, sign in (("lower", -2.0), ("upper", 2.0)):
        expected = corrected["FW_corrected"] + sign * corrected["FW_sigma"]
        assert np.array_equal(viewer.column("/band", f"FW_{end}"), expected)
    assert viewer.times == sorted(viewer.times)
    assert call(*run, "-o", tmp_path / "bare.mcap").exit_code == 0
    for topic in ("/simulation", "/corrected"):  # a view changes nothing
        bare, watched = (records.read(path, topic=topic) for path in (tmp_path / "bare.mcap", out))
        assert np.array_equal(bare.values, watched.values)


def test_the_layout_names_what_is_published(model: Path, tmp_path: Path) -> None:  # noqa: F811
    port, out = free_port(), tmp_path / "out.csv"
    viewer = Viewer(f"ws://127.0.0.1:{port}", protocol="foxglove.sdk.v1")
    replayed = ["replay", log(tmp_path / "in.csv"), "--corrector", model]
    condition = ["--speed", 385, "--amplitude", 0.03, "--frequency", 2, "--start", 10]
    result = call(*replayed, *condition, "-o", out, "--live", "--listen", f"127.0.0.1:{port}", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["live"] == {"shown": 200, "dropped": 0}
    viewer.join(10)
    panels = json.loads((tmp_path / "out.live.json").read_text("utf-8"))["configById"].values()
    paths = [path for panel in panels for path in panel["paths"]]
    assert len(paths) == 4 * 4 + 1
    fields = {f"{topic}.{name}" for topic, messages in viewer.got.items() for name in messages[0][1]}
    assert {path["value"] for path in paths} <= fields
    assert {path["timestampPath"] for path in paths} <= fields
    (tmp_path / "out.live.json").write_text("{}")
    refused(call(*replayed, *condition, "-o", out, "--overwrite", "--listen", "999.0.0.1"), "no address")
    out.unlink()
    refused(call(*replayed, *condition, "-o", out, "--live"), "out.live.json", "--overwrite")


def test_without_a_viewer_the_run_goes_on() -> None:
    with Live(Address(port=0), wait=0.05) as live:
        run(ReplayStepper(ONE), Condition("c"), live.timely([rows(0, 3000)]), live.take)
    assert (live.shown, live.dropped) == (0, 0)
    assert 0.05 <= live.waited < 5.0


def test_what_is_too_fast_to_be_shown_drops_the_oldest_and_is_counted() -> None:
    with Live(Address(port=0)) as live:
        viewer = Viewer(live.address.url)
        for start in range(0, 400_000, 1000):
            live.take(rows(start, start + 1000))
    viewer.join(10)
    stamps = viewer.stamps("/simulation")
    assert len(stamps) == live.shown
    assert live.shown + live.dropped == 400_000
    assert live.dropped > 0
    assert stamps == sorted(stamps)
    assert stamps[-30_000:] == list(range(370_000 * 1_000_000, 400_000 * 1_000_000, 1_000_000))


def test_one_topic_alone_can_be_watched_and_a_viewer_may_leave() -> None:
    with Live(Address(port=0)) as live:
        viewer = Viewer(live.address.url, ("/band",))
        live.take(corrected(0, 100))
    viewer.join(10)
    assert set(viewer.got) == {"/band"}
    leaving = """
import json, os, sys, time
from websockets.sync.client import connect
with connect(sys.argv[1], subprotocols=["foxglove.websocket.v1", "foxglove.sdk.v1"]) as server:
    while (told := json.loads(server.recv()))["op"] != "advertise":
        pass
    wanted = [{"id": 7, "channelId": told["channels"][0]["id"]}]
    server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    while isinstance(told := server.recv(), str):  # an error, where it knows its channel too late
        server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    os._exit(1)
"""
    with Live(Address(port=0)) as live:
        gone = subprocess.Popen([sys.executable, "-c", leaving, live.address.url])
        live.take(rows(0, 100))
        assert gone.wait(30) == 1
        time.sleep(0.5)
        seen = live.shown
        live.take(rows(100, 5000))
    assert 0 < seen <= 100
    assert (live.shown, live.dropped) == (seen, 0)


def rows(start: int, stop: int) -> Record:
    t_ns = np.arange(start, stop) * 1_000_000
    return Record(t_ns, np.sin(1e-9 * t_ns)[:, None], ONE)


def corrected(start: int, stop: int, names: tuple[str, ...] = ("x",)) -> Record:
    channels = tuple(Channel(name, unit="mm") for name in names)
    channels = (*channels, *corrected_channels(channels))
    t_ns = np.arange(start, stop) * 1_000_000
    return Record(t_ns, np.zeros((len(t_ns), len(channels))), channels)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_what_a_corrector_added_is_told_from_the_plants(count: int) -> None:
    names = [f"a{i}_sigma" for i in range(count)]  # the plant's own names do not mislead
    channels = tuple(Channel(name) for name in names)
    assert corrections(channels) == 0
    assert corrections((*channels, *corrected_channels(channels))) == count


def test_awkward_names_have_fields_of_their_own() -> None:
    record = corrected(0, 2, ("stamp", "α", "β", "a b", "a.b", "x_corrected"))
    told = json.loads(live_layout(record))
    values = [path["value"] for panel in told["configById"].values() for path in panel["paths"]]
    assert len(set(values)) == len(values) == 6 * 4 + 1
    stamps = {
        path["timestampPath"].partition(".")[2] for panel in told["configById"].values() for path in panel["paths"]
    }
    assert stamps == {"stamp_"}


def test_times_before_zero_and_far_ones() -> None:
    early = Record(np.array([-1_500_000_000, -1, 0, 2]), np.ones((4, 1)), ONE)
    kind = message_type("/simulation", early, "stamp")
    read = Viewer.message_class(
        {
            "encoding": "protobuf",
            "schemaEncoding": "protobuf",
            "schema": base64.b64encode(kind.descriptors),
            "schemaName": kind.schema,
        }
    )
    stamps = [read.FromString(payload).stamp for payload in kind.payloads(early)]
    assert [(s.sec, s.nsec) for s in stamps] == [(-2, 500_000_000), (-1, 999_999_999), (0, 0), (0, 2)]
    with Live(Address(port=0)) as live:
        viewer = Viewer(live.address.url)
        live.take(early)
    viewer.join(10)
    assert viewer.stamps("/simulation") == early.t_ns.tolist()
    with Live(Address(port=0)) as live, pytest.raises(LiveError, match="beyond"):
        live.take(Record(np.array([3 * 10**18]), np.ones((1, 1)), ONE))


def test_pieces_are_small_where_the_plant_is_slow() -> None:
    sizes: list[int] = []
    with Live(Address(port=0)) as live:
        for piece in live.timely(grid(0.1, 1_000_000)):
            sizes.append(len(piece))
            time.sleep(0.01 * len(piece))
        assert sum(sizes) == 101
        assert max(sizes) <= 32
        fast = [len(piece) for piece in live.timely([rows(0, 5000), rows(5000, 9000)])]
    assert sum(fast) == 9000
    assert max(fast) >= 2048
    assert fast[0] == 16


def test_addresses() -> None:
    assert address("192.0.2.7") == Address("192.0.2.7", 8765)
    assert address("127.0.0.1:9000").url == "ws://127.0.0.1:9000"
    assert address("[::1]:9000").url == "ws://[::1]:9000"
    assert address("::1") == Address("::1", 8765)
    assert [address(text).loopback for text in ("127.0.0.2", "::1", "0.0.0.0", "192.0.2.7")] == [
        True,
        True,
        False,
        False,
    ]
    for text in (
        "",
        "localhost",
        "127.0.0.1:",
        "127.0.0.1:x",
        "127.0.0.1:99999",
        "[::1]x",
        "1.2.3",
        "[127.0.0.1",
        ":8765",
    ):
        with pytest.raises(LiveError, match="no address"):
            address(text)


def test_what_cannot_be_listened_at_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = ["run", STUDY, "--condition", "385", "--duration", 0.1, "-o", tmp_path / "out.mcap", "--live"]
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        refused(call(*run, "--listen", f"127.0.0.1:{port}"), "cannot listen", f"port {port}", "in use", "--listen")
    refused(call(*run, "--listen", "192.0.2.7"), "cannot listen", "192.0.2.7", "--listen")
    monkeypatch.setitem(sys.modules, "foxglove", None)
    refused(call(*run), "foxglove-sdk", 'pip install "fmucorrect[live]"')
    with pytest.raises(MissingExtra):
        viewing.Live()
    assert not list(tmp_path.iterdir())


PENDULUM = """
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Pendulum(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.angle, self.rate = 0.5, 0.0
        self.register_variable(Real("angle", causality=Fmi2Causality.output))
        self.register_variable(Real("rate", causality=Fmi2Causality.output))

    def do_step(self, t, dt):
        self.rate -= 9.81 * math.sin(self.angle) * dt
        self.angle += self.rate * dt
        return True
"""


def test_a_strangers_fmu_is_watched_without_a_corrector(tmp_path: Path) -> None:
    by_pythonfmu(tmp_path, "Pendulum", PENDULUM)
    channel = '[[channels]]\nname = "{0}"\nsimulation = "{0}"\nmeasurement = "{0}"\nquantity = "angle"\nunit = "{1}"\n'
    (tmp_path / "measured.csv").write_text("time,angle [rad]\n0,0.5\n1,0.5\n")
    (tmp_path / "study.toml").write_text(
        'format = 1\nname = "pendulum"\n[simulation]\nfmu = "Pendulum.fmu"\nstep_size = 0.01\n'
        'units = { angle = "rad" }\n'
        + channel.format("angle", "rad")
        + '[[conditions]]\nname = "free"\nrole = "development"\nmeasurement = "measured.csv"\n'
    )
    port = free_port()
    viewer = Viewer(f"ws://127.0.0.1:{port}")
    listen = ["--listen", f"127.0.0.1:{port}"]
    result = call("run", tmp_path / "study.toml", "--condition", "free", "-o", tmp_path / "out.csv", *listen)
    assert result.exit_code == 0, result.output
    viewer.join(10)
    assert set(viewer.got) == {"/simulation"}
    written = records.read(tmp_path / "out.csv")
    assert np.allclose(viewer.column("/simulation", "angle"), written["angle"], rtol=1e-12)
    assert len(viewer.got["/simulation"]) == 101
    panels = json.loads((tmp_path / "out.live.json").read_text())["configById"]
    assert list(panels) == ["Plot!0"]
