// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Rigid tools among the bodies: frames, and the six unknowns of those that are
// carried by a load.

#include "bodies.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
std::array<double, 12> Bodies::frame(std::size_t tool) const
{
  std::array<double, 12> X;
  const std::int32_t start = _layout.local_start(_bodies.size() + tool);
  std::copy_n(_layout.X.begin() + 3 * start, 12, X.begin());
  return X;
}
//-----------------------------------------------------------------------------
std::vector<std::array<double, 12>>
Bodies::tool_values(std::span<const double> owned) const
{
  std::vector<std::array<double, 12>> values(_tools.size());
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    const std::size_t b = _bodies.size() + t;
    std::ranges::copy(
        owned.subspan(3 * _layout.owned_start(b), 3 * _layout.num_owned[b]),
        values[t].begin());
  }
  MPI_Bcast(values.data(), 12 * values.size(), MPI_DOUBLE, 0, _layout.comm);
  return values;
}
//-----------------------------------------------------------------------------
double Bodies::axis(std::size_t tool) const
{
  return FrameView(frame(tool)).axes.col(0).norm();
}
//-----------------------------------------------------------------------------
std::optional<std::int32_t> Bodies::loaded_dofs(std::size_t tool) const
{
  const std::size_t b = _bodies.size() + tool;
  if (!_tools[tool]->is_loaded() or _layout.num_owned[b] == 0)
    return std::nullopt;
  return 3 * _layout.owned_start(b);
}
//-----------------------------------------------------------------------------
std::array<double, 6> Bodies::motion_of(std::size_t tool) const
{
  const RigidTool& t = *_tools[tool];
  const std::array<double, 12> X = frame(tool);
  std::array<double, 12> x = X;
  for (int i = 0; i < 12; ++i)
    x[i] += _tool_displacements[tool][i];
  const FrameView before(X), now(x);
  const Vec3 d = now.origin + now.axes * before.coordinates(t.reference_point)
                 - t.reference_point;
  Vec3 rotation = rotation_vector(now.axes * before.inverse);
  // Of all vectors of this rotation that which is nearest to the last one
  const double length = axis(tool);
  const Vec3 last(_tool_motions[tool].data() + 3);
  const double angle = rotation.norm();
  if (angle > 0)
  {
    constexpr double turn = 2 * std::numbers::pi;
    const double along = last.dot(rotation) / (length * angle);
    rotation *= 1 + turn / angle * std::round((along - angle) / turn);
  }
  std::array<double, 6> q;
  Eigen::Map<Vec3>(q.data()) = d;
  Eigen::Map<Vec3>(q.data() + 3) = length * rotation;
  return q;
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::unknowns() const
{
  std::vector<double> q = displacements();
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    if (const auto first = loaded_dofs(t))
    {
      std::fill_n(q.begin() + *first, 12, 0.0);
      std::ranges::copy(_tool_motions[t], q.begin() + *first);
    }
  }
  return q;
}
//-----------------------------------------------------------------------------
void Bodies::set_unknowns(std::span<const double> owned)
{
  std::vector<double> u(owned.begin(), owned.end());
  std::vector<std::array<double, 12>> values = tool_values(owned);
  std::vector<std::array<double, 6>> motions(_tools.size());
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    if (!_tools[t]->is_loaded())
      continue;
    std::copy_n(values[t].begin(), 6, motions[t].begin());
    RigidTool moved = *_tools[t];
    moved.translation = Vec3(values[t].data());
    moved.rotation = Vec3(values[t].data() + 3) / axis(t);
    values[t] = moved.displacements(frame(t));
    if (const auto first = loaded_dofs(t))
      std::ranges::copy(values[t], u.begin() + *first);
  }
  set_displacements(u);
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    if (_tools[t]->is_loaded())
      _tool_motions[t] = motions[t]; // not by way of the rotation
  }
}
//-----------------------------------------------------------------------------
std::vector<std::int32_t> Bodies::tool_dofs() const
{
  std::vector<std::int32_t> dofs;
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    if (const auto first = loaded_dofs(t))
    {
      for (int i = 0; i < 12; ++i)
        dofs.push_back(*first + i);
    }
  }
  return dofs;
}
//-----------------------------------------------------------------------------
Eigen::Matrix<double, 12, 6> Bodies::frame_jacobian(std::size_t tool) const
{
  const double length = axis(tool);
  const Vec3 d(_tool_motions[tool].data());
  const Vec3 rotation = Vec3(_tool_motions[tool].data() + 3) / length;
  const Eigen::Matrix3d T = rotation_tangent(rotation) / length;
  const std::array<double, 12> X = frame(tool);
  Eigen::Matrix<double, 12, 6> C;
  for (int l = 0; l < 4; ++l)
  {
    const Vec3 a = Vec3(X.data() + 3 * l)
                   + Vec3(_tool_displacements[tool].data() + 3 * l)
                   - _tools[tool]->reference_point - d;
    C.middleRows<3>(3 * l).leftCols<3>().setIdentity();
    for (int c = 0; c < 3; ++c)
      C.middleRows<3>(3 * l).col(3 + c) = Vec3(T.col(c)).cross(a);
  }
  return C;
}
//-----------------------------------------------------------------------------
void Bodies::reduce_forces(std::vector<double>& forces) const
{
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    if (const auto first = loaded_dofs(t))
    {
      Eigen::Map<Eigen::Matrix<double, 12, 1>> f(forces.data() + *first);
      const Eigen::Matrix<double, 6, 1> q = frame_jacobian(t).transpose() * f;
      f.setZero();
      f.head<6>() = q;
    }
  }
}
//-----------------------------------------------------------------------------
Matrix Bodies::tool_jacobian() const
{
  if (std::ranges::none_of(_tools, [](auto& t) { return t->is_loaded(); }))
    return {};
  std::vector<Entry> entries;
  std::vector<std::int8_t> other(_layout.size(), 1);
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    const auto first = loaded_dofs(t);
    if (!first)
      continue;
    const Eigen::Matrix<double, 12, 6> C = frame_jacobian(t);
    for (int i = 0; i < 12; ++i)
    {
      other[*first + i] = 0;
      for (int j = 0; j < 12; ++j)
        entries.push_back({*first + i, *first + j, j < 6 ? C(i, j) : 0.0});
    }
  }
  for (std::int32_t i = 0; i < _layout.size(); ++i)
  {
    if (other[i])
      entries.push_back({i, i, 1.0});
  }
  return create_from_entries(_layout.comm, _layout.size(), _layout.size(),
                             entries);
}
//-----------------------------------------------------------------------------
Matrix Bodies::tool_stiffness(std::span<const double> forces) const
{
  std::vector<Entry> entries;
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    const auto first = loaded_dofs(t);
    if (!first)
      continue;
    const double length = axis(t);
    const Vec3 rotation = Vec3(_tool_motions[t].data() + 3) / length;
    const Eigen::Matrix3d T = rotation_tangent(rotation);
    const Vec3 point
        = _tools[t]->reference_point + Vec3(_tool_motions[t].data());
    const std::array<double, 12> X = frame(t);
    // Moment of the forces, and its derivative by a spin
    Vec3 moment = -_tools[t]->moment;
    Eigen::Matrix3d by_spin = Eigen::Matrix3d::Zero();
    for (int l = 0; l < 4; ++l)
    {
      const Vec3 a = Vec3(X.data() + 3 * l)
                     + Vec3(_tool_displacements[t].data() + 3 * l) - point;
      const Vec3 f(forces.data() + *first + 3 * l);
      moment += a.cross(f);
      by_spin += cross_matrix(f) * cross_matrix(a);
    }
    const Eigen::Matrix3d G = (T.transpose() * by_spin * T
                               + rotation_tangent_derivative(rotation, moment))
                              / (length * length);
    for (int i = 0; i < 3; ++i)
    {
      for (int j = 0; j < 3; ++j)
        entries.push_back({*first + 3 + i, *first + 3 + j, G(i, j)});
    }
  }
  return create_from_entries(_layout.comm, _layout.size(), _layout.size(),
                             entries);
}
//-----------------------------------------------------------------------------
std::array<double, 6> Bodies::tool_motion(std::size_t tool) const
{
  std::array<double, 6> q = _tool_motions.at(tool);
  const double length = axis(tool);
  for (int c = 3; c < 6; ++c)
    q[c] /= length;
  return q;
}
//-----------------------------------------------------------------------------
void Bodies::subtract_loads(std::vector<double>& f) const
{
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    const auto first = loaded_dofs(t);
    if (!first)
      continue;
    // The force at the reference point, the moment by couples on the axes
    const RigidTool& tool = *_tools[t];
    std::array<double, 12> x = frame(t);
    const Eigen::Vector4d N
        = frame_functions(FrameView(x).coordinates(tool.reference_point));
    for (int i = 0; i < 12; ++i)
      x[i] += _tool_displacements[t][i];
    const Eigen::Matrix3d axes = FrameView(x).axes;
    for (int l = 0; l < 4; ++l)
    {
      Vec3 load = N[l] * tool.force;
      for (int i = 0; i < 3; ++i)
      {
        const Vec3 couple = tool.moment.cross(Vec3(axes.col(i)))
                            / (2 * axes.col(i).squaredNorm());
        if (l == 0)
          load -= couple;
        else if (l == i + 1)
          load += couple;
      }
      for (int c = 0; c < 3; ++c)
        f[*first + 3 * l + c] = -load[c];
    }
  }
}
