// A rubber block pressed onto another one and dragged over it, from C++.
//
//   cmake -G Ninja -B build -DCMAKE_PREFIX_PATH=<prefix> && cmake --build build
//   mpirun -n 2 build/contact
//
// Two blocks lie on each other in the plane z = 1. Each is a DOLFINx mesh of
// its own, and the nodes of the two do not meet. The top of the upper block is
// moved down in two steps, and then along x in three more; the bottom of the
// lower block is held. Friction carries the lower block along, until the upper
// one slides.
//
// After each step the program prints a line, and writes what ParaView shows to
// upper.bp and lower.bp. To watch the iterations, append -mortar_snes_monitor.

#include "hyperelasticity.h"
#include <algorithm>
#include <basix/finite-element.h>
#include <cmath>
#include <dolfinx.h>
#include <dolfinx/fem/Constant.h>
#include <dolfinx/io/ADIOS2Writers.h>
#include <dolfinx_mortar/dolfinx/compat.h>
#include <dolfinx_mortar/solver/problem.h>
#include <dolfinx_mortar/solver/results.h>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <petsc.h>
#include <string>
#include <vector>

using namespace dolfinx;
namespace mortar = dolfinx_mortar;

// What a body is to the problem: residual, tangent and displacement. The forms
// come from hyperelasticity.py, and the displacement is of degree 2.
mortar::Body create_block(std::array<std::array<double, 3>, 2> corners,
                          std::array<std::int64_t, 3> cells, double mu,
                          double lmbda)
{
  auto mesh = std::make_shared<mesh::Mesh<double>>(mesh::create_box<double>(
      MPI_COMM_WORLD, corners, cells, mesh::CellType::hexahedron));
  auto element = basix::create_element<double>(
      basix::element::family::P, basix::cell::type::hexahedron, 2,
      basix::element::lagrange_variant::gll_warped,
      basix::element::dpc_variant::unset, false);
  auto V = mortar::compat::create_vector_space(mesh, element);
  auto u = std::make_shared<fem::Function<double>>(V);
  u->name = "displacement";

  const std::map<std::string, std::shared_ptr<const fem::Constant<double>>>
      constants = {{"mu", std::make_shared<fem::Constant<double>>(mu)},
                   {"lmbda", std::make_shared<fem::Constant<double>>(lmbda)}};
  auto F = std::make_shared<fem::Form<double>>(fem::create_form<double>(
      *form_hyperelasticity_F, {V}, {{"u", u}}, constants, {}, {}));
  auto J = std::make_shared<fem::Form<double>>(fem::create_form<double>(
      *form_hyperelasticity_J, {V, V}, {{"u", u}}, constants, {}, {}));
  return {F, J, u};
}

// The facets of a body in the plane of height z
std::vector<std::int32_t> find_facets(const mortar::Body& body, double z)
{
  return mesh::locate_entities_boundary(
      *body.u->function_space()->mesh(), 2,
      [z](auto x)
      {
        std::vector<std::int8_t> marker(x.extent(1));
        for (std::size_t i = 0; i < marker.size(); ++i)
          marker[i] = std::abs(x(2, i) - z) < 1e-8;
        return marker;
      });
}

// The same facets as a part of a surface: those that have the tag 1
mortar::TaggedFacets create_side(const mortar::Body& body, double z)
{
  auto V = body.u->function_space();
  std::vector<std::int32_t> facets = find_facets(body, z);
  std::vector<std::int32_t> values(facets.size(), 1);
  auto tags = std::make_shared<mesh::MeshTags<std::int32_t>>(
      V->mesh()->topology(), 2, std::move(facets), std::move(values));
  return {V, tags, 1};
}

// A Dirichlet condition on the side of a body at height z. Its value is a
// constant that may change from step to step.
std::shared_ptr<const mortar::DirichletBC>
prescribe(const mortar::Body& body, double z,
          std::shared_ptr<const fem::Constant<double>> value)
{
  auto V = body.u->function_space();
  const std::vector<std::int32_t> dofs = fem::locate_dofs_topological(
      *V->mesh()->topology_mutable(), *V->dofmap(), 2, find_facets(body, z));
  return std::make_shared<mortar::DirichletBC>(value, dofs, V);
}

// Let a function of the first body show a result. Results are values at the
// nodes of the slave surface, each on the rank that owns the node.
void show(const mortar::Field& result, fem::Function<double>& f)
{
  std::span<double> values = mortar::compat::values(*f.x());
  std::ranges::fill(values, 0.0);
  for (std::size_t i = 0; i < result.nodes.size(); ++i)
  {
    for (int c = 0; c < result.columns; ++c)
    {
      values[result.columns * result.nodes[i] + c]
          = result.values[result.columns * i + c];
    }
  }
  f.x()->scatter_fwd();
}

int main(int argc, char* argv[])
{
  dolfinx::init_logging(argc, argv);
  PetscInitialize(&argc, &argv, nullptr, nullptr);
  {
    // The upper block is the softer and the finer one, and all of its lower
    // side stays covered: it is the slave, the one that carries the multipliers
    mortar::Body upper
        = create_block({{{0.2, 0.2, 1}, {0.8, 0.8, 1.5}}}, {3, 3, 2}, 50, 75);
    mortar::Body lower
        = create_block({{{0, 0, 0.5}, {1.2, 1, 1}}}, {4, 4, 2}, 200, 300);

    const std::vector<double> zero = {0, 0, 0};
    auto motion = std::make_shared<fem::Constant<double>>(zero);
    auto rest = std::make_shared<fem::Constant<double>>(zero);

    // This is all there is to say about contact
    mortar::InterfaceOptions contact;
    contact.slave = {create_side(upper, 1)};
    contact.master = {create_side(lower, 1)};
    contact.contact = mortar::ContactOptions();
    contact.friction.coefficient = 0.3;

    // Newton's iteration is one for geometry, material and contact at once. Its
    // tolerance is tight here, so that all digits below are right
    mortar::ProblemOptions options;
    options.petsc_options = {{"snes_rtol", "1e-12"}};
    mortar::ContactProblem problem(
        MPI_COMM_WORLD, {upper, lower},
        {prescribe(upper, 1.5, motion), prescribe(lower, 0.5, rest)}, {contact},
        options);

    // Pressure is a number at each node, and has the scalar space for it, whose
    // nodes are those of the displacement
    auto Q = std::make_shared<const fem::FunctionSpace<double>>(
        upper.u->function_space()->sub({0}).collapse().first);
    auto pressure = std::make_shared<fem::Function<double>>(Q);
    pressure->name = "pressure";
    io::VTXWriter<double> upper_file(MPI_COMM_WORLD, "upper.bp",
                                     {upper.u, pressure},
                                     io::VTXMeshPolicy::reuse);
    io::VTXWriter<double> lower_file(MPI_COMM_WORLD, "lower.bp", {lower.u},
                                     io::VTXMeshPolicy::reuse);

    // The way of the upper block's top, along x and downwards
    const std::vector<std::array<double, 2>> way
        = {{0, 0.02}, {0, 0.04}, {0.02, 0.04}, {0.04, 0.04}, {0.06, 0.04}};
    for (std::size_t step = 1; step <= way.size(); ++step)
    {
      const auto [x, down] = way[step - 1];
      motion->value = {x, 0, -down};

      // A solve that does not converge raises a ConvergenceError, which tells
      // what to do, and leaves the displacements as they were
      const int iterations = problem.solve();

      double largest = 0;
      for (const mortar::Field& result : mortar::results(problem, 0))
      {
        if (result.name == "pressure")
        {
          show(result, *pressure);
          for (double p : result.values)
            largest = std::max(largest, p);
        }
      }
      upper_file.write(step);
      lower_file.write(step);

      // The contact force on the upper block; how many nodes stick and slip
      const std::array<double, 3> f = resultants(problem, 0).slave_force;
      const mortar::Iterate& last = problem.history().back();
      largest = mortar::max(MPI_COMM_WORLD, largest);
      if (dolfinx::MPI::rank(MPI_COMM_WORLD) == 0)
      {
        std::cout << std::scientific << std::setprecision(12)
                  << "step: " << step << ", iterations: " << iterations
                  << ", force: " << f[0] << " " << f[1] << " " << f[2]
                  << ", stick: " << last.stick << ", slip: " << last.slip
                  << ", largest pressure: " << largest << std::endl;
      }
    }
  }
  PetscFinalize();
}
