"""The TDNN baseline of the paper's cases: fitted to the simulation alone, then one amplitude factor for all channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fmucorrect.metrics import score
from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples
from fmucorrect.training.grid import Inputs
from fmucorrect.training.loop import Run, Terms, adam, minimise
from fmucorrect.training.mlp import Mlp, in_pieces, parameters


@dataclass(frozen=True)
class Tdnn:
    """q^ML = F(u^W, v) (eq. tdnn_definition), and rho q^ML (eq. alignment_fit). network None: the simulation itself."""

    network: Mlp | None
    see: Inputs
    rho: float = 1.0

    @property
    def parameters(self) -> int:
        return 0 if self.network is None else parameters(self.network)

    def modelled(self, item: Samples, stride: int = 1) -> Float[Tensor, "N J"]:
        """q^ML in units of the response scales."""
        if self.network is None:
            return torch.from_numpy(item.simulated[::stride] / self.see.scales.response).float()
        with torch.no_grad():
            return in_pieces(self.network, window_and_speed(self.see, item, stride))

    def aligned(self, item: Samples, stride: int = 1) -> Float[Tensor, "N J"]:
        """The aligned baseline in units of the response scales."""
        return self.rho * self.modelled(item, stride)

    def fitted_to(self, development: Sequence[Samples]) -> Tdnn:
        """With rho, the root of measured over modelled power, all development conditions and channels (eq. alignment_fit)."""
        response = torch.from_numpy(self.see.scales.response)
        modelled = sum(float(((self.modelled(item) * response) ** 2).sum()) for item in development)
        measured = sum(float((item.measured**2).sum()) for item in development)
        return replace(self, rho=float(np.sqrt(measured / modelled)))


def window_and_speed(see: Inputs, item: Samples, stride: int = 1) -> Float[Tensor, "N U"]:
    """What a TDNN sees: the scaled history and the scaled speed (eq. tdnn_definition, z^(0))."""
    return torch.cat([see.window(item, stride), see.speed(item, stride)], 1)


def fit_tdnn(
    development: Sequence[Samples],
    training: Training,
    see: Inputs,
    run: Run,
    epochs: int,
    learning_rate: float,
    weight_decay: float,
    held: Sequence[Samples] = (),
) -> Tdnn:
    """Fit to the simulated responses of the development conditions (eq. tdnn_fit), then rho."""
    torch.manual_seed(run.seed)
    stride = training.decimation
    response = see.scales.response
    x = torch.cat([window_and_speed(see, item, stride) for item in development])
    y = torch.cat([torch.from_numpy(item.simulated[::stride] / response).float() for item in development])
    network = Mlp((x.shape[1], *training.tdnn.widths, y.shape[1]), training.tdnn.activation).to(run.device)
    x, y = x.to(run.device), y.to(run.device)
    model = Tdnn(network, see)

    def steps(_: int) -> list[Terms]:
        return [{"simulation": ((in_pieces(network, x) - y) ** 2).sum(1).mean()}]

    def error() -> float:
        """NRMSE (%) against the simulation of what is left out."""
        network.cpu()
        said = [score(model.modelled(i, stride).double().numpy() * response, i.simulated[::stride]) for i in held]
        network.to(run.device)
        return float(np.mean([scores.mean_nrmse for scores in said]))

    minimise(
        run,
        "tdnn",
        network,
        adam(network, learning_rate, weight_decay),
        steps,
        run.epochs.get("tdnn", epochs),
        held_out=error if held else None,
    )
    network.cpu()
    return model.fitted_to(development)
