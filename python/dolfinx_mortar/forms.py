# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Forms of the bodies: what they must be. If they are not, a ValueError says what and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl
from dolfinx import fem
from ufl.algorithms import extract_coefficients

#: Of forms with 0, 1 and 2 arguments
_KINDS = ("a number, as an energy is", "linear", "bilinear")
_CURES = {
    ("F", 0): "Differentiate it: F = ufl.derivative(energy, u).",
    ("F", 2): (
        "F is the residual, linear in its TestFunction, in which the displacement u itself "
        "stands and no TrialFunction: write inner(sigma(u), eps(v)) * dx - inner(f, v) * dx."
    ),
    ("J", 0): "Leave J out: by default it is the derivative of F.",
    ("J", 1): "Leave J out: by default it is the derivative of F.",
}


def check_functions(functions: Sequence[Any]) -> None:
    """Refuse displacements that are none."""
    for u in functions:
        if not isinstance(u, fem.Function):
            raise ValueError(
                f"u is a {type(u).__name__}, but must be a dolfinx.fem.Function, or a list with "
                "one for each body."
            )
    spaces = [u.function_space._cpp_object for u in functions]
    if any(V == W for k, V in enumerate(spaces) for W in spaces[:k]):
        raise ValueError(
            "Two displacements are on the same function space: give each mesh one displacement. "
            "A mesh may hold several bodies."
        )


def check(name: str, forms: Sequence[Any], functions: Sequence[fem.Function]) -> list[str]:
    """Refuse forms of another kind, number or space.

    Args:
        name: ``"F"`` or ``"J"``.
        forms: What the user gave, one for each body.
        functions: Displacement of each body.

    Returns:
        For each form, what is the same on all ranks.
    """
    if len(forms) != len(functions):
        raise ValueError(
            f"{name} has {len(forms)} forms for {len(functions)} displacements: each body "
            "needs one of both."
        )
    return [_check_form(name, b, f, u) for b, (f, u) in enumerate(zip(forms, functions))]


def _check_form(name: str, body: int, form: Any, u: fem.Function) -> str:
    title = name if body == 0 else f"{name}[{body}]"
    rank = 1 if name == "F" else 2
    if isinstance(form, ufl.Form):
        arguments = form.arguments()
        spaces = [a.ufl_function_space() for a in arguments]
        text = form.signature() if arguments else ""
    elif isinstance(form, fem.Form):
        spaces, text = form.function_spaces, "compiled"
    else:
        raise ValueError(
            f"{title} is a {type(form).__name__}, but must be a UFL form: one for each body."
        )
    if len(spaces) != rank:
        cure = _CURES.get((name, len(spaces)), "")
        kind = _KINDS[len(spaces)] if len(spaces) < 3 else f"of rank {len(spaces)}"
        raise ValueError(f"{title} is {kind}, but must be {_KINDS[rank]}. {cure}")
    V = u.function_space
    for W in spaces:
        W = getattr(W, "_cpp_object", W)
        if W != V._cpp_object:
            what = "space" if W.mesh == V.mesh._cpp_object else "mesh"
            raise ValueError(
                f"{title} has a test or trial function of another {what} than its displacement: "
                "make them of u.function_space, and name forms and displacements in the same "
                "order."
            )
    if isinstance(form, ufl.Form):
        functions = [c for c in form.coefficients() if isinstance(c, fem.Function)]
        meshes = [f.function_space.mesh._cpp_object for f in functions]
        meshes += [i.ufl_domain().ufl_cargo() for i in form.integrals()]
        if any(m is not V.mesh._cpp_object for m in meshes):
            raise ValueError(
                f"{title} has functions or integrals of another mesh than its displacement: "
                "interfaces couple bodies, forms do not."
            )
        if name == "F" and not any(f is u for f in functions):
            raise ValueError(
                f"{title} does not contain the displacement of its body: F is the residual, in "
                "which the function u itself stands (and no TrialFunction)."
            )
    return text


def derivatives(forms: Sequence[Any], functions: Sequence[fem.Function]) -> list[ufl.Form]:
    """Derivatives of residuals by the displacements.

    Dead loads are left out before, so that residuals that differ in these alone have the same
    derivative, which is compiled once.
    """
    if any(isinstance(f, fem.Form) for f in forms):
        raise ValueError(
            "F is compiled, so that it cannot be differentiated any more: give the UFL form, or "
            "give J as well."
        )
    return [
        ufl.derivative(_dependent(f, u), u, ufl.TrialFunction(u.function_space))
        for f, u in zip(forms, functions)
    ]


def _dependent(form: ufl.Form, u: fem.Function) -> ufl.Form:
    """Those integrals of a form in which a function stands."""
    return ufl.Form(
        [
            integral
            for integral in form.integrals()
            if any(c is u for c in extract_coefficients(integral.integrand()))
        ]
    )
