"""Record files that are well formed and mean harm: bombs, deep nesting, endless types, impossible stamps, wrong types."""

from __future__ import annotations

import random
from collections.abc import Callable

from made import Made
from made_csv import csv
from made_mat import mat, mat73
from made_mcap import channels_mcap, chunk_mcap, clock_mcap, json_mcap, protobuf_mcap, ros2_mcap
from made_mdf import mf4
from made_parquet import parquet
from made_tdms import tdms

MAKERS: tuple[Callable[[random.Random], Made], ...] = (
    json_mcap, json_mcap, json_mcap, clock_mcap, protobuf_mcap, ros2_mcap, chunk_mcap, channels_mcap,
    csv, csv, csv, parquet, parquet, mf4, tdms, mat, mat73,
)  # fmt: skip
