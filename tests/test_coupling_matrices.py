# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Matrices of a whole interface: against the slow reference, on any number of ranks.

Entries are compared through the positions of their nodes: numberings depend on the partition.
"""

from mpi4py import MPI

import blocks
import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
from dolfinx import graph

comm = MPI.COMM_WORLD
multipliers = pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
KINDS = [
    ("tri3", "quad9"),
    ("quad4", "tri6"),
    ("quad8", "quad8"),
    ("tri6", "quad4"),
    ("quad9", "tri3"),
]
kinds = pytest.mark.parametrize("pair", KINDS, ids="-".join)
ENDS = [
    cases.Dirichlet(1, lambda x: cases.near(0)(x[2])),
    cases.Dirichlet(0, lambda x: cases.near(2)(x[2]), value=lambda t: (0.02, 0.01, -0.03)),
]


def curved(pair, communicator=comm, **more):
    elements = [blocks.ELEMENT[kind] for kind in pair]
    return blocks.curved_blocks(*elements, ENDS, comm=communicator, **more)


def coupled(case, u=None, **options):
    """A tie in a problem."""
    u = u or cases.displacements(case)
    (tie,) = cases.make_interfaces(case, **options)
    problem = dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=cases.DirichletConditions(case).bcs,
        interfaces=[tie],
    )
    return problem, tie


def positions(case, problem):
    """Body and position of every displacement block, in the problem's numbering; on all ranks."""
    rows = []
    for b, body in enumerate(case.bodies):
        V = body.V
        n = V.dofmap.index_map.size_local
        rows.append(np.column_stack([np.full(n, b), V.tabulate_dof_coordinates()[:n]]))
    return np.vstack(problem.comm.allgather(np.vstack(rows)))


def multiplier_positions(tie):
    """Of every multiplier, in the problem's numbering; on all ranks."""
    s = tie.data.slave
    rows = np.column_stack([np.zeros(s.num_owned), s.X[: s.num_owned]])
    return np.vstack(tie.comm.allgather(rows))


def entries(A):
    """Row, column, value of all entries, on all ranks; those of the three components must agree."""
    first = A.getOwnershipRange()[0]
    indptr, columns, values = A.getValuesCSR()
    rows = first + np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    table = np.vstack(A.comm.tompi4py().allgather(np.column_stack([rows, columns, values])))
    dense = np.zeros(A.getSize())
    np.add.at(dense, (table[:, 0].astype(int), table[:, 1].astype(int)), table[:, 2])
    x, y, z = (dense[c::3, c::3] for c in range(3))
    assert np.array_equal(x, y) and np.array_equal(x, z)
    assert np.count_nonzero(dense) == 3 * np.count_nonzero(x)
    return x


def order(x):
    """A numbering that depends on positions only."""
    key = np.round(x, 7) + 0.0
    return np.lexsort(key.T[::-1])


def matrices(case, problem, tie, names):
    """Matrices with rows and columns sorted by position."""
    u, z = (order(x) for x in (positions(case, problem), multiplier_positions(tie)))
    of = {"D": (z, u), "M": (z, u), "T": (u, u), "T_inverse": (u, u), "D_inverse": (u, z)}
    of["P"] = (u, u)
    return {name: entries(getattr(tie, name))[np.ix_(*of[name])] for name in names}


def names(multiplier):
    return ["D", "M", "T", "T_inverse"] + (["D_inverse", "P"] if multiplier == "dual" else [])


@pytest.mark.serial
@kinds
@multipliers
def test_reference(pair, multiplier):
    """D, M and T are the reference's; what follows from them does."""
    case = curved(pair)
    problem, tie = coupled(case, multiplier=multiplier, quadrature_degree=18)
    found = {name: entries(getattr(tie, name)) for name in names(multiplier)}
    (slave, s), (master, m) = cases.interface_surfaces(case, case.interfaces[0])
    dropped = np.flatnonzero(tie.state.basis.has_multiplier == 0)
    used = np.unique(
        np.concatenate([n[oracle.multiplier_nodes(k, multiplier)] for k, n in slave.facets])
    )
    dropped = np.intersect1d(dropped, used)
    expected = oracle.mortar(slave, master, multiplier, points=9, dropped=dropped)

    # Blocks of the problem: all of body 0, then all of body 1; slave nodes in order of dofs
    sizes = [b.V.dofmap.index_map.size_global for b in case.bodies]
    columns = {0: s[:, 1], 1: m[:, 1] + sizes[0]}
    scale = np.abs(expected.D).max()
    D, M = np.zeros_like(found["D"]), np.zeros_like(found["M"])
    D[:, columns[0]], M[:, columns[1]] = expected.D, expected.M
    assert np.abs(found["D"] - D).max() < 1e-8 * scale
    assert np.abs(found["M"] - M).max() < 1e-8 * scale
    identity = np.eye(sum(sizes))
    T = identity.copy()
    T[np.ix_(columns[0], columns[0])] = expected.T
    if not (multiplier == "standard" and pair[0] in ("tri6", "quad8")):
        assert np.abs(found["T"] - T).max() < 1e-15
    assert np.abs(found["T"] @ found["T_inverse"] - identity).max() < 1e-14
    assert np.array_equal(found["T"] != 0, found["T_inverse"] != 0)

    if multiplier == "dual":
        has_multiplier = tie.state.basis.has_multiplier.astype(bool)
        assert np.count_nonzero(found["D_inverse"]) <= np.count_nonzero(found["T"])
        product = found["D"] @ found["D_inverse"]
        assert np.abs(product - np.diag(has_multiplier.astype(float))).max() < 1e-12
        assert np.abs(found["P"] - found["D_inverse"] @ found["M"]).max() < 1e-13
        if has_multiplier.all():
            # A translation of the master is one of the slave
            assert np.abs(found["P"].sum(axis=1)[columns[0]] - 1).max() < 1e-12


@pytest.mark.parametrize(
    ("pair", "multiplier", "integration"),
    [
        (KINDS[0], "dual", "segment"),
        (KINDS[1], "standard", "element"),
        (KINDS[2], "dual", "element"),
        (KINDS[3], "dual-linear", "segment"),
        (KINDS[2], "dual-reproducing", "element"),
        (KINDS[4], "standard", "segment"),
    ],
)
def test_ranks(pair, multiplier, integration):
    """The same as on one rank, for DOLFINx's own partition."""
    compare(curved(pair), pair, multiplier, integration)


def compare(case, pair, multiplier, integration):
    options = {"multiplier": multiplier, "integration": integration}
    ours = matrices(case, *coupled(case, **options), names(multiplier))
    alone = curved(pair, MPI.COMM_SELF)
    theirs = matrices(alone, *coupled(alone, **options), names(multiplier))
    for name, A in ours.items():
        assert np.abs(A - theirs[name]).max() < 1e-12 * np.abs(theirs[name]).max(), name


@pytest.mark.parametrize(
    ("pair", "multiplier"), [(KINDS[2], "dual-reproducing"), (KINDS[3], "dual-linear")]
)
@pytest.mark.parametrize("deal", ["apart", "random", "one"])
def test_any_partition(pair, multiplier, deal, monkeypatch):
    """Slave and master on different ranks, cells dealt out at random, all on the last rank."""
    with monkeypatch.context() as patch:
        patch.setattr(cases.compat, "create_mesh", dealing(deal, cases.compat.create_mesh))
        case = curved(pair)
    if deal == "apart" and comm.size > 1:
        owned = [b.mesh.topology.index_map(3).size_local for b in case.bodies]
        assert min(owned) == 0
    compare(case, pair, multiplier, "segment")


def dealing(deal, create_mesh):
    """`create_mesh` with a partition of our own; rank 0 hands over all cells."""
    body = iter(range(2))

    def create(communicator, cells, element, x):
        number, size = next(body), communicator.size
        ranks = {
            "apart": np.full(len(cells), number % size),
            "random": np.random.default_rng(number).integers(size, size=len(cells)),
            "one": np.full(len(cells), size - 1),
        }[deal]

        def partition(*_):
            destinations = graph.adjacencylist(ranks.astype(np.int32).reshape(-1, 1))
            return getattr(destinations, "_cpp_object", destinations)

        return create_mesh(communicator, cells, element, x, partition)

    return create


@pytest.mark.parametrize(
    "pair",
    [pytest.param(p, marks=pytest.mark.serial) for p in KINDS[:2]] + KINDS[2:4],
    ids=map("-".join, KINDS[:4]),
)
def test_constraints(pair):
    """What is exported as master-slave constraints holds for the solution, and for translations."""
    case = curved(pair)
    u = cases.displacements(case)
    problem, tie = coupled(case, u, multiplier="dual")
    problem.solve()
    solution = np.concatenate(comm.allgather(nodal.displacements(problem)))
    c = tie.constraints()
    assert comm.allreduce(len(c.slaves)) == 3 * tie.num_multiplier_nodes
    first = 3 * problem.coupling.layout.first_block
    slaves = set().union(*comm.allgather((first + c.slaves).tolist()))
    assert not slaves.intersection(c.masters.tolist())
    scale = np.abs(solution).max()
    starts = comm.allgather(first)
    assert (c.owners == np.searchsorted(starts, c.masters, side="right") - 1).all()
    for i, dof in enumerate(c.slaves):
        part = slice(c.offsets[i], c.offsets[i + 1])
        masters, coefficients = c.masters[part], c.coefficients[part]
        assert abs(solution[first + dof] - coefficients @ solution[masters]) < 1e-9 * scale
        assert abs(coefficients.sum() - 1) < 1e-11
        assert (masters % 3 == dof % 3).all()


@pytest.mark.parametrize("multiplier", ["dual", "dual-reproducing"])
def test_same_solution_on_all_ranks(multiplier):
    """Displacements of a state that is not uniform."""
    case, alone = curved(("quad8", "tri6")), curved(("quad8", "tri6"), MPI.COMM_SELF)
    tables = []
    for c in (case, alone):
        u = cases.displacements(c)
        problem, _ = coupled(c, u, multiplier=multiplier)
        problem.solve()
        values = np.vstack(problem.comm.allgather(nodal.displacements(problem).reshape(-1, 3)))
        tables.append(values[order(positions(c, problem))])
    assert np.abs(tables[0] - tables[1]).max() < 1e-12 * np.abs(tables[1]).max()


@pytest.mark.serial
@pytest.mark.parametrize("multiplier", ["dual-linear", "dual-reproducing", "standard"])
def test_no_sparse_inverse(multiplier):
    _, tie = coupled(curved(KINDS[2]), multiplier=multiplier)
    for name in ("D_inverse", "P"):
        with pytest.raises(RuntimeError, match="multiplier='dual'"):
            getattr(tie, name)
    with pytest.raises(RuntimeError, match="multiplier='dual'"):
        tie.constraints()
