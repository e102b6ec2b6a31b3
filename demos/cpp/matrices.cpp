// The mortar matrices of two bodies whose meshes do not match, from C++.
//
//   cmake -G Ninja -B build -DCMAKE_PREFIX_PATH=<prefix> && cmake --build build
//   mpirun -n 2 build/matrices
//
// A block of hexahedra stands on a larger one of tetrahedra. The two meshes are
// separate DOLFINx meshes, with a displacement space of degree 2 on each. D and
// M (equations 3.5 and 3.6 of the paper) are made as PETSc matrices, and
// checked against what every pair of mortar matrices has to fulfil.

#include <basix/finite-element.h>
#include <cmath>
#include <dolfinx.h>
#include <dolfinx_mortar/assembly/mortar.h>
#include <dolfinx_mortar/dolfinx/adapter.h>
#include <dolfinx_mortar/dolfinx/bodies.h>
#include <dolfinx_mortar/dolfinx/compat.h>
#include <iostream>
#include <memory>
#include <petsc.h>

using namespace dolfinx;
namespace mortar = dolfinx_mortar;

// A box with its displacement space
std::shared_ptr<fem::FunctionSpace<double>>
create_body(std::array<std::array<double, 3>, 2> corners,
            std::array<std::int64_t, 3> cells, mesh::CellType type)
{
  auto domain = std::make_shared<mesh::Mesh<double>>(
      mesh::create_box<double>(MPI_COMM_WORLD, corners, cells, type));
  auto element = basix::create_element<double>(
      basix::element::family::P, mesh::cell_type_to_basix_type(type), 2,
      basix::element::lagrange_variant::gll_warped,
      basix::element::dpc_variant::unset, false);
  return mortar::compat::create_vector_space(domain, element);
}

// The facets of a body in the plane z = 1, as one side of the interface
mortar::Surface create_side(const fem::FunctionSpace<double>& V,
                            std::span<const std::int64_t> block_numbers,
                            const std::string& name)
{
  auto in_plane = [](auto x)
  {
    std::vector<std::int8_t> marker(x.extent(1));
    for (std::size_t i = 0; i < marker.size(); ++i)
      marker[i] = std::abs(x(2, i) - 1) < 1e-8;
    return marker;
  };
  auto facets = mesh::locate_entities_boundary(*V.mesh(), 2, in_plane);
  return mortar::create_surface(V, facets, block_numbers, name);
}

int main(int argc, char* argv[])
{
  dolfinx::init_logging(argc, argv);
  PetscInitialize(&argc, &argv, nullptr, nullptr);
  {
    auto upper = create_body({{{0.1, 0.2, 1}, {0.8, 0.9, 1.5}}}, {3, 3, 2},
                             mesh::CellType::hexahedron);
    auto lower = create_body({{{0, 0, 0}, {1, 1, 1}}}, {4, 4, 4},
                             mesh::CellType::tetrahedron);

    // The displacements of both bodies, side by side in one vector
    const std::vector<std::shared_ptr<const mortar::FunctionSpace>> spaces
        = {upper, lower};
    const mortar::Layout layout = mortar::create_layout(MPI_COMM_WORLD, spaces);

    // The upper side carries the multipliers: it is finer, and all of it is
    // covered by the other
    const mortar::Interface interface = mortar::create_interface(
        create_side(*upper, layout.blocks[0], "slave surface"),
        create_side(*lower, layout.blocks[1], "master surface"));
    const mortar::Basis basis = mortar::create_basis(interface);

    // The bodies are undeformed; otherwise, see current_positions
    const mortar::Configuration configuration
        = mortar::configure(interface, interface.slave.X, interface.master.X);
    mortar::BlockAccumulator<1, 1> blocks_D, blocks_M;
    const mortar::NodalIntegrals nodal = mortar::integrate(
        interface, basis, configuration, {.D = &blocks_D, .M = &blocks_M});

    // D and M have a row for each multiplier and a column for each displacement
    const PetscInt rows = 3 * interface.slave.num_owned;
    const mortar::Matrix D
        = blocks_D.assemble(MPI_COMM_WORLD, rows, layout.size());
    const mortar::Matrix M
        = blocks_M.assemble(MPI_COMM_WORLD, rows, layout.size());

    // A common translation opens no gap: the row sums of D and M are equal
    Vec translation, jump;
    MatCreateVecs(D.get(), &translation, &jump);
    VecSet(translation, 1);
    MatMult(D.get(), translation, jump);
    VecScale(jump, -1);
    MatMultAdd(M.get(), translation, jump, jump);

    double norm_D, norm_M, difference, area = 0;
    MatNorm(D.get(), NORM_FROBENIUS, &norm_D);
    MatNorm(M.get(), NORM_FROBENIUS, &norm_M);
    VecNorm(jump, NORM_INFINITY, &difference);
    MPI_Reduce(&nodal.area, &area, 1, MPI_DOUBLE, MPI_SUM, 0, MPI_COMM_WORLD);
    if (dolfinx::MPI::rank(MPI_COMM_WORLD) == 0)
    {
      std::cout.precision(12);
      std::cout << "multipliers:               " << interface.slave.num_global
                << "\nnorm of D:                 " << norm_D
                << "\nnorm of M:                 " << norm_M
                << "\nlargest row sum of D - M:  " << difference
                << "\ncovered area:              " << area << "  (exact: 0.49)"
                << std::endl;
    }

    VecDestroy(&translation);
    VecDestroy(&jump);
  }
  PetscFinalize();
}
