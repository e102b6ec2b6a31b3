"""Dual mortar contact and mesh tying for FEniCSx."""

# MPI must be started by mpi4py, and DOLFINx's types must be known to nanobind
# before our extension can take them.
from mpi4py import MPI  # noqa: F401, I001
import dolfinx
import numpy as np

if np.issubdtype(dolfinx.default_scalar_type, np.complexfloating):
    raise ImportError(
        "dolfinx_mortar needs real PETSc scalars, and this DOLFINx is a complex one: "
        "set PETSC_DIR to a real build."
    )

try:
    from . import cpp
except ImportError as error:
    raise ImportError(
        "dolfinx_mortar's compiled part does not fit this environment (DOLFINx "
        f"{dolfinx.__version__}): build it again here. ({error})"
    ) from error

# nanobind shares types between two extensions only if their internals are the
# same version, and then they also share the type of their functions.
if not any(type(f) is type(dolfinx.cpp.mesh.create_mesh) for f in vars(cpp).values()):
    raise ImportError(
        "dolfinx_mortar and DOLFINx were built with different versions of nanobind, so neither "
        "knows the other's types: build dolfinx_mortar with the nanobind that DOLFINx was built "
        "with."
    )

from .contact import Contact
from .elements import hex20
from .errors import ConvergenceError
from .interfaces import Interface, Tie
from .problem import ContactProblem
from .relocation import adjust, relocate
from .tools import RigidCylinder, RigidPlane, RigidSphere, RigidSurface, RigidTool

__version__: str = cpp.version

__all__ = [
    "Contact",
    "ContactProblem",
    "ConvergenceError",
    "Interface",
    "RigidCylinder",
    "RigidPlane",
    "RigidSphere",
    "RigidSurface",
    "RigidTool",
    "Tie",
    "adjust",
    "hex20",
    "relocate",
]
