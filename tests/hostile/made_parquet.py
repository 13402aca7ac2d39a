"""Parquet files that are well formed and mean harm."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import io
import random

import numpy as np
from made import Made
from seeds import NAMES, T_NS, VALUES


def parquet(rng: random.Random) -> Made:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kind, n = rng.randrange(14), 60
    time: pa.Array = pa.array(T_NS[:n], pa.timestamp("ns"))
    columns: dict[str, pa.Array] = {name: pa.array(VALUES[:n, i]) for i, name in enumerate(NAMES)}
    options: dict[str, object] = {}
    if kind == 0:
        unit, value = rng.choice((("s", 2**33), ("s", 2**52), ("ms", -(2**62)), ("us", 2**62), ("ns", -(2**63) + 1)))
        time = pa.array([value + i for i in range(n)], pa.timestamp(unit))
    elif kind == 1:
        time = rng.choice((
            pa.array([f"2024-01-01 00:00:{i:02d}" for i in range(n)]), pa.array([None] * n, pa.float64()), pa.array([float("nan")] * n), pa.array([True] * n), pa.array([[0.0]] * n),
            pa.array(list(range(n)), pa.date32()), pa.array(list(range(n)), pa.time64("ns")), pa.array(list(range(n)), pa.duration("s")), pa.array([2**64 - 1] * n, pa.uint64()), pa.array([1e300 * i for i in range(n)]),
            pa.array(np.arange(n, dtype=np.float16)), pa.array([float("inf")] * n), pa.array([b"x"] * n), pa.array(list(range(n)), pa.timestamp("ms", tz="Nonsense/Zone")),
        ))  # fmt: skip
    elif kind == 2:
        rows = 40_000_000
        table = pa.table({"time": pa.array(np.zeros(1_000_000)), "FW": pa.array(np.zeros(1_000_000))})
        out = io.BytesIO()
        with pq.ParquetWriter(out, table.schema) as file:
            for _ in range(rows // 1_000_000):
                file.write_table(table)
        return ".parquet", out.getvalue(), f"Parquet: {rows} equal rows"
    elif kind == 3:
        columns |= {f"c{i}": pa.array([0.0] * n) for i in range(rng.choice((500, 3000)))}
    elif kind == 4:
        odd = (
            pa.array([[1.0] * (i % 5) for i in range(n)]),
            pa.array([{"x": 1.0, "y": {"z": i}} for i in range(n)]),
            pa.array([None] * n),
            pa.nulls(n),
            pa.array([2**63 + i for i in range(n)], pa.uint64()),
            pa.array([b"\xff"] * n),
        )
        columns[rng.choice(("FW", "more"))] = rng.choice(odd)
    elif kind == 5:
        import decimal

        columns["FW"] = pa.array(
            [decimal.Decimal(i).scaleb(rng.choice((-3, 0))) for i in range(n)], pa.decimal128(38, 3)
        )
    elif kind == 6:
        nested = pa.array([1.0] * n)
        for i in range(rng.choice((5, 60, 300))):
            nested = pa.StructArray.from_arrays([nested], [f"l{i}"])
        columns["deep"] = nested
    elif kind == 7:
        columns = {
            rng.choice(("", "\0", "x" * 100_000, "FW]", "\x1b[31m", "a.b", "time")): values
            for values in columns.values()
        }
    elif kind == 8:
        columns["FW"] = columns["FW"].dictionary_encode()
    elif kind == 9:
        time = pa.array(T_NS[:n] / 1e9).take(pa.array(rng.sample(range(n), n)))
    elif kind == 10:
        return ".parquet", _written(pa.table({}), pq), "Parquet: no column"
    elif kind == 11:
        time, columns = pa.array([], pa.timestamp("ns")), {name: pa.array([], pa.float64()) for name in NAMES}
    elif kind == 12:
        values = VALUES[:n, 0].copy()
        values[rng.randrange(n)] = rng.choice((np.nan, np.inf, -np.inf, 1e308))
        columns["FW"] = pa.array(values)
    fields = [
        pa.field("time", time.type),
        *(pa.field(name, values.type, metadata={"unit": "mm"}) for name, values in columns.items()),
    ]
    table = pa.table([time, *columns.values()], pa.schema(fields))
    if kind == 13:
        table = table.replace_schema_metadata({b"pandas": b"{" * 1000, b"\xff": b"\xff", b"fmucorrect": b"\x00" * 10})
    return ".parquet", _written(table, pq, **options), f"Parquet: kind {kind}, time {time.type}"


def _written(table: object, pq: object, **options: object) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out, **options)  # type: ignore[attr-defined]
    return out.getvalue()
