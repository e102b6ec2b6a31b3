# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Arguments of the wrong size, type or range are refused, and nothing beyond an array is read."""

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import distribute
from dolfinx_mortar import cpp
from facet_pairs import SPACE, TYPE

pytestmark = pytest.mark.serial
comm = MPI.COMM_WORLD
REFUSED = (ValueError, IndexError, TypeError, RuntimeError)


def refuses(function, arguments, wrong):
    """The call goes well, and no more with one argument changed to each of some values."""
    function(*arguments.values())
    for name, values in wrong.items():
        assert name in arguments
        for value in values:
            try:
                function(*(arguments | {name: value}).values())
            except REFUSED:
                continue
            pytest.fail(f"{name} = {value!r} is not refused")


def flags(n):
    return np.ones(n, np.int8)


def test_transformations():
    for function in (cpp.transformation, cpp.inverse_transformation):
        arguments = {"space": SPACE["dual"], "type": TYPE["quad9"], "nonnegative": flags(9)}
        wrong = {
            "space": [7, None],
            "type": [7, "quad9"],
            "nonnegative": [flags(8), flags(10), 1.0],
        }
        refuses(function, arguments, wrong)


def test_polygons():
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    bad = [[], square[:2], [*square, (-1.0, 0.5)], [(0.0,)] * 3]
    refuses(
        cpp.clip,
        {"slave": square, "master": square, "tol": 1e-9},
        {"slave": bad, "master": bad, "tol": ["a"]},
    )


def test_pairs():
    x = np.column_stack([oracle.REFERENCE_NODES["tri3"], np.zeros(3)])
    arguments = {
        "slave_type": TYPE["tri3"],
        "slave_orientation": 1,
        "slave": x,
        "master_type": TYPE["tri3"],
        "master_orientation": -1,
        "master": x,
        "integration": cpp.Integration.segment,
        "degree": 3,
        "derivatives": False,
    }
    positions = [x[:2], np.vstack([x, x]), x[0], "x"]
    wrong = {
        "slave": positions,
        "master": positions,
        "slave_orientation": [0, 2],
        "master_orientation": [0],
        "degree": [-1, 10**6],
        "slave_type": [TYPE["quad4"], 9],
    }
    refuses(cpp.pair_points, arguments, wrong)


def test_facet_integrals():
    x = np.column_stack([oracle.REFERENCE_NODES["quad8"], np.zeros(8)])
    arguments = {
        "slave_type": TYPE["quad8"],
        "slave_orientation": 1,
        "slave": x,
        "normals": np.tile([0, 0, 1.0], (8, 1)),
        "has_multiplier": flags(8),
        "z": np.zeros((8, 3)),
        "types": [TYPE["quad8"]],
        "orientation": -flags(1),
        "blocks": np.arange(8),
        "masters": x,
        "space": SPACE["dual"],
        "integration": cpp.Integration.segment,
        "degree": None,
        "derivatives": cpp.Derivatives.gap,
        "nonnegative": flags(8),
    }
    wrong = {
        "slave": [x[:7]],
        "normals": [x[:7], np.zeros(8)],
        "has_multiplier": [flags(7), flags(9)],
        "z": [x[:7]],
        "types": [[TYPE["quad8"]] * 2, [TYPE["quad9"]], []],
        "orientation": [-flags(2), 3 * flags(1)],
        "blocks": [np.arange(7)],
        "masters": [x[:7]],
        "degree": [0, 10**6],
        "nonnegative": [flags(7)],
    }
    refuses(cpp.integrate_facet, arguments, wrong)


@pytest.fixture
def surfaces():
    rng = np.random.default_rng(1)
    slave = distribute(comm, oracle.patch("quad4", (2, 2)), rng=rng)
    master = oracle.patch("tri3", (2, 2), height=0.05, outward=-1)
    return slave, distribute(comm, master, first_block=10**6, rng=rng)


def test_surfaces(surfaces):
    s, x = surfaces[0].surface, surfaces[0].x
    short = [x[:-1], np.vstack([x, x])]
    fixed = np.zeros(x.shape, np.int8)
    normals = cpp.compute_normals(s, x)
    refuses(cpp.check_areas, {"s": s, "x": x}, {"x": short, "s": [None]})
    refuses(
        cpp.compute_normals, {"s": s, "x": x, "fixed": fixed}, {"x": short, "fixed": [fixed[:-1]]}
    )
    refuses(
        cpp.normal_derivative,
        {"s": s, "x": x, "fixed": fixed, "normals": normals, "f": 0},
        {"x": short, "fixed": [fixed[:-1]], "f": [-1, s.num_facets], "normals": [None]},
    )
    values = np.zeros(s.num_nodes)
    refuses(cpp.scatter_forward, {"s": s, "a": values}, {"a": [values[:-1], values.astype("f4")]})


def test_interfaces(surfaces):
    s, m = surfaces[0].surface, surfaces[1].surface
    n, xs, xm = s.num_nodes, surfaces[0].x, surfaces[1].x
    options = cpp.IntegrationOptions(SPACE["dual"], cpp.Integration.segment)
    arguments = {"slave": s, "master": m, "options": options}
    refuses(cpp.Interface, arguments, {"slave": [None], "options": [None]})
    interface = cpp.Interface(s, m, options)
    other = cpp.Interface(m, s, options)
    refuses(
        cpp.configure,
        {"interface": interface, "x_slave": xs, "x_master": xm},
        {"x_slave": [xs[:-1]], "x_master": [xm[:-1]]},
    )
    c, foreign = cpp.configure(interface, xs, xm), cpp.configure(other, xm, xs)
    basis = cpp.create_basis(interface)
    short = [cpp.Basis(*(flags(n - (k == j)) for j in range(3))) for k in range(3)]
    arguments = {"interface": interface, "basis": basis, "configuration": c}
    refuses(cpp.integrate, arguments, {"configuration": [foreign], "basis": short})
    arguments |= {
        "local_rows": 3 * n,
        "local_columns": 3 * int(s.blocks.max() + m.blocks.max() + 1),
        "name": "D",
    }
    refuses(cpp.mortar_matrix, arguments, {"configuration": [foreign], "name": ["E"]})
    refuses(
        cpp.nodal_weights,
        {"interface": interface, "nonnegative": flags(n), "x": xs},
        {"x": [xs[:-1]], "nonnegative": [flags(n - 1)]},
    )
    refuses(
        cpp.flag_nonnegative,
        {"interface": interface, "beyond": np.zeros(s.num_facets)},
        {"beyond": [np.zeros(s.num_facets - 1)]},
    )


def test_contact_laws():
    n = 3
    vector, scalar = np.ones((n, 3)), np.ones(n)
    arguments = {
        "z": vector,
        "normal": vector,
        "gap": scalar,
        "weighted_slip": vector,
        "scale": scalar,
        "c_n": scalar,
        "c_t": scalar,
        "has_multiplier": flags(n),
        "fixed": np.zeros((n, 3), np.int8),
        "friction": 0.3,
        "bound": None,
        "forced": [cpp.Status.stick] * n,
    }
    wrong = {name: [v[:-1]] for name, v in arguments.items() if isinstance(v, np.ndarray)}
    wrong["has_multiplier"] = [flags(n + 1)]
    wrong["forced"] = [[cpp.Status.stick] * (n + 1), [3] * n, [-1] * n]
    wrong["weighted_slip"] += [None]
    wrong["scale"] += [None]
    refuses(cpp.contact_residual, arguments, wrong)
