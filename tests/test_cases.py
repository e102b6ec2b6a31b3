# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The rebuilt reference problems are what they claim to be, before anything is solved.

The strongest check: put the exact solution of a patch test in; then the nodal forces of the bodies
must be, on the interfaces, those of the constant traction as the oracle integrates it on both
sides, and zero elsewhere.
"""

import cases
import numpy as np
import oracle
import pytest
import ufl
from dolfinx import fem, la

# For comparisons with the oracle, which is serial.
serial = pytest.mark.serial

BLOCK = 2 * (0.70922**2 + 0.233029**2)

BUILDERS = {
    cases.tied_patch_overhang: (400.0, 100.0),
    cases.tied_hex27: (1.0, 1.0),
    cases.tied_patch_seven: None,
    cases.contact_patch: (0.125, 0.5),
    cases.rotated_block: (BLOCK * 1.0852425, 16.0),
    cases.sliding_block: (1.0, 5.5),
}


def volume(case, part):
    body = case.bodies[case.body[part]]
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    local = fem.assemble_scalar(fem.form(fem.Constant(body.mesh, 1.0) * dx(part + 1)))
    return body.mesh.comm.allreduce(local)


def area(surface):
    return sum(oracle.facet_area(surface, f, 4) for f in range(len(surface.facets)))


def nodal_forces(case, u):
    forces = []
    for F in cases.residuals(case, u):
        b = fem.assemble_vector(fem.form(F))
        b.scatter_reverse(la.InsertMode.add)
        forces.append(b.array.reshape(-1, 3).copy())
    return forces


@pytest.mark.parametrize("build", BUILDERS, ids=lambda f: f.__name__)
def test_volumes_and_expected_nodes(build):
    case = build()
    totals = [volume(case, p) for p in range(len(case.parts))]
    if len(totals) == 2:
        assert totals == pytest.approx(BUILDERS[build], rel=1e-5)
    else:
        # The whole prism, and the quarter of it below the sloping plane.
        assert sum(totals) == pytest.approx(72.0)
        assert totals[0] == pytest.approx(2.25 * (4 - 1 / 3))
    u = cases.displacements(case)
    for e in case.expected:
        assert np.all(cases.displacement_at(case, u, e.part, e.point) == 0)
    with pytest.raises(ValueError, match="no node"):
        cases.displacement_at(case, u, 0, (17.0, 0.0, 0.0))


@serial
def test_interfaces_have_the_right_facets_and_areas():
    expected = {
        cases.tied_patch_overhang: [("quad4", "quad4", 100.0, 25.0)],
        cases.tied_hex27: [("quad9", "quad9", 1.0, 1.0)],
        cases.contact_patch: [("quad4", "quad4", 0.25, 0.25)],
        cases.rotated_block: [("quad4", "quad4", BLOCK, 16.0)],
        cases.sliding_block: [("quad8", "quad8", 1.0, 5.5)],
    }
    for build, rows in expected.items():
        case = build()
        for interface, row in zip(case.interfaces, rows, strict=True):
            (slave, _), (master, _) = cases.interface_surfaces(case, interface)
            assert {k for k, _ in slave.facets} == {row[0]}
            assert {k for k, _ in master.facets} == {row[1]}
            assert (area(slave), area(master)) == pytest.approx(row[2:], rel=1e-5)


@serial
def test_seven_interfaces_pair_all_kinds():
    case = cases.tied_patch_seven()
    pairs = []
    for interface in case.interfaces:
        (slave, _), (master, _) = cases.interface_surfaces(case, interface)
        pairs.append(({k for k, _ in slave.facets}, {k for k, _ in master.facets}))
        assert area(slave) == pytest.approx(area(master))
        r = oracle.mortar(slave, master, "standard", points=3)
        assert r.area.sum() == pytest.approx(area(slave))
        assert np.allclose(r.relative, 0, atol=1e-13)
    assert pairs == [
        ({"quad9"}, {"tri6"}),
        ({"quad4"}, {"tri6"}),
        ({"quad9"}, {"quad4"}),
        ({"quad4"}, {"quad8"}),
        ({"quad8"}, {"tri3"}),
        ({"quad4"}, {"tri3"}),
        ({"tri6", "quad4", "quad9"}, {"tri3", "quad4", "quad8"}),
    ]
    assert area(slave) == pytest.approx(9 * np.sqrt(11) / 3)


# Nominal stress of the exact solutions; only the zz component is not zero.
PATCHES = [
    (cases.tied_patch_overhang, {}, -1.0),
    (cases.tied_patch_overhang, {"one_mesh": True}, -1.0),
    (cases.contact_patch, {}, -100.0),
    (cases.contact_patch, {"one_mesh": True}, -100.0),
    (cases.tied_patch_seven, {}, 1000.0),
]


@serial
@pytest.mark.parametrize("build,options,stress", PATCHES)
def test_exact_solutions_are_in_balance(build, options, stress):
    case = build(**options)
    u = cases.displacements(case)
    cases.set_exact(case, u)
    forces = nodal_forces(case, u)
    largest = max(np.abs(f).max() for f in forces)

    on_interface = [np.zeros_like(f) for f in forces]
    for interface in case.interfaces:
        (slave, s_nodes), (master, m_nodes) = cases.interface_surfaces(case, interface)
        # On quadrilaterals that are not parallelograms a shape function is no polynomial of the
        # position, and the bodies' own surface integrals are met only as the rule converges.
        r = oracle.mortar(slave, master, "dual", points=8)
        kind, _, x, sign = slave.facet(0)
        normal = oracle.unit_normals(kind, x, oracle.REFERENCE_NODES[kind][:1], sign)[0]
        traction = np.array([0, 0, stress * normal[2]])
        for (b, dof), share in zip(s_nodes, r.D.sum(axis=0), strict=True):
            on_interface[b][dof] += share * traction
        for (b, dof), share in zip(m_nodes, r.M.sum(axis=0), strict=True):
            on_interface[b][dof] -= share * traction

    bcs = cases.DirichletConditions(case)
    for b, body in enumerate(case.bodies):
        rest = forces[b] - on_interface[b]
        for bc in bcs.bcs:
            if bc.function_space.mesh == body.mesh._cpp_object:
                rest.reshape(-1)[bc.dof_indices()[0]] = 0
        assert np.abs(rest).max() < 1e-10 * largest


@pytest.mark.parametrize("build", BUILDERS, ids=lambda f: f.__name__)
def test_conditions_follow_time(build):
    case = build()
    u = cases.displacements(case)
    bcs = cases.DirichletConditions(case)
    bcs.set_time(case.times[-1])
    spaces = [body.V for body in case.bodies]
    for bc in bcs.bcs:
        for b, V in enumerate(spaces):
            if bc.function_space.mesh == V.mesh._cpp_object:
                bc.set(u[b].x.array)
    for condition in case.dirichlet:
        x, dofs = cases._part_nodes(case, condition.part)
        chosen = dofs[condition.where(x[dofs].T)]
        assert case.bodies[0].mesh.comm.allreduce(len(chosen)) > 0
        values = u[case.body[condition.part]].x.array.reshape(-1, 3)[chosen]
        target = np.array(condition.value(case.times[-1]))
        for i in condition.components:
            assert np.allclose(values[:, i], target[i])


def test_motions():
    """Prescribed motions at the times where they bend."""
    slide = cases.sliding_block().dirichlet[0].value
    assert [slide(t)[2] for t in (1, 2, 3)] == pytest.approx([-0.12, -0.22, -0.22])
    assert [slide(t)[0] for t in (1, 2, 3)] == pytest.approx([0, 0, 0.1])
    press = cases.rotated_block().dirichlet[0].value
    assert press(0.5) == pytest.approx((0, 0, -1))
    assert press(0.6) == pytest.approx((0.2, 0.2, -1))
    assert press(0.55) == pytest.approx((0.1, 0.1, -1))


@serial
def test_materials_have_the_same_small_strain_limit():
    """Second derivatives of the energies at rest agree, also for nu = 0."""
    case = cases.rotated_block()
    V = case.bodies[0].V
    u = fem.Function(V)
    v, w = ufl.TestFunction(V), ufl.TrialFunction(V)
    for nu in (0.0, 0.3):
        matrices = []
        for material in (cases.linear_elastic, cases.st_venant_kirchhoff, cases.neo_hooke):
            F = ufl.derivative(material(7.0, nu)(u) * ufl.dx(degree=3), u, v)
            A = fem.assemble_matrix(fem.form(ufl.derivative(F, u, w)))
            matrices.append(A.to_dense())
        for A in matrices[1:]:
            assert np.allclose(A, matrices[0], atol=1e-12)
