"""What tasks find, as bytes: values of the package (packing.py), and networks with their numbers."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from fmucorrect import packing

_TORCH = (nn.Linear, nn.ModuleList)
"""Of torch's own modules, those that nothing but their numbers and sizes make."""


def pack(result: object) -> bytes:
    """A result as bytes. Raises TypeError for one that holds more than that."""
    return packing.pack(result, _stands)


def unpack(data: bytes) -> Any:
    """What `pack` made bytes of. Raises ValueError for anything else."""
    return packing.unpack(data, _stood_for)


def _stands(value: Any) -> tuple[str, Any] | None:
    if isinstance(value, Tensor):
        return "tensor", [value.detach().cpu().numpy(), value.requires_grad]
    if isinstance(value, nn.GRU):
        sizes = {name: getattr(value, name) for name in ("input_size", "hidden_size", "batch_first")}
        return "gru", [sizes, dict(value.state_dict()), value.training]
    if isinstance(value, nn.Module):
        attributes = {name: entry for name, entry in vars(value).items() if name not in _EMPTY}
        tables = [dict(table) for table in (value._parameters, value._buffers, value._modules)]  # pyright: ignore[reportPrivateUsage]
        return "module", [type(value).__module__, type(value).__qualname__, attributes, *tables]
    return None


def _stood_for(name: str, content: Any) -> Any:
    if name == "tensor":
        values, learned = content
        return torch.from_numpy(values).requires_grad_(learned)
    if name == "gru":
        sizes, numbers, training = content
        made = nn.GRU(**sizes)
        made.load_state_dict(numbers)
        return made.train(training)
    if name != "module":
        raise ValueError(f"nothing is known by the name {name!r}")
    module, kind, attributes, parameters, buffers, modules = content
    found = (
        {it.__qualname__: it for it in _TORCH}.get(kind) if module.startswith("torch.") else packing.own(module, kind)
    )
    if found is None or not issubclass(found, nn.Module):
        raise ValueError(f"{kind!r} is no network of this package")
    made = found.__new__(found)
    nn.Module.__init__(made)
    vars(made).update(attributes)
    for key, tensor in parameters.items():
        made.register_parameter(key, None if tensor is None else nn.Parameter(tensor.detach(), tensor.requires_grad))
    for key, tensor in buffers.items():
        made.register_buffer(key, tensor)
    for key, inner in modules.items():
        made.register_module(key, inner)
    return made


_EMPTY = frozenset(vars(nn.Module())) - {"training"}
"""What every module has: tables of its parts, and hooks, of which a fitted one has none."""
