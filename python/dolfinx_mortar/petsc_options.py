# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""PETSc options of a problem."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from . import agreement, cpp

# Defaults of Newton's iteration and of three kinds of linear solvers
_NEWTON = {"snes_rtol": 1e-9, "snes_max_it": 50, "snes_linesearch_type": "basic"}
_FACTORISATION = {"pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": 60}
_KRYLOV = {"ksp_type": "gmres", "ksp_rtol": 1e-8, "ksp_gmres_restart": 200}
_MULTIGRID = {
    "mg_levels_pc_type": "sor",
    "mg_levels_ksp_max_it": 1,
    "pc_gamg_threshold": 0.02,
}

# Options that a name which PETSc does not know may have been meant for
_COMMON = [
    *("snes_rtol", "snes_atol", "snes_stol", "snes_max_it", "snes_max_funcs", "snes_type"),
    *("snes_monitor", "snes_converged_reason", "snes_view", "snes_linesearch_type"),
    *("snes_linesearch_max_it", "snes_linesearch_monitor", "snes_linesearch_damping"),
    *("snes_lag_jacobian", "snes_lag_preconditioner", "snes_error_if_not_converged"),
    *("ksp_type", "ksp_rtol", "ksp_atol", "ksp_divtol", "ksp_max_it", "ksp_monitor", "ksp_view"),
    *("ksp_converged_reason", "ksp_norm_type", "ksp_pc_side", "ksp_gmres_restart"),
    *("ksp_error_if_not_converged", "pc_type", "pc_factor_mat_solver_type", "pc_factor_levels"),
    *("pc_gamg_type", "pc_gamg_threshold", "pc_gamg_threshold_scale", "pc_gamg_agg_nsmooths"),
    *("pc_gamg_coarse_eq_limit", "pc_hypre_type", "pc_mg_levels", "mg_levels_pc_type"),
    *("mg_levels_ksp_type", "mg_levels_ksp_max_it", "mg_coarse_pc_type", "mg_coarse_ksp_type"),
]
# The others need an energy, or a function of the user
_LINE_SEARCHES = ("basic", "bt", "l2", "nleqerr")
# They replace the matrix that contact is linearised in
_NO_MATRIX = ("snes_mf", "snes_mf_operator", "snes_fd", "snes_fd_color")


class PetscOptions:
    """Options of a problem, and what is best for those that are not given.

    Args:
        prefix: Prefix of all names.
        options: The user's options, without the prefix; they count more than what the command
            line says, and that more than defaults.

    Raises:
        ValueError: A name or a prefix is no text, or an option can not work with interfaces.

    Attributes:
        prefix: Prefix of all names.
        given: The user's options.
        line_search: Kind of line search.
    """

    def __init__(self, prefix: str, options: dict[str, Any] | None):
        options = {} if options is None else options
        if not isinstance(prefix, str):
            raise ValueError(f"petsc_options_prefix is {prefix!r}, but must be a string.")
        if not isinstance(options, dict) or any(not isinstance(key, str) for key in options):
            raise ValueError(
                f"petsc_options are {options!r}, but must be a dictionary whose keys are strings, "
                "names of PETSc options without the prefix."
            )
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
        self.given, self._defaults = dict(options), set(defaults) - set(options)
        #: Names without the prefix that nothing has asked for so far; None before the first time
        self._unread: set[str] | None = None
        self._warned = False
        self._check_values(chosen)

    def _check_values(self, chosen: Callable[[str], Any]) -> None:
        """Refuse what can not work with interfaces.

        Args:
            chosen: Value of an option without the prefix, None where there is none.
        """
        line_search = chosen("snes_linesearch_type") or _NEWTON["snes_linesearch_type"]
        self.line_search = line_search
        if line_search not in _LINE_SEARCHES:
            raise ValueError(
                f"snes_linesearch_type is {line_search!r}, but must be one of "
                f"{', '.join(map(repr, _LINE_SEARCHES))}."
            )
        for key in _NO_MATRIX:
            if key in self.given or PETSc.Options().hasName(self.prefix + key):
                raise ValueError(
                    f"The option {key} does without the Jacobian, which holds the conditions of "
                    "the interfaces: leave it out."
                )
        if str(chosen("snes_lag_jacobian") or 1).startswith("-") or chosen(
            "snes_lag_jacobian_persists"
        ):
            raise ValueError(
                "The Jacobian belongs to one solve: snes_lag_jacobian must be positive, and "
                "snes_lag_jacobian_persists is not available."
            )

    def effective(self) -> list[tuple[str, str]]:
        """Names and values that count: the user's, the command line's, and defaults."""
        database = PETSc.Options().getAll()
        values = {k: v for k, v in database.items() if k.startswith(self.prefix)} | self._values
        return sorted((k, str(v)) for k, v in values.items())

    @contextmanager
    def lent(self) -> Iterator[None]:
        """Lend the options to PETSc's database, for solvers that are set up inside.

        What was in the database before is there again afterwards.
        """
        database = PETSc.Options()
        names = [name for name in self._values if database.hasName(name)]
        before = {name: database.getString(name) or None for name in names}
        try:
            for name, value in self._values.items():
                database.setValue(name, value)
            yield
        finally:
            self._note_unread()
            for name in self._values:
                if name in before:
                    database.setValue(name, before[name])
                else:
                    database.delValue(name)

    # -- Options without effect --------------------------------------------------

    def _note_unread(self) -> None:
        n = len(self.prefix)
        unread = {name[n:] for name in cpp.unread_options() if name.startswith(self.prefix)}
        self._unread = unread if self._unread is None else self._unread & unread

    def check_names(self) -> None:
        """Refuse names that look like slips of the pen, once solvers have been set up.

        Nested solvers take their options later; :meth:`warn_of_unread` is about these.

        Raises:
            ValueError: Nothing has asked for a name, but for one that is nearly the same.
        """
        for name in sorted((self._unread or set()) & set(self.given)):
            near = _meant(name)
            if near:
                raise ValueError(f"PETSc has no use for the option {name!r}: is {near!r} meant?")

    def warn_of_unread(self, comm: MPI.Comm) -> None:
        """Warn, once, of options that nothing has asked for in the first solve. Collective."""
        if self._warned:
            return
        self._warned = True
        names = (self._unread or set()) - self._defaults
        with agreement.alike(comm):
            if names and comm.rank == 0:
                warnings.warn(
                    f"No solver has asked for the PETSc options {', '.join(sorted(names))} (prefix "
                    f"{self.prefix!r}): they are misspelt, or belong to solvers that are not in "
                    "use.",
                    stacklevel=4,
                )


def _meant(name: str) -> str | None:
    """The common option that a name was probably meant to be, None if it is one or is far off."""
    name = name.lower()
    if any(name == known or name.endswith("_" + known) for known in _COMMON):
        return None
    return next(iter(difflib.get_close_matches(name.lstrip("-"), _COMMON, 1, 0.85)), None)
