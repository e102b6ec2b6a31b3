# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""One slave facet above a few master facets, for tests of the layers that know no meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracle
from dolfinx_mortar import cpp

TYPE = {kind: getattr(cpp.FacetType, kind) for kind in oracle.KINDS}
SPACE = {
    "dual": cpp.MultiplierSpace.dual,
    "dual-linear": cpp.MultiplierSpace.dual_linear,
    "dual-reproducing": cpp.MultiplierSpace.dual_reproducing,
    "standard": cpp.MultiplierSpace.standard,
}
INTEGRATION = {"segment": cpp.Integration.segment, "element": cpp.Integration.element}
PAIRINGS = [(a, b) for a in oracle.KINDS for b in oracle.KINDS]


@dataclass
class Pairing:
    """A slave facet and its masters.

    Attributes:
        slave: Surface of one facet.
        master: Surface of its master facets.
    """

    slave: oracle.Surface
    master: oracle.Surface

    @property
    def kinds(self) -> tuple[str, str]:
        """Kinds of the slave facet and of the masters."""
        return self.slave.facets[0][0], self.master.facets[0][0]

    def integrate(
        self,
        multiplier: str,
        integration: str = "segment",
        *,
        degree: int | None = None,
        has_multiplier: np.ndarray | None = None,
        normals: np.ndarray | None = None,
        z: np.ndarray | None = None,
        derivatives: cpp.Derivatives = cpp.Derivatives.none,
        nonnegative: np.ndarray | None = None,
        offset: np.ndarray | None = None,
    ) -> dict:
        """Mortar integrals of the slave facet by the library; columns of M as in `master.x`."""
        n = len(self.slave.x)
        has_multiplier = (
            np.ones(n, np.int8) if has_multiplier is None else has_multiplier.astype(np.int8)
        )
        normals = oracle.averaged_normals(self.slave) if normals is None else normals
        nodes = np.concatenate([nodes for _, nodes in self.master.facets])
        r = cpp.integrate_facet(
            TYPE[self.kinds[0]],
            int(self.slave.sign[0]),
            in_facet_order(self.slave),
            np.ascontiguousarray(normals[self.slave.facets[0][1]]),
            has_multiplier,
            np.zeros((n, 3)) if z is None else z,
            [TYPE[kind] for kind, _ in self.master.facets],
            self.master.sign.astype(np.int8),
            nodes.astype(np.int64),
            np.ascontiguousarray(self.master.x[nodes]),
            SPACE[multiplier],
            INTEGRATION[integration],
            degree,
            derivatives,
            nonnegative,
            offset=offset,
        )
        result = {name: getattr(r, name) for name in ("covered", "area", "dropped_area", "lost")}
        if r.covered:
            names = ["master_blocks", "coverage", "diagonal", "D_tilde", "D", "gap", "jump"]
            if derivatives != cpp.Derivatives.none:
                names += ["d_force", "d_gap", "d_gap_normal"]
            if derivatives == cpp.Derivatives.gap_and_slip:
                names += ["d_jump"]
            result |= {name: np.array(getattr(r, name)) for name in names}
            result["M"] = np.zeros((n, len(self.master.x)))
            result["M"][:, r.master_blocks] = r.M
        return result

    def points(self, integration: str, degree: int, derivatives: bool = False) -> cpp.PairPoints:
        """Quadrature points of the slave facet with its first master."""
        kind, nodes, x, sign = self.master.facet(0)
        return cpp.pair_points(
            TYPE[self.kinds[0]],
            int(self.slave.sign[0]),
            in_facet_order(self.slave),
            TYPE[kind],
            int(sign),
            np.ascontiguousarray(x),
            INTEGRATION[integration],
            degree,
            derivatives,
        )


def edge_flags(kind: str, multiplier: str, covered: bool) -> np.ndarray | None:
    """Flags of the nodes of a facet as the library sets them where functions need them.

    Only "dual-reproducing" on tri6 and quad8 does: the others are made of functions whose mass
    matrix is positive definite whatever is covered.
    """
    if covered or not oracle.is_reproducing(kind, multiplier):
        return None
    return np.ones(len(oracle.REFERENCE_NODES[kind]), np.int8)


def in_facet_order(surface: oracle.Surface) -> np.ndarray:
    """Positions of the nodes of a surface's first facet, in the facet's order."""
    return np.ascontiguousarray(surface.x[surface.facets[0][1]])


def one_facet(kind: str, rng: np.random.Generator, distort: float, outward: float = 1.0):
    """A distorted, turned reference facet near the x-y plane, nodes in the facet's own order."""
    x = np.zeros((len(oracle.REFERENCE_NODES[kind]), 3))
    x[:, :2] = oracle.REFERENCE_NODES[kind] - 0.4
    x += distort * rng.uniform(-1, 1, x.shape)
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    x = x @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return oracle.Surface(x, [(kind, np.arange(len(x)))], np.array([outward]))


def random_pairing(
    slave_kind: str,
    master_kind: str,
    seed: int,
    *,
    covered: bool = True,
    distort: float = 0.03,
    gap: float = 0.05,
) -> Pairing:
    """A random facet under a random patch of masters that covers all of it, or a part."""
    rng = np.random.default_rng(seed)
    slave = one_facet(slave_kind, rng, distort)
    lower, upper = ((-2, -2), (2, 2)) if covered else ((-2, -0.2), (0.25, 2))
    master = oracle.patch(
        master_kind,
        (3, 3),
        lower=lower,
        upper=upper,
        height=gap,
        outward=-1,
        distort=0.15,
        bend=distort,
        shuffle=True,
        rng=rng,
    )
    return Pairing(slave, master)


def beyond_an_edge(kind: str) -> Pairing:
    """A second-order facet with an edge curved inwards, covered almost only outside of this edge.

    There its linear parts reach beyond it.
    """
    reference = oracle.REFERENCE_NODES[kind]
    x = np.column_stack([reference, np.zeros(len(reference))])
    x[np.all(reference == [0.5, 0], axis=1), 1] = 0.24
    master = [[0.08, -0.5, 0.02], [0.82, -0.5, 0.03], [0.08, 0.23, 0.02], [0.82, 0.233, 0.01]]
    return Pairing(
        oracle.Surface(x, [(kind, np.arange(len(x)))], np.array([1.0])),
        oracle.Surface(np.array(master), [("quad4", np.arange(4))], np.array([-1.0])),
    )
