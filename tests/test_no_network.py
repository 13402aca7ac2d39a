"""Nothing is told to anybody: a demonstration opens no connection, neither from Python nor from a library in it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
static void tell(const char *what, int family)
{
    FILE *file = fopen(getenv("TOLD"), "a");
    if (file) {
        fprintf(file, "%s %d\n", what, family);
        fclose(file);
    }
}
int socket(int family, int type, int protocol)
{
    if (family == AF_INET || family == AF_INET6)
        tell("socket", family);
    int (*next)(int, int, int) = dlsym(RTLD_NEXT, "socket");
    return next(family, type, protocol);
}
int connect(int descriptor, const struct sockaddr *address, socklen_t length)
{
    if (address->sa_family == AF_INET || address->sa_family == AF_INET6)
        tell("connect", address->sa_family);
    int (*next)(int, const struct sockaddr *, socklen_t) = dlsym(RTLD_NEXT, "connect");
    return next(descriptor, address, length);
}
struct addrinfo;
int getaddrinfo(const char *node, const char *service, const struct addrinfo *hints, struct addrinfo **found)
{
    tell("getaddrinfo", 0);
    int (*next)(const char *, const char *, const struct addrinfo *, struct addrinfo **) = dlsym(RTLD_NEXT, "getaddrinfo");
    return next(node, service, hints, found);
}
"""


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library that tells of every internet socket that its process asks the system for."""
    if sys.platform != "linux":
        pytest.skip("libraries are put before others by LD_PRELOAD, which is Linux's")
    folder = tmp_path_factory.mktemp("watched")
    (folder / "shim.c").write_text(SHIM)
    compiler = [sys.executable, "-m", "ziglang", "cc"] if shutil.which("cc") is None else ["cc"]
    made = subprocess.run(
        [*compiler, "-shared", "-fPIC", "-o", str(folder / "shim.so"), str(folder / "shim.c"), "-ldl"],
        capture_output=True,
    )
    if made.returncode:
        pytest.skip("there is no C compiler")
    return folder / "shim.so"


def told(shim: Path, folder: Path, *command: str) -> str:
    """What the command asked the system for. It must succeed."""
    words = folder / "told"
    words.touch()
    known = {key: value for key, value in os.environ.items() if key != "ORT_DISABLE_TELEMETRY"}
    ran = subprocess.run(
        [sys.executable, *command],
        env={**known, "LD_PRELOAD": str(shim), "TOLD": str(words)},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert ran.returncode == 0, ran.stderr
    return words.read_text()


def test_the_watch_sees_what_there_is(watched: Path, tmp_path: Path) -> None:
    assert "socket 2" in told(watched, tmp_path, "-c", "import socket; socket.socket()")


def test_a_demonstration_opens_no_connection(watched: Path, tmp_path: Path) -> None:
    assert told(watched, tmp_path, "-m", "fmucorrect", "demo", "-o", str(tmp_path / "out")) == ""
    assert (tmp_path / "out").exists()


def test_a_live_view_listens_and_calls_nobody(watched: Path, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    code = "import fmucorrect as fc, numpy as np\nchannels = (fc.Channel('x'),)\n"
    code += "with fc.Live(fc.live.Address(port=0), wait=0.0) as live:\n"
    code += "    live.take(fc.Record(np.arange(9), np.zeros((9, 1)), channels))\n"
    assert told(watched, tmp_path, "-c", code) == "socket 2\n"
