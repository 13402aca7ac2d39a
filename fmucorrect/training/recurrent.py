"""The recurrent families: a bank of oscillators, a network behind it, and a bank of oscillators behind the network.

    p_t = lambda p_(t-1) + g (q_(t-1) + q_t) / 2            first bank, fixed: the simulation's past on all time scales
    u_t = network(q_t, p_t, speed) - u_0                    what is missing, as forces and displacements without a name
    r_t = mu r_(t-1) + g (u_(t-1) + u_t) / 2                second bank, trained: how the mechanism answers to them
    y_t = q_t + D' (r_t, u_t, q_t, p_t) + d                 linear

u_0 is what the network says where the records of development begin, so that the second bank is at rest there, too. A missing
force is a static law of the motion, and acts through the modes of the mechanism: this order of parts is that of a
discrepancy (a Wiener-Hammerstein structure; of linear recurrent units see Orvieto et al., Resurrecting recurrent neural
networks for long sequences, ICML 2023). lambda and mu are complex, |.| < 1, so that a state always dies out. Training runs
on every `stride`-th sample, as the motion's own spectrum allows; what is deployed has the same poles at the sample time.

But it is a law of the true motion, not of the simulated one. With feedback the same network is asked again, and sees what its
first answer has made of the motion; the last layer has (r', u') in the place of (r, u):

    u'_t = network(q_t, p_t, speed, (r_t, u_t)) - u_0
    r'_t = mu r'_(t-1) + g (u'_(t-1) + u'_t) / 2

That is one step of the fixed-point iteration at whose end the loop is closed (Picard), and whole records go through it at
once; what is fed back sample by sample waits for each. One member, trained as long without and with it: the Silverbox'
multisine 1.14 and 0.91 mV (2800 steps), the Bouc-Wen benchmark's 3.7 and 2.2 % (1600). A network of its own for the second pass
is worth less (0.97 mV); a third pass helps the one (0.86 mV) and harms the other's sweep. From few and short records it learns
too much: so it is a family of its own, and leaving conditions out decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor, nn
from torch.nn import functional

from fmucorrect.study_training import Training
from fmucorrect.training.bank import DAMPING, ROWS, Bank, Pace, bank, pace, remembered, rotation
from fmucorrect.training.data import Samples, Sizes, counts_of
from fmucorrect.training.deployed import Said, bias, spread, weight
from fmucorrect.training.loop import Curve, Run, Terms, minimise, one_cycle
from fmucorrect.training.mlp import parameters, tanh
from fmucorrect.training.nearby import SHARE, nearby
from fmucorrect.training.recurrence import responses
from fmucorrect.training.tasks import Context

STEEPEST = 1.0
"""Largest norm of a gradient that is taken whole; a pole near the unit circle makes steeper ones."""
LEAST = 1e-6
"""Of the response, what is at least taken for the size of what the simulation lacks: a perfect simulation lacks nothing, and
less than this is below single precision."""
RIDGE = 1e-6
"""Penalty of the last layer's own fit, as a share of the mean power of a feature."""


@dataclass(frozen=True)
class View:
    """Scales of the development conditions, and the first bank. lacking: (J,) size of what the simulation lacks. speed: km/h,
    centre and span; speeds: whether it plays a part."""

    pace: Pace
    bank: Bank
    lacking: Float64[np.ndarray, " J"]
    speed: tuple[float, float]
    speeds: bool

    def seen(self, item: Samples) -> Float[Tensor, "R I"]:
        """What the network sees of a condition: the bank's features, and the scaled speed, or nothing."""
        features = self.bank.features(item)
        condition = np.full((len(features), int(self.speeds)), (item.speed - self.speed[0]) / self.speed[1])
        return torch.from_numpy(np.concatenate([features, condition], axis=1)).float()


def view(development: Sequence[Samples], training: Training, sizes: Sizes) -> View:
    """From the development conditions, or those of a fold, alone."""
    chosen = pace(development)
    lacking = np.concatenate([item.measured - item.simulated for item in development]).std(axis=0)
    lacking = np.maximum(lacking, LEAST * sizes.response)
    speeds = len({item.speed for item in development}) > 1
    return View(chosen, bank(development, chosen, training.recurrent.history), lacking, sizes.speed, speeds)


class Oscillators(nn.Module):
    """The network and the second bank. rate: ln of 1/s, damping: its logit, (P,) each. begin: (F + C,) features and condition
    where the records begin, their mean. fed_back: what its first layer sees of the first answer, None without feedback."""

    begin: Tensor

    def __init__(
        self,
        begin: Float[Tensor, " I"],
        features: int,
        channels: int,
        training: Training,
        chosen: Pace,
        feedback: bool = False,
    ) -> None:
        super().__init__()
        settings = training.recurrent
        self.register_buffer("begin", begin)
        omega = 1.0 / np.geomspace(chosen.fast, chosen.slow, settings.answer)
        self.rate = nn.Parameter(torch.from_numpy(np.log(omega)).float())
        self.damping = nn.Parameter(torch.full((settings.answer,), math.log(DAMPING / (1.0 - DAMPING))))
        self.first = nn.Linear(len(begin), settings.width)
        answer = settings.signals * (2 * settings.answer + 1)
        self.fed_back = nn.Linear(answer, settings.width, bias=False) if feedback else None
        self.second = nn.Linear(settings.width, settings.width)
        self.missing = nn.Linear(settings.width, settings.signals)
        self.out = nn.Linear(answer + features, channels)
        for layer in (self.out, self.fed_back):
            for weights in () if layer is None else layer.parameters():
                nn.init.zeros_(weights)

    def poles(self, step: float) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
        """Of a row of that sample time: by how much each pole decays, as ln, and the angle that it turns by."""
        omega, damping = torch.exp(self.rate) * step, torch.sigmoid(self.damping)
        return damping * omega, omega * torch.sqrt(1.0 - damping**2)

    def lacking(self, first: Float[Tensor, "N W"]) -> Float[Tensor, "N U"]:
        """What the network says. first: of its first layer, before the nonlinearity."""
        return self.missing(tanh(self.second(tanh(first))))

    def begun(self) -> Float[Tensor, "1 U"]:
        """u_0"""
        return self.lacking(self.first(self.begin[None]))

    def answer(self, seen: Float[Tensor, "T I"], step: float) -> Float[Tensor, "T Z"]:
        """(r, u), of the last answer. seen: features and condition."""
        first, begun, poles = self.first(seen), self.begun(), self.poles(step)

        def answered(u: Float[Tensor, "T U"]) -> Float[Tensor, "T Z"]:
            u = u.T
            before = functional.pad(u[:, :-1], (1, 0))
            return torch.cat([responses(0.5 * (u + before), *poles), u]).T

        answer = answered(self.lacking(first) - begun)
        if self.fed_back is not None:
            answer = answered(self.lacking(first + self.fed_back(answer)) - begun)
        return answer

    def forward(self, seen: Float[Tensor, "T I"], step: float) -> Float[Tensor, "T J"]:
        answer = self.answer(seen, step)
        on_answer, on_features = self.out.weight.split([answer.shape[1], self.out.in_features - answer.shape[1]], 1)
        features = seen[:, : on_features.shape[1]]
        return answer @ on_answer.T + functional.linear(features, on_features, self.out.bias)


def fit_member(
    context: Context,
    development: Sequence[Samples],
    training: Training,
    sizes: Sizes,
    member: int,
    epochs: int,
    feedback: bool = False,
) -> tuple[Oscillators, list[Curve]]:
    """One network to the development conditions, a record a step of the optimiser (in a third of the steps another near it,
    where such motions are taught), then the last layer at every sample."""
    settings, see = training.recurrent, view(development, training, sizes)
    run = Run(1000 * training.seed + 7 * member + 3, every=10, checkpoint=context.checkpoint)
    run.tick = context.tick
    stride, channels = see.pace.stride, len(see.lacking)
    near = nearby(development, member)
    lesson = [*development, *near]
    seen = [see.seen(item) for item in lesson]
    torch.manual_seed(run.seed)
    begun = torch.stack([values[0] for values in seen[: len(development)]]).mean(0)
    network = Oscillators(begun, len(see.bank.feature), channels, training, see.pace, feedback)
    strided = [values[::stride].contiguous() for values in seen]
    targets = [_target(item, see, len(values)) for item, values in zip(lesson, seen, strict=True)]
    each = len(near) // len(development)
    share = counts_of(development)
    poles = [network.rate, network.damping]
    others = [p for name, p in network.named_parameters() if name not in ("rate", "damping")]
    groups = [{"params": others, "weight_decay": settings.weight_decay}, {"params": poles, "weight_decay": 0.0}]
    optimiser = torch.optim.AdamW(groups, lr=settings.learning_rate, fused=True)
    schedule = one_cycle(optimiser, settings.learning_rate, epochs * len(development))
    optimiser.register_step_pre_hook(lambda *_: _shortened(network))

    def steps(epoch: int) -> Iterator[Terms]:
        drawn = torch.Generator().manual_seed(1_000_003 * run.seed + epoch)
        for k in torch.randperm(len(development), generator=drawn).tolist():
            other = int(torch.randint(3 * each, (1,), generator=drawn)) if near else each
            i = len(development) + k * each + other if other < each else k
            first, target = targets[i]
            said = network(strided[i], see.bank.step * stride)[-(-first // stride) :]
            yield {"residual": share[k] * ((said - target[-first % stride :: stride]) ** 2).mean()}

    minimise(run, "recurrent", network, optimiser, steps, epochs, schedule)
    _last_layer(network, see, seen, targets, [*share, *np.repeat(share / SHARE, each)])
    return network, run.curves


def _shortened(network: nn.Module) -> None:
    torch.nn.utils.clip_grad_norm_(network.parameters(), STEEPEST)


def _target(item: Samples, see: View, rows: int) -> tuple[int, Float[Tensor, "N J"]]:
    """The first of the rows that were measured, and what is to be said from there on."""
    lacking = torch.from_numpy((item.measured - item.simulated) / see.lacking).float()
    first = rows - len(lacking)
    return max(first, 0), lacking[max(-first, 0) :]


def _last_layer(
    network: Oscillators,
    see: View,
    seen: Sequence[Tensor],
    targets: Sequence[tuple[int, Tensor]],
    shares: Sequence[float],
) -> None:
    """The last layer in closed form, at the sample time at which it will run: what the stride has lost. shares: what each
    record counts."""
    layer = network.out
    size = layer.in_features + 1
    gram = torch.zeros(size, size, dtype=torch.float64)
    side = torch.zeros(size, layer.out_features, dtype=torch.float64)
    with torch.no_grad():
        for values, (first, target), share in zip(seen, targets, shares, strict=True):
            answer, features = network.answer(values, see.bank.step), values[:, : len(see.bank.feature)]
            x = torch.cat([answer, features, torch.ones(len(values), 1)], 1)[first:].double()
            rest = target.double() - x[:, :-1] @ layer.weight.double().T - layer.bias.double()
            gram, side = gram + share * x.T @ x, side + share * x.T @ rest
        more = torch.linalg.solve(gram + RIDGE * gram.trace() / size * torch.eye(size), side)
        layer.weight += more[:-1].T.float()
        layer.bias += more[-1].float()


@dataclass(frozen=True)
class Recurrent:
    """Fitted members and what they have in common."""

    members: tuple[Oscillators, ...]
    see: View
    rows: int = ROWS

    @property
    def parameters(self) -> int:
        return parameters(*self.members)

    def responses(self, item: Samples, stride: int = 1) -> Float[np.ndarray, "K N J"]:
        """What each member says, in the channels' units, without envelope."""
        seen, count, said = self.see.seen(item), len(item.simulated), []
        with torch.no_grad():
            for member in self.members:
                lacking = member(seen, self.see.bank.step).double().numpy()[-count:] * self.see.lacking
                said.append(
                    item.simulated + np.concatenate([np.zeros((count - len(lacking), lacking.shape[1])), lacking])
                )
        return np.stack(said)[:, ::stride]

    def predict(self, item: Samples, stride: int = 1) -> np.ndarray:
        """The mean of that, (N, J)."""
        return self.responses(item, stride).mean(axis=0)

    def past(self, item: Samples) -> Float64[np.ndarray, "N P"]:
        """The first bank at the measured rows."""
        return self.see.bank.past(item)

    def head(self) -> RecurrentHead:
        return RecurrentHead(self)


class RecurrentHead(nn.Module):
    """The same on x = (two rows, condition) and a state, scales folded into the weights, in double precision.

    state  = (p, z[, z'])               of the step before
    p      = p A + x G + g              first bank, the same for all members
    h      = (x, p) H + h1
    u      = tanh(tanh(h) K + k) U + o                        o: less u_0
    z      = (z B + u F, u)             second banks, all members' r, then all members' u
    [u'    = tanh(tanh(z I + h) K + k) U + o,   z' = (z' B + u' F, u')    with feedback]
    Y      = (p, z or z') O + x P + o2  the members' mean, then each one's deviation from it
    """

    def __init__(self, found: Recurrent) -> None:
        super().__init__()
        see, members = found.see, found.members
        channels = len(see.lacking)
        columns = len(see.bank.centre)
        inputs = found.rows * columns + 3
        self.members, self.phase = len(members), False
        self.bank: Bank | None = see.bank
        bank, made = see.bank.numbers, [_member(member, see, inputs) for member in members]
        answers = sum(len(part["B"]) for part in made)
        signals = sum(part["F"].shape[0] for part in made)
        feedback = members[0].fed_back is not None
        self.parts = (bank, *[answers + signals] * (1 + feedback))
        self.state = sum(self.parts)
        tensors = {
            **see.bank.weights(inputs),
            "H": torch.cat([part["H"] for part in made], 1),
            "h": torch.cat([part["h"] for part in made]),
            "K": torch.block_diag(*(part["K"] for part in made)),
            "k": torch.cat([part["k"] for part in made]),
            "U": torch.block_diag(*(part["U"] for part in made)),
            "o": torch.cat([part["o"] for part in made]),
            "B": torch.cat([torch.block_diag(*(part[name] for part in made)) for name in ("B", "F")]),
            "F": torch.block_diag(*(part["F"] for part in made)),
        }
        if feedback:
            tensors["I"] = torch.cat([torch.block_diag(*(part[name] for part in made)) for name in ("Ir", "Iu")])
        beside = spread(len(members), channels)
        last = torch.zeros(inputs, channels, dtype=torch.float64)
        last[inputs - 3 - columns : inputs - 3 - columns + channels] = torch.eye(channels, dtype=torch.float64)
        tensors["O"] = torch.cat(
            [
                torch.cat([part["Op"] for part in made], 1),
                torch.block_diag(*(part["Or"] for part in made)),
                torch.block_diag(*(part["Ou"] for part in made)),
            ]
        ) @ beside  # fmt: skip
        tensors["P"] = torch.cat([part["P"] + last for part in made], 1) @ beside
        tensors["p"] = torch.cat([part["p"] for part in made]) @ beside
        tensors["E"] = torch.cat([last] * len(members), 1) @ beside
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor.detach().float().contiguous())

    def forward(self, x: Float[Tensor, "N X"], state: Float[Tensor, "N S"] | None = None) -> Said:
        assert state is not None
        t = dict(self.named_buffers())
        before, *passes = torch.split(state, list(self.parts), 1)
        past, seen = remembered(t, x, before)
        first = hidden = torch.addmm(t["h"], seen, t["H"])
        after = [past]
        for last in passes:
            if len(after) > 1:
                hidden = torch.addmm(first, after[-1], t["I"])
            missing = torch.addmm(t["o"], torch.tanh(torch.addmm(t["k"], torch.tanh(hidden), t["K"])), t["U"])
            after.append(torch.cat([torch.addmm(missing @ t["F"], last, t["B"]), missing], 1))
        response = torch.addmm(torch.addmm(t["p"], x, t["P"]), torch.cat([past, after[-1]], 1), t["O"])
        return Said(response, x @ t["E"], torch.cat(after, 1), seen)


def _member(member: Oscillators, see: View, inputs: int) -> dict[str, Tensor]:
    """One member's weights on x, past and state, scales folded in."""
    features, lacking = len(see.bank.feature), torch.from_numpy(see.lacking)

    def on_x(numbers: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Weights of (q, p, speed) as weights of x, of p, and a constant."""
        parts = see.bank.on_inputs(numbers[:features].detach().numpy(), inputs)
        whole, past, constant = (torch.from_numpy(part) for part in parts)
        if len(numbers) > features:
            whole[inputs - 3] = numbers[-1] / see.speed[1]
            constant = constant - numbers[-1] * see.speed[0] / see.speed[1]
        return whole, past, constant

    seen, past, constant = on_x(weight(member.first))
    with torch.no_grad():
        decay, angle = (part.double() for part in member.poles(see.bank.step))
        poles = torch.exp(torch.complex(-decay, angle)).numpy()
        begun = member.begun()[0].double()
    signals = member.missing.out_features
    answer = rotation(poles, signals)
    gain = torch.kron(0.5 * (1.0 - torch.exp(-decay))[None], torch.eye(signals, dtype=torch.float64))
    out = weight(member.out) * lacking
    size_r = len(answer)
    seen_again = None if member.fed_back is None else weight(member.fed_back)
    direct, through, shift = on_x(out[size_r + signals :])
    return {
        "H": torch.cat([seen, past]),
        "h": bias(member.first) + constant,
        "K": weight(member.second),
        "k": bias(member.second),
        "U": weight(member.missing),
        "o": bias(member.missing) - begun,
        "B": answer,
        "F": torch.cat([gain, torch.zeros_like(gain)], 1),
        **({} if seen_again is None else {"Ir": seen_again[:size_r], "Iu": seen_again[size_r:]}),
        "Or": out[:size_r],
        "Ou": out[size_r : size_r + signals],
        "Op": through,
        "P": direct,
        "p": bias(member.out) * lacking + shift,
    }
