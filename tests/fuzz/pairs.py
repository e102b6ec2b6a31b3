# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Random pairs of facets, among them what no mesh should have, against what must always hold.

    python3 tests/fuzz/pairs.py --pairs 100000 --seed 3

What must hold for the integrals of any slave facet over any master facets:

* they are finite, or there is an error in words: positions that are not finite and folded slave
  facets are refused;
* the area is positive and no larger than that of the slave facet, and what is left out of it is
  counted;
* D and M agree on constants: their rows have the same sums, and all entries of D add up to the
  area where all nodes carry a multiplier;
* where no function is negative on a facet, the diagonal of D̃ is positive;
* M is bounded: a row Σ|M_jl| has at most ∫|Φ_j| times the largest Σ|N_l| at any place that may
  count as one of the master, so that no point lies far beyond it. ∫|Φ_j| itself is below 0.8
  areas of a facet of first order or with dual-linear functions, whatever is covered of it. Dual
  functions of second order have more where little is covered: 8 areas on quad8 and 50 on quad9,
  for a square of a fifth of the facet's size in its middle;
* other units, places, directions and numberings of the nodes change nothing.
"""

from __future__ import annotations

import argparse
import collections
import functools
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import oracle
from dolfinx_mortar import cpp
from facet_pairs import INTEGRATION, SPACE, TYPE, Pairing, in_facet_order, random_pairing

#: Share of the reference facet by which points may lie beyond a master
REACH = 0.1

#: Slave facets that are flat, and masters that do not overlap each other
PLAIN = ("general", "sliver master", "coincident", "tiny overlap", "edge", "steep", "units", "far")
#: Input that may be refused
REFUSED = {"not finite": "finite", "folded slave": "folded", "flat slave": "folded"}


@dataclass
class Example:
    """A pair of facets, and how it is integrated.

    Attributes:
        category: What is special about it.
        pairing: Facets.
        options: Arguments of :meth:`facet_pairs.Pairing.integrate`.
    """

    category: str
    pairing: Pairing
    options: dict = field(default_factory=dict)


def flat(kind: str) -> np.ndarray:
    """The reference facet in the x-y plane."""
    x = oracle.REFERENCE_NODES[kind]
    return np.column_stack([x, np.zeros(len(x))])


def surface(kind: str, x: np.ndarray, sign: float) -> oracle.Surface:
    return oracle.Surface(x, [(kind, np.arange(len(x)))], np.array([sign]))


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def tilt(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


class Facets:
    """Two facets of random kinds that one of the methods below makes special.

    Attributes:
        rng: Source of chance.
        kinds: Slave's and master's kind.
        slave, master: Positions of their nodes.
        signs: Orientations.
    """

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.kinds = (str(rng.choice(oracle.KINDS)), str(rng.choice(oracle.KINDS)))
        self.signs = (1.0, -1.0)
        self.slave = flat(self.kinds[0])
        self.master = self.shaken(1, 0.03) + [*rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.1, 0.1)]

    def shaken(self, side: int, size: float) -> np.ndarray:
        x = flat(self.kinds[side])
        return x + size * self.rng.uniform(-1, 1, x.shape)

    def general(self):
        pass

    def sliver_master(self):
        self.master[:, 1] = 0.5 + 10.0 ** self.rng.uniform(-14, -3) * (self.master[:, 1] - 0.5)

    def sliver_slave(self):
        self.slave[:, 1] *= 10.0 ** self.rng.uniform(-14, -3)

    def flat_master(self):
        self.master[:] = self.rng.choice([self.master[0], [0.3, 0.3, 0.01]])
        if self.rng.random() < 0.5:
            self.master[:, 0] += flat(self.kinds[1])[:, 0]

    def flat_slave(self):
        if self.rng.random() < 0.5:
            self.slave[:, 1] = 0.3
        else:
            self.slave[:] = 0.3

    def coincident(self):
        self.kinds = (self.kinds[0],) * 2
        noise = self.rng.choice([0, 1e-16, 1e-13, 1e-10])
        self.master = self.slave + noise * self.rng.uniform(-1, 1, self.slave.shape)

    def edge(self):
        """Facets that meet in an edge, or nearly."""
        self.signs = (1.0, 1.0)
        gap = self.rng.choice([0, 1e-16, 1e-13, -1e-13, 1e-10, -1e-10, 1e-9, -1e-9])
        self.master = flat(self.kinds[1]) * [-1, 1, 1] + [gap, self.rng.choice([0, 0.3, 1.0]), 0]

    def tiny_overlap(self):
        self.signs = (1.0, 1.0)
        width = 10.0 ** self.rng.uniform(-16, -4)
        y = self.rng.choice([0, 0.3, -0.2, 1 - width])
        self.master = flat(self.kinds[1]) * [-1, 1, 1] + [width, y, 0]

    def steep(self):
        self.master = self.shaken(1, self.rng.choice([0.0, 0.03, 0.1])) - [0.5, 0.5, 0]
        angle = self.rng.choice([30, 60, 69, 71, 75, 85, 89, 89.9])
        self.master = self.master @ tilt(angle).T + [*self.rng.uniform(0.2, 0.8, 2), 0]

    def warped(self):
        self.slave = self.shaken(0, 0.2)
        self.master = self.shaken(1, 0.3) + [*self.rng.uniform(-0.4, 0.4, 2), 0]

    def curved(self):
        self.slave[:, 2] += 0.2 * self.rng.uniform(-1, 1, len(self.slave))
        self.master[:, 2] += 0.3 * self.rng.uniform(-1, 1, len(self.master))

    def units(self):
        unit = 10.0 ** self.rng.choice([-30, -12, -9, 9, 12, 30])
        self.slave, self.master = unit * self.slave, unit * self.master

    def far(self):
        place = 10.0 ** self.rng.uniform(2, 8) * self.rng.uniform(-1, 1, 3)
        self.slave, self.master = self.slave + place, self.master + place

    def not_finite(self):
        x = self.slave if self.rng.random() < 0.5 else self.master
        x[self.rng.integers(3), self.rng.integers(3)] = self.rng.choice(
            [np.nan, np.inf, -np.inf, 1e308]
        )

    def folded_slave(self):
        self.swap(self.slave)

    def folded_master(self):
        self.swap(self.master)

    def noise(self):
        self.slave = self.rng.normal(size=self.slave.shape)
        self.master = self.rng.normal(size=self.master.shape)

    def swap(self, x: np.ndarray):
        i, j = self.rng.choice(3, 2, replace=False)
        x[[i, j]] = x[[j, i]]


CATEGORIES = tuple(
    name for name, method in vars(Facets).items() if callable(method) and name[0] != "_"
)
CATEGORIES = tuple(c for c in CATEGORIES if c not in ("shaken", "swap"))


def examples(number: int, seed: int) -> Iterator[Example]:
    """Random pairs of all categories in turn."""
    for k in range(number):
        rng = np.random.default_rng([seed, k])
        category = CATEGORIES[k % len(CATEGORIES)]
        f = Facets(rng)
        getattr(f, category)()
        if rng.random() < 0.3 and category not in ("not_finite", "far"):
            q = rotation(rng)
            f.slave, f.master = f.slave @ q.T, f.master @ q.T
            normal = q[:, 2]
        else:
            normal = np.array([0.0, 0.0, 1.0])
        n = len(f.slave)
        options = {
            "multiplier": str(rng.choice(oracle.MULTIPLIERS)),
            "integration": str(rng.choice(list(INTEGRATION), p=[0.75, 0.25])),
            "has_multiplier": np.ones(n) if rng.random() < 0.7 else rng.random(n) < 0.6,
            "nonnegative": np.ones(n, np.int8) if rng.random() < 0.3 else None,
            "derivatives": cpp.Derivatives.gap_and_slip if k % 3 == 0 else cpp.Derivatives.none,
            "normals": np.tile(normal, (n, 1)),
            "z": rng.normal(size=(n, 3)),
        }
        pairing = Pairing(
            surface(f.kinds[0], f.slave, f.signs[0]), surface(f.kinds[1], f.master, f.signs[1])
        )
        yield Example(category.replace("_", " "), pairing, options)


def violations(example: Example) -> list[str]:
    """What does not hold for a pair."""
    category, p, options = example.category, example.pairing, example.options
    try:
        with np.errstate(all="ignore"):
            r = p.integrate(**options)
    except RuntimeError as error:
        # Anything that is far off can be folded
        wanted = REFUSED.get(category, "folded")
        expected = category not in PLAIN and wanted in str(error)
        return [] if expected else [f"raises {error}"]
    if category == "not finite":
        return ["is not refused"]
    values = {k: np.asarray(v, float) for k, v in r.items()}
    infinite = [k for k, v in values.items() if not np.all(np.isfinite(v))]
    if infinite:
        return [f"{', '.join(infinite)} not finite"]
    bad = []
    if r["dropped_area"] < 0 or not 0 <= r["lost"] <= 1:
        bad.append("counts what is left out wrongly")
    if r["covered"]:
        bad += violated_balance(example, values)
    return bad


def violated_balance(example: Example, r: dict[str, np.ndarray]) -> list[str]:
    """What does not hold for the integrals of a pair."""
    bad = []
    p, options, area = example.pairing, example.options, float(r["area"])
    facet = oracle.facet_area(p.slave, 0, 12)
    scale = max(np.abs(r["D"]).max(), np.abs(r["M"]).max())
    if area <= 0:
        bad.append("has no area")
    if example.category in PLAIN and options["integration"] == "segment":
        if area > facet * (1 + 1e-6):
            bad.append(f"has {area / facet:.3g} of the area")
    if np.abs(r["D"].sum(axis=1) - r["M"].sum(axis=1)).max() > 1e-10 * scale:
        bad.append("rows of D and M differ")
    if np.all(options["has_multiplier"]) and abs(r["D"].sum() - area) > 1e-9 * np.abs(r["D"]).sum():
        bad.append("D does not add up to the area")
    if options["multiplier"] != "standard" and never_negative(example):
        count = len(oracle.multiplier_nodes(p.kinds[0], options["multiplier"]))
        if np.any(r["diagonal"][:count][options["has_multiplier"][:count].astype(bool)] <= 0):
            bad.append("D̃ is not positive")
    rows, bound = np.abs(r["M"]).sum(axis=1), largest_rows(example)
    if np.any(rows > (1 + 1e-6) * bound):
        bad.append(f"has a row of M of {(rows / bound).max():.3g} times the bound")
    return bad


@functools.cache
def largest_sum(kind: str) -> float:
    """Largest Σ|N_l| within reach of a facet."""
    corners = oracle.REFERENCE_NODES[kind][: oracle.num_corners(kind)]
    low, high = -REACH, 1 + REACH
    xi = np.stack(np.meshgrid(*[np.linspace(low, high, 61)] * 2), axis=-1).reshape(-1, 2)
    if len(corners) == 3:
        xi = xi[xi.sum(axis=1) <= high + 1e-12]
    return float(np.abs(oracle.shape_functions(kind, xi)[0]).sum(axis=1).max())


def largest_rows(example: Example) -> np.ndarray:
    """Bound of Σ_l |M_jl| for each node of the slave facet."""
    p, options = example.pairing, example.options
    kind, multiplier = p.kinds[0], options["multiplier"]
    degree = cpp.default_degree(*(TYPE[k] for k in p.kinds))
    if options["integration"] == "element":
        degree = 2 * degree + 4
    # The library takes positions relative to the middle: the same to the last digit, since on a
    # sliver as wide as round-off others may be folded
    middle = sum((3 * x / p.slave.x.size for x in in_facet_order(p.slave)), np.zeros(3))
    near = moved(p, lambda x: x - middle)
    points = near.points(options["integration"], degree)
    count = len(oracle.multiplier_nodes(kind, multiplier))
    T = cpp.transformation(SPACE[multiplier], TYPE[kind], options["nonnegative"])
    xi, w = points.xi, points.w
    functions = oracle.shape_functions(kind, xi)[0] @ T
    functions = functions[:, :count]
    if never_negative(example) and (w @ functions).min() <= 0:
        inside = in_reference(kind, xi)
        functions, w = functions[inside], w[inside]
    if oracle.is_reproducing(kind, multiplier):
        corners = oracle.shape_functions("tri3" if count == 3 else "quad4", xi)[0]
        inverse = np.linalg.inv(corners.T @ (w[:, None] * functions))
        functions = corners @ ((w @ functions)[:, None] * inverse).T
    elif multiplier != "standard":
        functions = functions @ oracle.dual_coefficients(functions, w).T
    has_multiplier = options["has_multiplier"][:count].astype(bool)
    shared = np.zeros(len(p.slave.x))
    size = w @ np.abs(functions)
    shared[:count][has_multiplier] = (
        size[has_multiplier] + size[~has_multiplier].sum() / has_multiplier.sum()
    )
    return largest_sum(p.kinds[1]) * shared


def in_reference(kind: str, xi: np.ndarray) -> np.ndarray:
    """True for points of the reference facet."""
    last = xi.sum(axis=1) if kind.startswith("tri") else xi.max(axis=1)
    return (xi.min(axis=1) >= 0) & (last <= 1)


def never_negative(example: Example) -> bool:
    """True where no function is negative on the facet."""
    kind, multiplier = example.pairing.kinds[0], example.options["multiplier"]
    if kind in ("tri3", "quad4") or multiplier == "dual-linear":
        return True
    if multiplier == "standard":
        return kind != "quad9"
    return example.options["nonnegative"] is not None


# -- What must not matter ------------------------------------------------------------------------


def start_corners(kind: str) -> list[np.ndarray]:
    """Numberings of the nodes of a facet that keep its sense."""
    if kind.startswith("tri"):
        maps = [lambda a, b: (1 - a - b, a), lambda a, b: (b, 1 - a - b)]
    else:
        maps = [lambda a, b: (1 - b, a), lambda a, b: (1 - a, 1 - b), lambda a, b: (b, 1 - a)]
    x = oracle.REFERENCE_NODES[kind]
    distance = [np.abs(x[:, None] - np.array([m(*y) for y in x])[None]).sum(axis=2) for m in maps]
    return [d.argmin(axis=0) for d in distance]


def moved(p: Pairing, change) -> Pairing:
    sides = (p.slave, p.master)
    return Pairing(*(oracle.Surface(change(s.x), s.facets, s.sign) for s in sides))


def integrals(p: Pairing, multiplier: str, degree: int | None = None) -> dict:
    r = p.integrate(multiplier, degree=degree)
    return {k: np.asarray(r[k]) for k in ("D", "M", "gap", "jump", "area")}


def differences(number: int, seed: int) -> Iterator[tuple[str, float]]:
    """Change of the integrals of random coverings by what must not matter, with its name.

    Relative to the area of the slave facet, and to the size of round-off of the input.
    """
    for k in range(number):
        rng = np.random.default_rng([seed, k])
        a, b = str(rng.choice(oracle.KINDS)), str(rng.choice(oracle.KINDS))
        multiplier = str(rng.choice(oracle.MULTIPLIERS))
        distort = float(rng.choice([0.0, 0.02]))
        p = random_pairing(a, b, int(rng.integers(1 << 30)), distort=distort)
        r = integrals(p, multiplier)
        what = k % 4
        if what == 0:
            unit = 10.0 ** rng.choice([-9, -6, -3, 3, 6, 9])
            s = integrals(moved(p, lambda x, u=unit: u * x), multiplier)
            power = {"gap": 3, "jump": 3}
            s = {name: v / unit ** power.get(name, 2) for name, v in s.items()}
            yield "units", change(r, s)
        elif what == 1:
            # Binary fractions, so that the move is exact
            step = 2.0**-20
            p = moved(p, lambda x, h=step: h * np.round(x / h))
            place = np.round(10.0 ** rng.uniform(0, 8) * rng.uniform(-1, 1, 3))
            s = integrals(moved(p, lambda x, o=place: x + o), multiplier)
            yield "translation", change(integrals(p, multiplier), s)
        elif what == 2:
            q = rotation(rng)
            s = integrals(moved(p, lambda x, q=q: x @ q.T), multiplier)
            s["jump"] = s["jump"] @ q
            yield "rotation", change(r, s)
        else:
            new = start_corners(a)[rng.integers(2)]
            slave = surface(a, in_facet_order(p.slave)[new], float(p.slave.sign[0]))
            # Overlaps are cut into other triangles, so that rules must be exact
            r = integrals(p, multiplier, 18)
            s = integrals(Pairing(slave, p.master), multiplier, 18)
            back = np.argsort(new)
            s = {
                "D": s["D"][np.ix_(back, back)],
                "M": s["M"][back],
                "gap": s["gap"][back],
                "jump": s["jump"][back],
                "area": s["area"],
            }
            yield ("numbering" if distort == 0 else "numbering of distorted facets"), change(r, s)


def change(r: dict, s: dict) -> float:
    return max(float(np.abs(s[k] - v).max()) for k, v in r.items()) / float(r["area"])


#: Largest change allowed
ALLOWED = {
    "units": 1e-11,
    "translation": 1e-11,
    "rotation": 1e-11,
    "numbering": 1e-10,
    "numbering of distorted facets": 1e-3,
}


def run(number: int, seed: int) -> dict[str, list[int]]:
    """Numbers of the examples, by what they violate."""
    found = collections.defaultdict(list)
    for k, example in enumerate(examples(number, seed)):
        for text in violations(example):
            found[f"{example.category} ({example.options['integration']}) {text}"].append(k)
    for k, (what, size) in enumerate(differences(number // 10, seed)):
        if not size <= ALLOWED[what]:
            found[f"{what} changes integrals by {size:.0e}"].append(k)
    return dict(found)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    args = parser.parse_args()
    start = time.perf_counter()
    print(f"{args.pairs} pairs, seed {args.seed}", flush=True)
    found = run(args.pairs, args.seed)
    for text, numbers in sorted(found.items()):
        print(f"{len(numbers):6d} × {text}; e.g. number {numbers[0]}")
    print(f"{sum(map(len, found.values()))} violations, {time.perf_counter() - start:.0f} s")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
