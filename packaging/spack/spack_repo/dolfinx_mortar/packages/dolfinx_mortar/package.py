"""The C++ library."""

from spack.package import *
from spack_repo.builtin.build_systems.cmake import CMakePackage


class DolfinxMortar(CMakePackage):
    """Dual mortar contact and mesh tying for FEniCSx, C++ library."""

    license("MIT")

    # A release adds its url and version(..., sha256=...); until then: spack develop
    version("develop")

    depends_on("c", type="build")
    depends_on("cxx", type="build")
    depends_on("cmake@3.21:", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("eigen")
    depends_on("fenics-dolfinx@0.9: +petsc")
    depends_on("mpi")
    depends_on("petsc ~complex +double +mumps")

    conflicts("%gcc@:9", msg="C++20 is needed")

    def cmake_args(self):
        return [self.define("MORTAR_PYTHON", False), self.define("MORTAR_UNITY", True)]
