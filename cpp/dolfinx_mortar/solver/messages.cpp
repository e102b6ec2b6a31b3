// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "messages.h"
#include <algorithm>
#include <cmath>
#include <cstdio>

using namespace dolfinx_mortar;

namespace
{
/// A number with some significant digits.
std::string number(double value, const char* format = "%.3g")
{
  char text[64];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}
} // namespace

//-----------------------------------------------------------------------------
std::string messages::point(const std::array<double, 3>& x)
{
  double largest = 0;
  for (double v : x)
    largest = std::max(largest, std::abs(v));
  std::string text = "(";
  for (int c = 0; c < 3; ++c)
  {
    const double v = std::abs(x[c]) < 1e-12 * largest ? 0.0 : x[c];
    text += (c ? ", " : "") + number(v, "%.4g");
  }
  return text + ")";
}
//-----------------------------------------------------------------------------
std::string messages::deep_facet(const Depth& depth)
{
  return "The slave facet at " + point(depth.x) + " is " + number(depth.depth)
         + " deep inside a master body, further than master facets are "
           "searched for.";
}
//-----------------------------------------------------------------------------
std::string messages::passage(const Depth& depth)
{
  return "At " + point(depth.x) + " one contact surface is "
         + number(depth.depth)
         + " behind the other one, further than facets are searched for.";
}
//-----------------------------------------------------------------------------
std::string messages::inverted(const Bodies::Inverted& cells)
{
  const std::string which = cells.number == 1
                                ? "A cell is"
                                : std::to_string(cells.number) + " cells are";
  return which + " turned inside out, at X = " + point(cells.x) + ".";
}
//-----------------------------------------------------------------------------
std::string messages::blocked(const Located& node)
{
  return "The prescribed displacements hold the slave node at X = "
         + point(node.x) + " " + number(-node.value)
         + " inside the master, where contact cannot push it out: they "
           "contradict the contact. Change these Dirichlet conditions, or let "
           "the other surface be the slave; the state is as before the step.";
}
//-----------------------------------------------------------------------------
std::string messages::lost(const CoupledInterface& c, const Located& facet)
{
  return number(100 * facet.value, "%.0f")
         + "% of the slave facet near X = " + point(facet.x) + " ("
         + c.slave_name + ") faces masters at more than max_angle = "
         + number(c.data.options.max_angle, "%g")
         + " degrees, and takes no part in the interface. Tag only facets that "
           "face each other, or raise max_angle.";
}
//-----------------------------------------------------------------------------
std::string messages::barely_covered(const CoupledInterface& c,
                                     const Located& node)
{
  return "The slave node at X = " + point(node.x) + " (" + c.slave_name
         + ") carries a traction, but masters cover only "
         + number(100 * node.value, "%.1f")
         + "% of its surroundings, and small motions change it much: raise "
           "min_coverage (it is "
         + number(c.min_coverage, "%g")
         + "), refine the slave surface, or swap slave and master.";
}
//-----------------------------------------------------------------------------
std::string messages::start_overlap(double depth)
{
  return "The bodies overlap at the start, by " + number(depth, "%.2g")
         + " of a facet's size: begin with them apart, and bring them together "
           "in load steps.";
}
//-----------------------------------------------------------------------------
std::string messages::sliding()
{
  return "All nodes in contact slip, and nothing but friction holds a body "
         "along the surface: where loads exceed friction the body slides away, "
         "and there is no static solution. Lower these loads, raise the "
         "friction or prescribe a displacement of the body; close to the limit "
         "smaller load steps help. The state is as before the step.";
}
//-----------------------------------------------------------------------------
std::string messages::infinite_force(const std::array<double, 3>& x)
{
  return "The residual force is not finite near X = " + point(x);
}
//-----------------------------------------------------------------------------
std::string messages::infinite(const Infinite& what)
{
  switch (what.kind)
  {
  case Infinite::Kind::prescribed:
    return "A prescribed displacement is not a finite number.";
  case Infinite::Kind::traction:
    return "A contact traction is not a finite number.";
  default:
    return infinite_force(what.x)
           + ": a load is not a finite number, or a cell is inside out.";
  }
}
//-----------------------------------------------------------------------------
std::string messages::not_held()
{
  return "No slave node is in contact, and without contact a body is not held: "
         "bring the surfaces together (check tags and search_distance), "
         "prescribe displacements, or choose initial_active.";
}
//-----------------------------------------------------------------------------
std::string messages::not_converged(SNESConvergedReason reason,
                                    const History& history, bool has_contact)
{
  const Iterate& last = history.back();
  const double worst = std::max({last.force, last.constraint, last.prescribed});
  const char* which = worst == last.force ? "the residual force"
                      : worst == last.constraint
                          ? "the interface constraint"
                          : "the distance to prescribed displacements";
  std::string text = std::string("The solve did not converge (")
                     + SNESConvergedReasons[reason] + ") after "
                     + std::to_string(last.iteration)
                     + " Newton iterations. Largest is " + which + ", "
                     + number(worst, "%.2e") + " relative";
  if (has_contact)
  {
    text += "; nodes in contact (changed) in the last iterations: ";
    const std::size_t first = history.size() > 5 ? history.size() - 5 : 0;
    for (std::size_t i = first; i < history.size(); ++i)
    {
      text += (i > first ? ", " : "") + std::to_string(history[i].active)
              + " (±" + std::to_string(history[i].changes) + ")";
    }
  }
  text += ".";
  if (std::ranges::any_of(history, [](auto& i) { return i.cycle; }))
    text += " The active set cycled.";
  return text;
}
//-----------------------------------------------------------------------------
std::string messages::not_begun(SNESConvergedReason reason)
{
  return std::string("The solve did not converge (")
         + SNESConvergedReasons[reason] + ") at its start.";
}
//-----------------------------------------------------------------------------
std::string messages::stabilised(const Stabilisation& springs)
{
  const std::string shares
      = std::isinf(springs.force)
            ? "all of the loads at the end of the step"
            : number(100 * springs.force, "%.2g")
                  + " % of the forces at work at the end of the step, and "
                  + number(100 * springs.energy_share, "%.2g")
                  + " % of the work";
  return "The springs that stabilise carry " + shares
         + ": nothing else holds a body against its loads, or it slides away. "
           "Hold it by Dirichlet conditions, a tie or friction; the state is "
           "as before the step.";
}
//-----------------------------------------------------------------------------
std::string messages::with_springs(double stage)
{
  return " With the springs of stabilise the step converged until they were "
         "weakened to "
         + number(stage)
         + " times their stiffness: nothing else holds a body against its "
           "loads, or it slides away.";
}
//-----------------------------------------------------------------------------
std::string messages::stiffer_springs()
{
  return " This was with the stiffest springs of stabilise: what moves too far "
         "with them wants stiffer ones, ten times or a hundred times so.";
}
