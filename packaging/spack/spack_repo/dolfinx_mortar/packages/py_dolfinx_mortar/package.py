"""The Python package, with the library inside its extension."""

from spack.package import *
from spack_repo.builtin.build_systems.python import PythonPackage


class PyDolfinxMortar(PythonPackage):
    """Dual mortar contact and mesh tying for FEniCSx, Python package."""

    license("MIT")

    # A release adds its url and version(..., sha256=...); until then: spack develop
    version("develop")

    depends_on("c", type="build")
    depends_on("cxx", type="build")
    depends_on("cmake@3.21:", type="build")
    depends_on("ninja", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("python@3.9:", type=("build", "run"))
    depends_on("py-scikit-build-core@0.10:", type="build")
    depends_on("py-nanobind@2.2:", type="build")
    depends_on("eigen")
    depends_on("fenics-dolfinx@0.9: +petsc")
    depends_on("mpi")
    depends_on("petsc ~complex +double +mumps")
    depends_on("py-fenics-dolfinx@0.9: +petsc4py", type=("build", "run"))
    depends_on("py-mpi4py", type=("build", "run"))
    depends_on("py-numpy", type=("build", "run"))
    depends_on("py-petsc4py", type=("build", "run"))
    depends_on("py-scipy", type=("build", "run"))

    conflicts("%gcc@:9", msg="C++20 is needed")

    def config_settings(self, spec, prefix):
        return {"cmake.define.MORTAR_UNITY": "ON", "cmake.define.MORTAR_STUBS": "OFF"}
