"""MATLAB files, 5 and 7.3, that are well formed and mean harm."""

from __future__ import annotations

import io
import random
import struct
import tempfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np
from archives import zeros
from made import BOMB_MB, Made
from seeds import NAMES, ROWS, T_NS, VALUES


def mat(rng: random.Random) -> Made:
    import scipy.io

    kind, out = rng.randrange(10), io.BytesIO()
    arrays: dict[str, object] = {"time": (T_NS / 1e9)[:, None]} | {
        name: VALUES[:, i : i + 1] for i, name in enumerate(NAMES)
    }
    options: dict[str, object] = {"do_compression": rng.random() < 0.5}
    if kind == 0:
        nested: object = 1.0
        for _ in range(rng.choice((10, 100, 200))):
            nested = {"a": nested}
        arrays["deep"] = nested
    elif kind == 1:
        cells = np.empty((ROWS, 1), object)
        cells[:] = [["x"]]
        arrays["FW"] = cells
    elif kind == 2:
        import scipy.sparse

        arrays["FW"] = scipy.sparse.csc_matrix(rng.choice(((10**9, 1), (ROWS, 1))))
    elif kind == 3:
        arrays["FW"] = rng.choice(
            (
                VALUES[:, :1] * 1j,
                np.array(["text"] * ROWS),
                np.zeros((0, 0)),
                np.zeros((2, 3, 4, 5)),
                np.full((ROWS, 1), 2**63 - 1, np.int64),
                VALUES[:, :1] > 0,
            )
        )
    elif kind == 4:
        stamps = (T_NS / 1e9)[:, None].copy()
        stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -1.0))
        arrays["time"] = stamps
    elif kind == 5:
        arrays["time"] = rng.choice(
            (np.zeros((1, 1)), np.array(["a"]), np.zeros((0, 0)), (T_NS / 1e9)[None, :], VALUES, 1j * VALUES[:, :1])
        )
    elif kind == 6:
        arrays |= {f"c{i}": VALUES[:, :1] for i in range(rng.choice((100, 1500)))}
    elif kind == 7:
        arrays = {
            "out": {
                "time": arrays["time"],
                "signals": {
                    "values": VALUES,
                    "label": rng.choice(("FW", 5, [])),
                    "dimensions": rng.choice((5, 0, [1, 2])),
                },
            }
        }
    elif kind == 8:
        scipy.io.savemat(out, arrays)
        return ".mat", out.getvalue() + _mat_bomb(), f"MATLAB 5: {BOMB_MB} MB of zeros from 2 MB"
    else:
        arrays = {"x": 1.0}
    scipy.io.savemat(out, arrays, **options)  # type: ignore[arg-type]
    return ".mat", out.getvalue(), f"MATLAB 5: kind {kind}"


@cache
def _mat_bomb() -> bytes:
    """A compressed element whose matrix is that large."""
    size = BOMB_MB << 20
    head = struct.pack("<IIIIIIIIIIII4sII", 14, size + 56, 6, 8, 6, 0, 5, 8, size // 8, 1, 1, 4, b"bomb", 9, size)
    crc, block = zlib.adler32(head), bytes(1 << 20)
    for _ in range(BOMB_MB):
        crc = zlib.adler32(block, crc)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    stream = (
        b"\x78\xda" + packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + zeros(BOMB_MB) + struct.pack(">I", crc)
    )
    return struct.pack("<II", 15, len(stream)) + stream


def mat73(rng: random.Random) -> Made:
    import h5py

    kind = rng.randrange(9)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for i, name in enumerate(NAMES):
                file.create_dataset(name, data=VALUES[None, :, i]).attrs["MATLAB_class"] = np.bytes_("double")
            file["time"] = (T_NS / 1e9)[None, :]
            if kind == 0:
                del file["FW"]
                file["FW"] = rng.choice(
                    (
                        h5py.ExternalLink("/etc/passwd", "/"),
                        h5py.SoftLink("/FW"),
                        h5py.SoftLink("/nowhere"),
                        h5py.ExternalLink("../in/run.mat", "/FB"),
                    )
                )
            elif kind == 1:
                del file["FW"]
                file.create_dataset("FW", (1, rng.choice((10**9, 10**12, 2**62))), "f8", chunks=(1, 1000))
            elif kind == 2:
                file.create_dataset(
                    "bomb", (1, 300_000_000), "f8", chunks=(1, 10_000_000), compression="gzip", fillvalue=0.0
                )[0, :10_000_000] = 0.0
            elif kind == 3:
                group = file
                for _ in range(rng.choice((50, 1500))):
                    group = group.create_group("a")
            elif kind == 4:
                file["loop"] = h5py.SoftLink("/")
                file["hard"] = file["/"]
            elif kind == 5:
                file["FW"].attrs["MATLAB_class"] = np.bytes_(
                    rng.choice((b"cell", b"struct", b"char", b"function_handle", b"", b"\xff"))
                )
            elif kind == 6:
                layout = h5py.VirtualLayout((1, ROWS), "f8")
                layout[:] = h5py.VirtualSource("/etc/passwd", "x", (1, ROWS))
                file.create_virtual_dataset("virtual", layout)
            elif kind == 7:
                del file["time"]
                file["time"] = rng.choice(
                    (np.full((1, ROWS), np.nan), np.zeros((0,)), np.array([b"x"] * 3), np.zeros((3, 3, 3)))
                )
            else:
                file.create_dataset("external", (1, ROWS), "f8", external=[("/etc/passwd", 0, 8 * ROWS)])
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 00:00:00 2024 HDF5 schema 1.00 ."
        with path.open("r+b") as stream:
            stream.write(head.ljust(116) + bytes(8) + b"\x00\x02IM")
        return ".mat", path.read_bytes(), f"MATLAB 7.3: kind {kind}"
