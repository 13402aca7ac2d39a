"""compare.json, as its page takes it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.report.correction.page import Reference
from fmucorrect.report.training.ablation import Ablation
from fmucorrect.report.training.losses import Curve

Metric = Literal["r2", "nrmse", "nmae"]


@dataclass(frozen=True)
class Case:
    """A compared case: S seeds, C evaluation conditions, J channels. inputs: what it sees, in words. parameters: trained
    numbers. epochs: of the refit, by stage. held_out: mean NRMSE (%) of the development conditions, each left out of the fit
    in turn; None where none was. lags, samples, and shifted, R2: with the best time shift. coverage: of each condition, share
    inside the 90 % band of the seeds that have one. hour_later: NRMSE (%) on another clock; None where it was not computed."""

    name: str
    label: str
    family: str
    inputs: str
    parameters: int
    epochs: Mapping[str, int]
    held_out: float | None
    r2: Float64[np.ndarray, "S C J"]
    nrmse: Float64[np.ndarray, "S C J"]
    nmae: Float64[np.ndarray, "S C J"]
    lags: Int64[np.ndarray, "S C"]
    shifted: Float64[np.ndarray, "S C"]
    coverage: Sequence[Float64[np.ndarray, "K J"]]
    hour_later: Float64[np.ndarray, "S C"] | None
    curves: Sequence[Curve]

    def of(self, metric: Metric) -> Float64[np.ndarray, "S C J"]:
        """r2, nrmse (%) or nmae (%)."""
        return {"r2": self.r2, "nrmse": self.nrmse, "nmae": self.nmae}[metric]

    def scores(self, metric: Metric) -> Float64[np.ndarray, " S"]:
        """Its mean over evaluation conditions and channels, a value a seed."""
        return self.of(metric).mean(axis=(1, 2))

    @classmethod
    def read(cls, row: Mapping[str, Any], evaluation: Sequence[str]) -> Case:
        """A row of cases. KeyError for what is no such row."""
        runs: list[list[Mapping[str, Any]]] = [[run["conditions"][name] for name in evaluation] for run in row["runs"]]

        def all_of(key: str) -> Float64[np.ndarray, "S C J"]:
            return np.array([[item[key] for item in run] for run in runs], np.float64)

        later = [[item.get("hour_later_nrmse") for item in run] for run in runs]
        covered = [[run[i].get("coverage_90") for run in runs] for i in range(len(evaluation))]
        r2 = all_of("r2")
        return cls(
            name=row["case"],
            label=row["label"],
            family=row["family"],
            inputs=row["inputs"],
            parameters=row["parameters"],
            epochs=row["epochs"],
            held_out=row["held_out_nrmse"],
            r2=r2,
            nrmse=all_of("nrmse"),
            nmae=all_of("nmae"),
            lags=np.array([[item["oracle"]["lag_samples"] for item in run] for run in runs], np.int64),
            shifted=np.array([[item["oracle"]["mean_r2"] for item in run] for run in runs], np.float64),
            coverage=[
                np.array([shares for shares in each if shares is not None], np.float64).reshape(-1, r2.shape[2])
                for each in covered
            ],
            hour_later=None if any(None in run for run in later) else np.array(later, np.float64),
            curves=[Curve.read(curve) for curve in row["curves"]],
        )


@dataclass(frozen=True)
class Table:
    """A comparison of methods on one study. development, evaluation: names of the conditions. paper: the paper's figures by
    the case's name, and paper_oracle, its R2 with the best time shift, where the study repeats its experiment. order_holds:
    of each seed whether the paper's order holds, and why, in words. told: what the study left open, term and text. settings:
    as JSON."""

    study: str
    sha256: str
    channels: Sequence[str]
    unit: str
    development: Sequence[str]
    evaluation: Sequence[str]
    cases: Sequence[Case]
    paper: Sequence[Reference]
    paper_oracle: float | None
    order_holds: Sequence[bool]
    order_text: str
    ablation: Ablation | None
    told: Sequence[tuple[str, str]]
    warnings: Sequence[Mapping[str, str]]
    settings: str

    def best(self, cases: Sequence[Case] | None = None) -> Case:
        """The case with the lowest error, of all or of some."""
        return min(cases or self.cases, key=lambda case: case.scores("nrmse").mean())

    @property
    def bare(self) -> Case | None:
        """The simulation as it is."""
        return next((case for case in self.cases if case.name == "uncorrected"), None)

    @property
    def seeds(self) -> int:
        """The most of any case: a closed form needs one."""
        return max(len(case.nrmse) for case in self.cases)

    @classmethod
    def read(cls, table: Mapping[str, Any]) -> Table:
        """compare.json. KeyError for what is none."""
        ranking: Mapping[str, Any] = table.get("ranking") or {"holds": (), "text": ""}
        told = [*table.get("left_open", ()), *([table["without_time"]] if table.get("without_time") else ())]
        return cls(
            study=table["study"],
            sha256=table["study_sha256"],
            channels=table["channels"],
            unit=table["unit"],
            development=table["development"],
            evaluation=table["evaluation"],
            cases=[Case.read(row, table["evaluation"]) for row in table["cases"]],
            paper=[Reference(row["case"], row["r2"], row["nrmse"], row["nmae"]) for row in table["paper"]],
            paper_oracle=table.get("paper_oracle_r2"),
            order_holds=ranking["holds"],
            order_text=ranking["text"],
            ablation=Ablation.read(table["ablation"]) if table.get("ablation") else None,
            told=[(term, text) for term, _, text in (line.partition(": ") for line in told)],
            warnings=table.get("warnings", ()),
            settings=json.dumps(table["settings"], indent=2),
        )
