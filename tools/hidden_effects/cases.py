"""The list of cases. Names tell nothing: each comes from a key that also fixes all of its random numbers."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np
from bench import CHAINS, OSCILLATOR, Bench, bench
from hidden import AT_DAMPERS, AT_JOINTS, KINDS, LATE, OUTSIDE
from rig_cases import rig_cases
from specs import Spec, Wanted

Place = tuple[str, str]
"""Bench and place."""
_AT_GROUPS = ("linear_stiffness", "viscous_damping", "cubic_stiffness", "quadratic_damping", "coulomb_friction")
_DAMPING = ("viscous_damping", "quadratic_damping", "coulomb_friction", "stribeck_friction")
_UNNAMED = tuple(name for name in KINDS if name not in (*AT_JOINTS, *LATE))
QUICK = (
    *("single/coulomb_friction/0", "single/cubic_stiffness/1", "single/backlash/0", "single/sensor_lag/0"),
    *("single/bouc_wen_hysteresis/0", "single/quadratic_damping/1", "null/0", "null/1", "pair/0"),
    "outside/sawtooth_stiffness/0",
)
"""A small subset, by key: for continuous integration."""


SEED = "seed"
"""What the keys of all seeds but the first begin with."""


def name_of(programme: str, key: str) -> str:
    """A name that tells nothing; longer where there is a seed, as five digits come twice with one in three seeds."""
    number = zlib.crc32(key.encode())
    return f"{programme[:3]}_{number:010d}" if key.startswith(SEED) else f"{programme[:3]}_{number % 100_000:05d}"


def subset(which: str, seed: int = 0) -> list[Spec]:
    """quick, oscillator, rig (tone and sweep) or all. seed: another one has as many cases of every kind at other places of the
    chains, with other numbers and other noise."""
    keyed = dict(_oscillator_cases(_Dealer(seed)))
    if which == "quick":
        return [keyed[_salted(seed, key)] for key in QUICK]
    found = [] if which == "rig" else [*keyed.values()]
    if which != "oscillator":
        found += rig_cases(name_of, seed)
    names = [spec.name for spec in found]
    assert len(set(names)) == len(names), "two cases of one name"
    return found


def _salted(seed: int, key: str) -> str:
    return f"{SEED} {seed}: {key}" if seed else key


def places(effect: str) -> list[Place]:
    """Everywhere in the chains where an effect can be hidden."""
    found: list[Place] = []
    for name in CHAINS:
        on = bench(name)
        if effect.startswith("excitation_"):
            found.append((name, "excitation"))
        elif effect.startswith("sensor_"):
            found += [(name, channel) for channel in on.channels]
        elif effect == "parameter_offset":
            found += [(name, row["parameter"]) for row in on.adjustable if not row["parameter"].startswith("c")]
        else:
            found += [(name, row["name"]) for row in on.joints if _fits(effect, on, row["name"])]
            found += [(name, row["name"]) for row in on.groups if effect in _AT_GROUPS]
    return found


def _fits(effect: str, on: Bench, joint: str) -> bool:
    sprung = on.stiffness(joint, {}) > 0.0
    if effect in AT_DAMPERS:
        return not sprung
    return sprung or effect in _DAMPING


class _Dealer:
    """Deals the places of an effect in random order, each once before any comes again; and keys of its seed."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._packs: dict[str, list[Place]] = {}

    def key(self, text: str) -> str:
        return _salted(self._seed, text)

    def deal(self, effect: str, skip: int = 0) -> Place:
        pack = self._packs.get(effect)
        if not pack:
            pack = places(effect)
            np.random.default_rng(zlib.crc32(self.key(effect).encode())).shuffle(pack)
            self._packs[effect] = pack
        return pack.pop(skip if skip < len(pack) else 0)


def _oscillator_cases(dealer: _Dealer) -> Iterator[tuple[str, Spec]]:
    for effect in KINDS:
        count = 1 if effect == "sensor_rectification" else 3 if effect in AT_JOINTS else 2
        for i in range(count):
            yield _case(dealer.key(f"single/{effect}/{i}"), "single", dealer.deal(effect), effect, 0.01, bool(i % 2))
    for i, effect in enumerate(KINDS):
        yield _case(dealer.key(f"noisy/{effect}"), "single", dealer.deal(effect), effect, 0.05, bool(i % 2))
    mains = [name for name in AT_JOINTS if name not in ("preload", "periodic_force", "linear_stiffness")]
    for i, outside in enumerate([*OUTSIDE, *OUTSIDE]):
        effect = mains[(5 * i + 2) % len(mains)]
        yield _unmodelled(dealer.key(f"unmodelled/{outside}/{i}"), dealer.deal(effect), effect, outside, bool(i % 2))
    for i in range(20):
        yield _background(i, dealer, mains[(3 * i + 1) % len(mains)])
    faint = ("coulomb_friction", "cubic_stiffness", "linear_stiffness", "sensor_gain")
    for i, (effect, wanted) in enumerate([(e, m) for e in faint for m in (2.0, 25.0)]):
        key = dealer.key(f"faint/{effect}/{wanted:g}")
        yield _case(key, "faint", dealer.deal(effect), effect, 0.01, bool(i % 2), wanted)
    for i in range(30):
        on = list(CHAINS)[i % len(CHAINS)]
        key = dealer.key(f"null/{i}")
        recorded = ("none", "command", "actual")[i % 3]
        spec = Spec(
            name_of(OSCILLATOR, key), on, "null", 0.05 if i % 4 == 3 else 0.01, bool(i % 2), (), recorded=recorded
        )
        yield key, spec
    for outside in OUTSIDE:
        for i in range(2):
            yield _outside(dealer.key(f"outside/{outside}/{i}"), outside, bool(i % 2))
    yield from _pairs(dealer)


def _rng(key: str) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(f"draw {key}".encode()))


def _drawn(rng: np.random.Generator, low: float = 0.05, high: float = 0.5) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _without(effect: str, place: str, rng: np.random.Generator) -> tuple[str, ...]:
    """The parameter that is the same as the effect, which two in three studies take as known."""
    letter = {"linear_stiffness": "k", "viscous_damping": "c", "added_mass": "m"}.get(effect)
    if letter is None or not place.startswith("joint") or rng.random() < 1.0 / 3.0:
        return ()
    return (f"{letter}{place.split()[-1]}",)


def _recorded(effect: str, rng: np.random.Generator) -> str:
    if effect == "excitation_lag":
        return "command"  # registration takes up the lag of an actual motion
    if effect == "excitation_gain":
        return str(rng.choice(["command", "actual"]))
    return str(rng.choice(["none", "command"]))


def _case(
    key: str, kind: str, place: Place, effect: str, noise: float, base_error: bool, mark: float = 0.0
) -> tuple[str, Spec]:
    rng = _rng(key)
    wanted = Wanted(effect, place[1], _drawn(rng), mark=mark)
    unsure = base_error or effect == "parameter_offset" or bool(rng.random() < 0.7)
    return key, Spec(
        *(name_of(OSCILLATOR, key), place[0], kind, noise, base_error, (wanted,), unsure),
        *(_without(effect, place[1], rng), _recorded(effect, rng), bool(rng.random() < 0.6)),
    )


def _unmodelled(key: str, place: Place, effect: str, outside: str, base_error: bool) -> tuple[str, Spec]:
    """A single effect with something behind it that no catalogue holds, 1 to 5 % of the response."""
    rng = _rng(key)
    on = bench(place[0])
    main = Wanted(effect, place[1], _drawn(rng, 0.1, 0.5))
    behind = _stranger(on, outside, _drawn(rng, 0.01, 0.05), rng)
    spec = Spec(
        *(name_of(OSCILLATOR, key), place[0], "unmodelled", 0.01, base_error, (main, behind)),
        without=_without(effect, place[1], rng),
        recorded=_recorded(effect, rng),
    )
    return key, spec


def _stranger(on: Bench, outside: str, share: float, rng: np.random.Generator) -> Wanted:
    names = [row["name"] for row in on.joints if _fits("cubic_stiffness", on, row["name"])]
    joint = str(rng.choice(names))
    other = str(rng.choice([name for name in names if name != joint] or [on.joints[-1]["name"]]))
    return Wanted(outside, joint, share, "outside", other if outside == "cross_coupling" else "")


def _background(i: int, dealer: _Dealer, effect: str) -> tuple[str, Spec]:
    """One or two further effects of the catalogue, each at most half the main one's own mark."""
    key = dealer.key(f"background/{i}")
    rng = _rng(key)
    place = dealer.deal(effect)
    on = bench(place[0])
    share = _drawn(rng, 0.15, 0.5)
    wanted = [Wanted(effect, place[1], share)]
    for name, where in _others(on, wanted, 1 + i % 2, rng):
        wanted.append(Wanted(name, where, share * rng.uniform(0.1, 0.4), "background"))
    spec = Spec(name_of(OSCILLATOR, key), place[0], "background", 0.01, bool(i // 2 % 2), tuple(wanted))
    return key, spec


def _others(on: Bench, taken: list[Wanted], count: int, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Further effects that fit a bench; none twice at one place, none that the base parameters are."""
    pool = [
        (effect, place)
        for effect in (*AT_JOINTS, "sensor_gain", "sensor_lag")
        if effect not in ("linear_stiffness", "preload")
        for name, place in places(effect)
        if name == on.name and not place.startswith("upper")
    ]
    seen = {(item.effect, item.place) for item in taken}
    if any(item.effect == "preload" for item in taken):  # where friction sticks, the way there decides
        pool = [row for row in pool if "friction" not in row[0]]
    found: list[tuple[str, str]] = []
    while len(found) < count:
        effect, place = pool[rng.integers(len(pool))]
        if (effect, place) in seen or effect in {name for name, _ in seen}:
            continue
        seen.add((effect, place))
        found.append((effect, place))
    return found


def _outside(key: str, outside: str, base_error: bool) -> tuple[str, Spec]:
    rng = _rng(key)
    sprung = [name for name in CHAINS if sum(k > 0.0 for k in CHAINS[name].k) > 1]
    on = bench(sprung[rng.integers(len(sprung))])
    wanted = _stranger(on, outside, _drawn(rng, 0.1, 0.4), rng)
    return key, Spec(name_of(OSCILLATOR, key), on.name, "outside", 0.01, base_error, (wanted,))


def _pairs(dealer: _Dealer) -> Iterator[tuple[str, Spec]]:
    """30 pairs, at one joint or at two, and six triples."""
    for i in range(36):
        kind, n = ("pair", i) if i < 30 else ("triple", i - 30)
        key = dealer.key(f"{kind}/{n}")
        rng = _rng(key)
        effect = AT_JOINTS[(7 * i + 3) % len(AT_JOINTS)]
        place = dealer.deal(effect)
        on = bench(place[0])
        wanted = [Wanted(effect, place[1], _drawn(rng, 0.1, 0.4))]
        for name, where in _others(on, wanted, 1 if kind == "pair" else 2, rng):
            wanted.append(Wanted(name, where, _drawn(rng, 0.08, 0.3), "second"))
        spec = Spec(
            *(name_of(OSCILLATOR, key), place[0], kind, 0.01, bool(i % 2), tuple(wanted)),
            without=_without(effect, place[1], rng),
        )
        yield key, spec
