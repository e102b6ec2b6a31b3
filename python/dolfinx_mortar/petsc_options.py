# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""PETSc options of a problem."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

# Defaults of Newton's iteration and of three kinds of linear solvers
_NEWTON = {"snes_rtol": 1e-9, "snes_max_it": 50, "snes_linesearch_type": "basic"}
_FACTORISATION = {"pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": 60}
_KRYLOV = {"ksp_type": "gmres", "ksp_rtol": 1e-8, "ksp_gmres_restart": 200}
_MULTIGRID = {
    "mg_levels_pc_type": "sor",
    "mg_levels_ksp_max_it": 1,
    "pc_gamg_threshold": 0.02,
}


class PetscOptions:
    """Options of a problem, and what is best for those that are not given.

    Args:
        prefix: Prefix of all names.
        options: The user's options, without the prefix; they count more than what the command
            line says, and that more than defaults.

    Attributes:
        prefix: Prefix of all names.
    """

    def __init__(self, prefix: str, options: dict[str, Any]):
        self.prefix = prefix
        database = PETSc.Options()

        def chosen(key: str) -> str | None:
            return options.get(key) or database.getString(prefix + key, "") or None

        pc, ksp = chosen("pc_type"), chosen("ksp_type")
        defaults = dict(_NEWTON)
        if pc in (None, "lu") and ksp in (None, "preonly"):
            defaults |= {"ksp_type": "preonly", "pc_type": "lu"}
        elif ksp != "preonly":
            # A Cholesky factorisation, too, is one of the reduced system only
            defaults |= _KRYLOV
        if pc in ("lu", "cholesky") or defaults.get("pc_type") == "lu":
            defaults |= _FACTORISATION
        elif pc == "gamg":
            defaults |= _MULTIGRID
        self._values = {
            prefix + k: v for k, v in defaults.items() if not database.hasName(prefix + k)
        }
        self._values |= {prefix + k: v for k, v in options.items()}

    @contextmanager
    def lent(self) -> Iterator[None]:
        """Lend the options to PETSc's database, for solvers that are set up inside."""
        database = PETSc.Options()
        for name, value in self._values.items():
            database.setValue(name, value)
        try:
            yield
        finally:
            for name in self._values:
                database.delValue(name)
