// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "numbers.h"
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <dolfinx_mortar/contact/laws.h>

using namespace dolfinx_mortar;
using Eigen::Vector3d;

namespace
{
/// Nodal values of one or more nodes.
struct Nodes
{
  std::vector<double> z, normal, gap, weighted_slip, scale, c_n, c_t;
  std::vector<std::int8_t> has_multiplier, fixed, near;
  std::vector<std::int64_t> blocks;

  void add(const Vector3d& z_, const Vector3d& n, double g,
           const Vector3d& w = Vector3d::Zero(), std::int64_t block = -1)
  {
    for (int c = 0; c < 3; ++c)
    {
      z.push_back(z_[c]);
      normal.push_back(n[c]);
      weighted_slip.push_back(w[c]);
      fixed.push_back(0);
    }
    gap.push_back(g);
    scale.push_back(2.5);
    c_n.push_back(10);
    c_t.push_back(4);
    has_multiplier.push_back(1);
    if (block >= 0)
      blocks.push_back(block);
  }

  ContactResidual evaluate(const Friction& friction = {},
                           std::span<const Status> forced = {}) const
  {
    return contact_residual({z, normal, gap, weighted_slip, scale, c_n, c_t,
                             has_multiplier, fixed, near, blocks},
                            friction, forced);
  }
};

Vector3d value(const ContactResidual& r, int node = 0)
{
  return Vector3d(r.value.data() + 3 * node);
}

/// Largest difference between the derivatives of all residuals by all values
/// and central differences.
double derivative_error(const Nodes& nodes, const Friction& friction)
{
  const double h = 1e-6;
  const ContactResidual r = nodes.evaluate(friction);
  const int num = nodes.gap.size();
  double error = 0;
  auto compare
      = [&](std::vector<double> Nodes::* values, int size,
            const std::vector<double>& own, const std::vector<double>& coupled)
  {
    for (int k = 0; k < num; ++k)
    {
      for (int d = 0; d < size; ++d)
      {
        Nodes plus = nodes, minus = nodes;
        (plus.*values)[size * k + d] += h;
        (minus.*values)[size * k + d] -= h;
        const auto rp = plus.evaluate(friction), rm = minus.evaluate(friction);
        for (int j = 0; j < num; ++j)
        {
          const Vector3d difference = (value(rp, j) - value(rm, j)) / (2 * h);
          for (int c = 0; c < 3; ++c)
          {
            double d_value = j == k ? own[(3 * j + c) * size + d] : 0;
            for (std::size_t i = 0; i < r.couplings.rows.size(); ++i)
            {
              if (r.couplings.rows[i] == j and r.couplings.columns[i] == k)
                d_value += coupled[(3 * i + c) * size + d];
            }
            error = std::max(error, std::abs(d_value - difference[c]));
          }
        }
      }
    }
  };
  compare(&Nodes::z, 3, r.dz, r.couplings.dz);
  compare(&Nodes::normal, 3, r.dn, r.couplings.dn);
  compare(&Nodes::weighted_slip, 3, r.dw, r.couplings.dw);
  compare(&Nodes::gap, 1, r.dg, r.couplings.dg);
  return error;
}

const Vector3d normal = Vector3d(0.36, 0.48, 0.8);
const Vector3d tangent = Vector3d(0.8, -0.6, 0);
const Vector3d across = normal.cross(tangent);
} // namespace

TEST_CASE("an open node has no traction")
{
  Nodes nodes;
  const Vector3d z = 0.2 * normal + 0.1 * tangent;
  nodes.add(z, normal, 0.05);
  for (const Friction& friction :
       {Friction{}, Friction{0.3, {}}, Friction{0, 1.0}})
  {
    const ContactResidual r = nodes.evaluate(friction);
    CHECK(r.status[0] == Status::open);
    CHECK(r.bound[0] == 0);
    CHECK((value(r) - z).norm() < 1e-15);
    CHECK(derivative_error(nodes, friction) < 1e-8);
  }
}

TEST_CASE("a closed node without friction has no gap, and no shear")
{
  Nodes nodes;
  nodes.add(2 * normal + 0.1 * tangent, normal, 0.05);
  const ContactResidual r = nodes.evaluate();
  CHECK(r.status[0] == Status::slip);
  CHECK((value(r) - (10 * 0.05 * normal + 0.1 * tangent)).norm() < 1e-14);
  CHECK(derivative_error(nodes, {}) < 1e-8);
}

TEST_CASE("a node closes where pressure less gap is positive")
{
  // z_n = 1: it opens at a gap of 0.1
  for (double gap : {0.0999, 0.1001})
  {
    Nodes nodes;
    nodes.add(normal, normal, gap);
    CHECK((nodes.evaluate().status[0] == Status::open) == (gap > 0.1));
  }
  // Pulled, but overlapping by more
  Nodes nodes;
  nodes.add(-0.5 * normal, normal, -0.1);
  CHECK(nodes.evaluate().status[0] == Status::slip);
  // Not where no master is near, nor where it carries nothing
  nodes.near = {0};
  CHECK(nodes.evaluate().status[0] == Status::open);
  nodes.near = {1};
  nodes.has_multiplier = {0};
  CHECK(nodes.evaluate().status[0] == Status::open);
}

TEST_CASE("Coulomb's and Tresca's law: stick")
{
  // p = 3 - 10 * 0.05 = 2.5, b = 1; t = 0.5 - 4 * 0.1 along, 0.3 across
  const Friction friction
      = GENERATE(Friction{0.4, {}}, Friction{0, 1.0}, Friction{7, 1.0});
  Nodes nodes;
  nodes.add(3 * normal + 0.5 * tangent + 0.3 * across, normal, 0.05,
            0.1 * tangent + 0.2 * normal);
  const ContactResidual r = nodes.evaluate(friction);
  CHECK(r.status[0] == Status::stick);
  CHECK(unit::close(r.bound[0], 1, 1e-14));
  // (b z - b t) / σ = -b c_t u / σ with u = -w
  const Vector3d exact = 0.5 * normal + 4 * 0.1 / 2.5 * tangent;
  CHECK((value(r) - exact).norm() < 1e-14);
  CHECK(derivative_error(nodes, friction) < 1e-7);
}

TEST_CASE("Coulomb's and Tresca's law: slip")
{
  // b = 1; t = 0.5 + 4 * 0.5 along, 0.3 across
  const Friction friction = GENERATE(Friction{0.4, {}}, Friction{0, 1.0});
  Nodes nodes;
  nodes.add(3 * normal + 0.5 * tangent + 0.3 * across, normal, 0.05,
            -0.5 * tangent);
  const ContactResidual r = nodes.evaluate(friction);
  CHECK(r.status[0] == Status::slip);
  const Vector3d z = 0.5 * tangent + 0.3 * across,
                 t = 2.5 * tangent + 0.3 * across;
  CHECK(unit::close(r.bound[0], t.norm(), 1e-14));
  CHECK((value(r) - (0.5 * normal + (t.norm() * z - t) / 2.5)).norm() < 1e-14);
  CHECK(derivative_error(nodes, friction) < 1e-7);
}

TEST_CASE("what the law is solved by")
{
  // Traction at the bound against the slip, no gap
  const Friction friction{0.4, {}};
  Nodes nodes;
  nodes.add(3 * normal + 1.2 * tangent, normal, 0, -0.7 * tangent);
  CHECK(nodes.evaluate(friction).status[0] == Status::slip);
  CHECK(value(nodes.evaluate(friction)).norm() < 1e-14);
  // Traction below the bound, no slip
  nodes = {};
  nodes.add(3 * normal + 1.1 * across, normal, 0);
  CHECK(nodes.evaluate(friction).status[0] == Status::stick);
  CHECK(value(nodes.evaluate(friction)).norm() < 1e-14);
  // Not with the slip, not beyond the bound
  nodes = {};
  nodes.add(3 * normal + 1.2 * tangent, normal, 0, 0.7 * tangent);
  CHECK(value(nodes.evaluate(friction)).norm() > 0.1);
  nodes = {};
  nodes.add(3 * normal + 1.3 * tangent, normal, 0);
  CHECK(value(nodes.evaluate(friction)).norm() > 0.01);
}

TEST_CASE("prescribed components have no traction")
{
  Nodes nodes;
  nodes.add(3 * normal + 0.5 * tangent, normal, 0.05, -0.5 * tangent);
  nodes.fixed = {0, 1, 0};
  for (const Friction& friction : {Friction{}, Friction{0.4, {}}})
  {
    CHECK(value(nodes.evaluate(friction))[1] == nodes.z[1]);
    CHECK(derivative_error(nodes, friction) < 1e-7);
  }
}

TEST_CASE("states that are forced")
{
  Nodes nodes;
  nodes.add(3 * normal + 0.5 * tangent, normal, 0.05, -0.5 * tangent);
  const Friction friction{0.4, {}};
  for (Status status : {Status::open, Status::stick, Status::slip})
  {
    const std::vector<Status> forced = {status};
    CHECK(nodes.evaluate(friction, forced).status[0] == status);
  }
}

TEST_CASE("a node on an edge sticks or slides along it")
{
  // Two patches with different pressures; what is across the edge does not
  // matter to the state
  const Vector3d other = (normal + 2 * across).normalized();
  const double slide = GENERATE(-0.01, 0.9, -0.9);
  const Friction friction = GENERATE(Friction{0.4, {}}, Friction{0, 1.0});
  Nodes nodes;
  nodes.add(3 * normal + 0.5 * tangent + 0.1 * across, normal, 0.05,
            slide * tangent, 5);
  nodes.add(2 * other + 0.2 * tangent, other, -0.02, 0.8 * slide * tangent, 5);
  // A neighbour of its own
  nodes.add(normal, normal, 0.0, Vector3d::Zero(), 6);
  const ContactResidual r = nodes.evaluate(friction);
  const Status expected = std::abs(slide) < 0.1 ? Status::stick : Status::slip;
  CHECK(r.status[0] == expected);
  CHECK(r.status[1] == expected);
  CHECK(r.couplings.rows.size() == 2);
  // Both gaps are closed, each by its own normal
  CHECK(unit::close(value(r, 0).dot(normal), 10 * 0.05, 1e-14));
  CHECK(unit::close(value(r, 1).dot(other), 10 * -0.02, 1e-14));
  CHECK(derivative_error(nodes, friction) < 1e-7);
}

TEST_CASE("an edge that slides has the friction of both patches")
{
  const Vector3d other = (normal + 2 * across).normalized();
  const Friction friction{0.4, {}};
  // Bounds 1.2 and 0.8 against the slip along the edge
  Nodes nodes;
  nodes.add(3 * normal + 1.2 * tangent, normal, 0, -0.5 * tangent, 5);
  nodes.add(2 * other + 0.8 * tangent, other, 0, -0.4 * tangent, 5);
  ContactResidual r = nodes.evaluate(friction);
  CHECK(r.status[0] == Status::slip);
  CHECK(value(r, 0).norm() < 1e-14);
  CHECK(value(r, 1).norm() < 1e-14);
  // Stick: tractions in proportion to the bounds
  nodes = {};
  nodes.add(3 * normal + 0.6 * tangent, normal, 0, Vector3d::Zero(), 5);
  nodes.add(2 * other + 0.4 * tangent, other, 0, Vector3d::Zero(), 5);
  r = nodes.evaluate(friction);
  CHECK(r.status[0] == Status::stick);
  CHECK(value(r, 0).norm() < 1e-14);
  CHECK(value(r, 1).norm() < 1e-14);
}

TEST_CASE("patches with nearly the same normal are one in contact")
{
  const Vector3d other = (normal + 0.1 * across).normalized();
  Nodes nodes;
  nodes.add(2 * normal, normal, 0, Vector3d::Zero(), 5);
  nodes.add(3 * other, other, 0, Vector3d::Zero(), 5);
  const ContactResidual r = nodes.evaluate();
  // The one that is pressed most
  CHECK(r.status[0] == Status::open);
  CHECK(r.status[1] == Status::slip);
}

TEST_CASE("a corner of three patches cannot slide")
{
  Nodes nodes;
  for (const Vector3d& n : {normal, tangent, across})
    nodes.add(2 * n + 0.1 * across, n, 0.01, 0.5 * tangent, 5);
  const ContactResidual r = nodes.evaluate({0.4, {}});
  for (int j = 0; j < 3; ++j)
    CHECK(r.status[j] == Status::stick);
  CHECK(r.couplings.rows.empty());
  CHECK(derivative_error(nodes, {0.4, {}}) < 1e-7);
}
