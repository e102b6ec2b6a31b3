// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <dolfinx/fem/DirichletBC.h>
#include <dolfinx/fem/Form.h>
#include <dolfinx/fem/Function.h>
#include <dolfinx/mesh/MeshTags.h>
#include <dolfinx_mortar/assembly/layout.h>
#include <dolfinx_mortar/assembly/petsc.h>
#include <dolfinx_mortar/geometry/rigid_tool.h>
#include <dolfinx_mortar/surface/surface.h>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief A body (or several, in one mesh): forms and displacement.
struct Body
{
  /// Residual, linear in its test function, and its derivative by `u`
  std::shared_ptr<const dolfinx::fem::Form<double>> F, J;

  /// Displacement; holds the start of an iteration, and the solution
  std::shared_ptr<dolfinx::fem::Function<double>> u;
};

using DirichletBC = dolfinx::fem::DirichletBC<double>;
using FunctionSpace = dolfinx::fem::FunctionSpace<double>;

/// @brief Tagged facets of one body, as a part of a surface.
struct TaggedFacets
{
  std::shared_ptr<const FunctionSpace> V;
  std::shared_ptr<const dolfinx::mesh::MeshTags<std::int32_t>> tags;
  std::int32_t tag;
};

/// @brief Number, extent and connected parts of the displacement dofs of
/// several spaces, and of the frames of rigid tools, which come after them as
/// bodies of four blocks that rank 0 owns. Collective.
/// @param[in] comm Communicator of matrices and vectors; of the ranks of the
/// meshes, in their order.
/// @param[in] spaces Displacement spaces.
/// @param[in] tools Rigid tools.
Layout
create_layout(MPI_Comm comm,
              std::span<const std::shared_ptr<const FunctionSpace>> spaces,
              std::span<const std::shared_ptr<const RigidTool>> tools = {});

/// @brief Index of the space that a Dirichlet condition is on.
/// @throw std::invalid_argument It is on none of the spaces.
std::size_t
space_of(std::span<const std::shared_ptr<const FunctionSpace>> spaces,
         const DirichletBC& bc);

/// @brief Non-zero for local unknowns with a Dirichlet condition, shape
/// (num_local_blocks, 3). So are tools, where they are not free.
std::vector<std::int8_t>
prescribed_dofs(const Layout& layout,
                std::span<const std::shared_ptr<const FunctionSpace>> spaces,
                std::span<const std::shared_ptr<const DirichletBC>> bcs,
                std::span<const std::shared_ptr<const RigidTool>> tools = {});

/// @brief The surface that tagged facets of one or more bodies make up.
/// Collective.
/// @param[in] layout,spaces Displacement dofs, and the spaces they are of.
/// @param[in] parts Parts of the surface.
/// @param[in] side "slave" or "master", for messages.
/// @throw std::invalid_argument, std::runtime_error On all ranks, where a part
/// is on none of the spaces or cannot be a surface.
Surface
create_surface(const Layout& layout,
               std::span<const std::shared_ptr<const FunctionSpace>> spaces,
               std::span<const TaggedFacets> parts, const std::string& side);

/// @brief The surface that tagged facets of a rigid tool make up; its nodes are
/// numbered among themselves, and on the frame of the tool. Collective.
/// @param[in] parts Facets, on spaces of the tool's own.
/// @param[in] frame The first block of the frame among the local blocks of all
/// bodies.
Surface create_tool_surface(std::span<const TaggedFacets> parts,
                            std::int32_t frame);

/// @brief Zeros where the tangent of a body has blocks of 3 x 3: a row for each
/// block. Collective.
Matrix create_block_graph(MPI_Comm comm, const Body& body);

/// @brief Displacements by those of the corners of cells: of a node on an edge,
/// a facet or inside of a cell their mean. Collective.
/// @param[in] layout,spaces Displacement dofs, and the spaces they are of;
/// blocks of tools are corners.
/// @return Rows are displacement dofs, columns those of the corners, which each
/// rank has in the order of its blocks; null where all nodes are corners.
Matrix create_corner_interpolation(
    const Layout& layout,
    std::span<const std::shared_ptr<const FunctionSpace>> spaces);

/// @brief Forms, displacements and Dirichlet conditions of the bodies of a
/// problem, and the rigid tools, without what happens between them.
class Bodies
{
public:
  /// @brief Collective.
  /// @param[in] comm Communicator, see create_layout.
  /// @param[in] bodies One for each displacement space.
  /// @param[in] bcs Dirichlet conditions of all bodies.
  /// @param[in] tools Rigid tools, which stand where their motion puts them
  /// now; what they are told later is prescribed like a Dirichlet condition.
  /// @throw std::invalid_argument A condition is on none of the spaces.
  Bodies(MPI_Comm comm, std::vector<Body> bodies,
         std::vector<std::shared_ptr<const DirichletBC>> bcs,
         std::vector<std::shared_ptr<const RigidTool>> tools = {});

  const Layout& layout() const { return _layout; }

  const std::vector<Body>& bodies() const { return _bodies; }

  const std::vector<std::shared_ptr<const RigidTool>>& tools() const
  {
    return _tools;
  }

  /// @brief Displacement space of each body.
  std::vector<std::shared_ptr<const FunctionSpace>> spaces() const;

  /// @brief Displacements of the owned dofs.
  std::vector<double> displacements() const;

  /// @brief The unknowns in place of the displacements: the same, but for tools
  /// that are carried by a load. The twelve dofs of such a frame are six
  /// unknowns, translation and rotation vector times the length of an axis, and
  /// six zeros.
  std::vector<double> unknowns() const;

  /// @brief Set displacements by the unknowns. Collective.
  void set_unknowns(std::span<const double> owned);

  /// @brief Displacement dofs of this rank where unknowns are not the
  /// displacements: twelve for each loaded tool on rank 0.
  std::vector<std::int32_t> tool_dofs() const;

  /// @brief Forces that do the same work on changes of the unknowns, Cᵀ f with
  /// C of tool_jacobian.
  /// @param[in,out] forces Of the owned displacement dofs.
  void reduce_forces(std::vector<double>& forces) const;

  /// @brief Derivative C of displacements by unknowns; null where these are the
  /// same. Collective.
  Matrix tool_jacobian() const;

  /// @brief Derivative of Cᵀ f by the unknowns, f fixed, at tools whose loads
  /// do not turn with them. Collective.
  /// @param[in] forces f of the owned displacement dofs, without the loads.
  Matrix tool_stiffness(std::span<const double> forces) const;

  /// @brief Translation and rotation vector of a tool at present; the vector is
  /// that which is nearest to the last one, of all that are of one rotation.
  std::array<double, 6> tool_motion(std::size_t tool) const;

  /// @brief Displacements of the local blocks of all bodies.
  std::vector<double> local_displacements() const;

  /// @brief Values of local blocks, from those of the owned ones. Collective.
  /// @param[in] owned Shape (num_blocks, 3).
  std::vector<double> extend(std::span<const double> owned) const;

  /// @brief Set the displacements, ghosts included. Collective.
  void set_displacements(std::span<const double> owned);

  /// @brief Residual forces of the owned dofs at the present displacement,
  /// loads of tools included. Collective.
  std::vector<double> residual() const;

  /// @brief Tangent at the present displacement. Collective.
  ///
  /// A body is assembled if its tangent depends on displacements that have
  /// changed since the last call, or after forget_tangents. The matrix is the
  /// same one in each call: whoever changes its values calls forget_tangents.
  Matrix tangent() const;

  /// @brief The next tangent is assembled anew: constants and functions of the
  /// forms may have changed.
  void forget_tangents() const;

  /// @brief Non-zero for local displacements with a Dirichlet condition, shape
  /// (num_local_blocks, 3).
  std::vector<std::int8_t> prescribed() const;

  /// @brief Exchange the Dirichlet conditions.
  /// @throw std::invalid_argument A condition is on none of the spaces.
  void set_conditions(std::vector<std::shared_ptr<const DirichletBC>> bcs);

  /// @brief Values of the Dirichlet conditions at the owned unknowns, else
  /// zero.
  std::vector<double> prescribed_values() const;

  /// Cells that are turned inside out, on all ranks, and the middle of the
  /// first of them
  struct Inverted
  {
    std::int64_t number;
    std::array<double, 3> x;
  };

  /// @brief Find cells that are inside out in the middle of them or of a
  /// facet. Collective.
  Inverted find_inverted() const;

  /// @brief Whether a mesh has been moved since the problem was made.
  /// Collective.
  bool meshes_moved() const;

private:
  std::vector<std::size_t> checksums() const;

  /// Add the tangent of a body to the matrix, without the exchange that ends
  /// the assembly.
  /// @param[in] u Local displacements of all bodies.
  void assemble(std::size_t body, const std::vector<double>& u) const;

  /// Whether a function has the values of a displacement.
  bool is_displacement(const dolfinx::fem::Function<double>& f) const;

  /// Values of the frames of tools, of those of the owned blocks. Collective.
  std::vector<std::array<double, 12>>
  tool_values(std::span<const double> owned) const;

  /// Six unknowns by the displacements of a frame.
  std::array<double, 6> motion_of(std::size_t tool) const;

  /// Derivative of the displacements of a frame by its six unknowns.
  Eigen::Matrix<double, 12, 6> frame_jacobian(std::size_t tool) const;

  /// First of the owned dofs of a loaded tool; none on other ranks.
  std::optional<std::int32_t> loaded_dofs(std::size_t tool) const;

  /// Subtract the loads of tools from residual forces.
  void subtract_loads(std::vector<double>& forces) const;

  /// Length of the axes of the frame of a tool.
  double axis(std::size_t tool) const;

  /// Reference positions of the frame of a tool.
  std::array<double, 12> frame(std::size_t tool) const;

  std::vector<Body> _bodies;
  std::vector<std::shared_ptr<const RigidTool>> _tools;
  std::vector<std::array<double, 12>> _tool_displacements;
  std::vector<std::array<double, 6>> _tool_motions;
  std::vector<std::shared_ptr<const DirichletBC>> _bcs;
  Layout _layout;

  /// What the rows of a body hold in the tangent
  struct Assembled
  {
    bool constant; // no function of a displacement of the problem
    bool present;
    std::vector<double> u; // local displacements where it is assembled
  };
  Matrix _tangent;
  mutable std::vector<Assembled> _assembled;
  std::vector<std::size_t> _checksums;
};
} // namespace dolfinx_mortar
