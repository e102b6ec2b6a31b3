// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "solver_options.h"
#include <algorithm>
#include <array>
#include <dolfinx_mortar/assembly/petsc.h>
#include <petscsys.h>
#include <sstream>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
using Options = std::map<std::string, std::string>;

// Defaults of Newton's iteration and of three kinds of linear solvers
const Options newton = {{"snes_rtol", "1e-9"},
                        {"snes_max_it", "50"},
                        {"snes_linesearch_type", "basic"}};
const Options direct = {{"ksp_type", "preonly"}, {"pc_type", "lu"}};
const Options factorisation
    = {{"pc_factor_mat_solver_type", "mumps"}, {"mat_mumps_icntl_14", "60"}};
const Options krylov = {
    {"ksp_type", "gmres"}, {"ksp_rtol", "1e-8"}, {"ksp_gmres_restart", "200"}};
// Linear systems are solved no more exactly than the step deserves, and more so
// towards the end (Eisenstat and Walker's second choice)
const Options inexact = {{"snes_ksp_ew", "true"},
                         {"snes_ksp_ew_rtol0", "1e-3"},
                         {"snes_ksp_ew_rtolmax", "1e-3"}};
const Options multigrid = {{"mg_levels_pc_type", "sor"},
                           {"mg_levels_ksp_max_it", "1"},
                           {"pc_gamg_threshold", "0.02"}};
// The level of all nodes above that of the corners knows its matrix by products
const Options corners
    = {{"mg_nodes_ksp_type", "chebyshev"}, {"mg_nodes_ksp_max_it", "2"}};

// Options that a name which PETSc does not know may have been meant for
const std::vector<std::string> common = {"snes_rtol",
                                         "snes_atol",
                                         "snes_stol",
                                         "snes_max_it",
                                         "snes_max_funcs",
                                         "snes_type",
                                         "snes_monitor",
                                         "snes_converged_reason",
                                         "snes_view",
                                         "snes_linesearch_type",
                                         "snes_linesearch_max_it",
                                         "snes_linesearch_monitor",
                                         "snes_linesearch_damping",
                                         "snes_lag_jacobian",
                                         "snes_lag_preconditioner",
                                         "snes_error_if_not_converged",
                                         "ksp_type",
                                         "ksp_rtol",
                                         "ksp_atol",
                                         "ksp_divtol",
                                         "ksp_max_it",
                                         "ksp_monitor",
                                         "ksp_view",
                                         "ksp_converged_reason",
                                         "ksp_norm_type",
                                         "ksp_pc_side",
                                         "ksp_gmres_restart",
                                         "ksp_error_if_not_converged",
                                         "pc_type",
                                         "pc_factor_mat_solver_type",
                                         "pc_factor_levels",
                                         "pc_gamg_type",
                                         "pc_gamg_threshold",
                                         "pc_gamg_threshold_scale",
                                         "pc_gamg_agg_nsmooths",
                                         "pc_gamg_coarse_eq_limit",
                                         "pc_hypre_type",
                                         "pc_mortar_reuse",
                                         "pc_mortar_corners",
                                         "pc_mg_levels",
                                         "mg_nodes_ksp_type",
                                         "mg_nodes_ksp_max_it",
                                         "mg_levels_pc_type",
                                         "mg_levels_ksp_type",
                                         "mg_levels_ksp_max_it",
                                         "mg_coarse_pc_type",
                                         "mg_coarse_ksp_type"};

// The others need an energy, or a function of the user
const std::vector<std::string> line_searches = {"basic", "bt", "l2", "nleqerr"};

// Multigrid that second-order elements have a level of corners with
const std::vector<std::string> on_corners = {"gamg", "hypre", "ml"};

// They replace the matrix that contact is linearised in
const std::vector<std::string> no_matrix
    = {"snes_mf", "snes_mf_operator", "snes_fd", "snes_fd_color"};

bool in_database(const std::string& name)
{
  PetscBool found;
  check(PetscOptionsHasName(nullptr, nullptr, ("-" + name).c_str(), &found),
        "PetscOptionsHasName");
  return found;
}

std::string in_database_value(const std::string& name)
{
  std::array<char, 4096> text = {};
  PetscBool found;
  check(PetscOptionsGetString(nullptr, nullptr, ("-" + name).c_str(),
                              text.data(), text.size(), &found),
        "PetscOptionsGetString");
  return text.data();
}

/// Twice the length of the longest common subsequence, relative to the sum of
/// both lengths.
double similarity(const std::string& a, const std::string& b)
{
  std::vector<std::size_t> row(b.size() + 1, 0);
  for (char c : a)
  {
    std::size_t diagonal = 0;
    for (std::size_t j = 0; j < b.size(); ++j)
    {
      const std::size_t above = row[j + 1];
      row[j + 1] = c == b[j] ? diagonal + 1 : std::max(above, row[j]);
      diagonal = above;
    }
  }
  return 2.0 * row.back() / (a.size() + b.size());
}

/// The common option that a name was probably meant to be, empty if it is one
/// or is far off.
std::string meant(std::string name)
{
  std::ranges::transform(name, name.begin(),
                         [](unsigned char c) { return std::tolower(c); });
  for (const std::string& known : common)
  {
    if (name == known or name.ends_with("_" + known))
      return "";
  }
  name.erase(0, name.find_first_not_of('-'));
  const auto nearest
      = std::ranges::max_element(common, {}, [&](const std::string& known)
                                 { return similarity(name, known); });
  return similarity(name, *nearest) >= 0.85 ? *nearest : "";
}
} // namespace

//-----------------------------------------------------------------------------
bool dolfinx_mortar::has_corner_level(const std::string& pc_type)
{
  return std::ranges::find(on_corners, pc_type) != on_corners.end();
}
//-----------------------------------------------------------------------------
SolverOptions::SolverOptions(std::string prefix, Options given,
                             bool saddle_point,
                             const std::function<bool()>& is_large)
    : _prefix(std::move(prefix)), _given(std::move(given))
{
  auto pc = chosen("pc_type");
  const auto ksp = chosen("ksp_type");
  Options defaults = newton;
  if (!pc and !ksp and !saddle_point and is_large and is_large())
  {
    _multigrid_by_size = true;
    pc = defaults["pc_type"] = "gamg";
    // Where it does not fit, the message that says so should not take hours
    defaults["ksp_max_it"] = "1000";
  }
  const bool by_default = (!pc or *pc == "lu") and (!ksp or *ksp == "preonly");
  if (by_default)
    defaults.insert(direct.begin(), direct.end());
  else if (!ksp or *ksp != "preonly")
  {
    // A Cholesky factorisation, too, is one of the reduced system only
    defaults.insert(krylov.begin(), krylov.end());
    if (!chosen("ksp_rtol"))
      defaults.insert(inexact.begin(), inexact.end());
  }
  if (by_default or (pc and (*pc == "lu" or *pc == "cholesky")))
  {
    defaults.insert(factorisation.begin(), factorisation.end());
    if (saddle_point)
      defaults["mat_mumps_icntl_14"] = "300";
  }
  else if (pc and *pc == "gamg")
    defaults.insert(multigrid.begin(), multigrid.end());
  if (pc and has_corner_level(*pc))
    defaults.insert(corners.begin(), corners.end());
  for (const auto& [name, value] : defaults)
  {
    if (!_given.contains(name))
      _defaults.insert(name);
    if (!in_database(_prefix + name))
      _values[_prefix + name] = value;
  }
  for (const auto& [name, value] : _given)
    _values[_prefix + name] = value;
  _line_search = chosen("snes_linesearch_type")
                     .value_or(newton.at("snes_linesearch_type"));
  check_values();
}
//-----------------------------------------------------------------------------
std::optional<std::string> SolverOptions::chosen(const std::string& name) const
{
  std::string value;
  if (auto it = _given.find(name); it != _given.end())
    value = it->second;
  if (value.empty())
    value = in_database_value(_prefix + name);
  return value.empty() ? std::nullopt : std::optional(value);
}
//-----------------------------------------------------------------------------
void SolverOptions::check_values() const
{
  if (std::ranges::find(line_searches, _line_search) == line_searches.end())
  {
    throw std::invalid_argument("snes_linesearch_type is '" + _line_search
                                + "', but must be one of 'basic', 'bt', 'l2', "
                                  "'nleqerr'.");
  }
  for (const std::string& name : no_matrix)
  {
    if (_given.contains(name) or in_database(_prefix + name))
    {
      throw std::invalid_argument(
          "The option " + name
          + " does without the Jacobian, which holds the conditions of the "
            "interfaces: leave it out.");
    }
  }
  if (chosen("snes_lag_jacobian").value_or("1").starts_with("-")
      or chosen("snes_lag_jacobian_persists"))
  {
    throw std::invalid_argument(
        "The Jacobian belongs to one solve: snes_lag_jacobian must be "
        "positive, and snes_lag_jacobian_persists is not available.");
  }
}
//-----------------------------------------------------------------------------
Options SolverOptions::effective() const
{
  Options all = _values;
  char* text = nullptr;
  check(PetscOptionsGetAll(nullptr, &text), "PetscOptionsGetAll");
  std::istringstream words(text);
  PetscFree(text);
  std::string name;
  for (std::string word; words >> word;)
  {
    if (word.starts_with("-") and word.size() > 1
        and !std::isdigit(static_cast<unsigned char>(word[1])))
    {
      name = word.substr(1);
      if (name.starts_with(_prefix) and !_values.contains(name))
        all[name] = "";
    }
    else if (name.starts_with(_prefix) and !_values.contains(name))
      all[name] = word;
  }
  return all;
}
//-----------------------------------------------------------------------------
void SolverOptions::note_unread()
{
  PetscInt num = 0;
  char **names = nullptr, **values = nullptr;
  check(PetscOptionsLeftGet(nullptr, &num, &names, &values),
        "PetscOptionsLeftGet");
  std::set<std::string> now;
  for (PetscInt i = 0; i < num; ++i)
  {
    const std::string name = names[i];
    if (name.starts_with(_prefix))
      now.insert(name.substr(_prefix.size()));
  }
  PetscOptionsLeftRestore(nullptr, &num, &names, &values);
  if (_unread)
  {
    std::erase_if(*_unread, [&](auto& name) { return !now.contains(name); });
  }
  else
    _unread = now;
}
//-----------------------------------------------------------------------------
std::vector<std::string> SolverOptions::unread() const
{
  std::vector<std::string> names;
  for (const std::string& name : _unread.value_or(std::set<std::string>()))
  {
    if (!_defaults.contains(name))
      names.push_back(name);
  }
  return names;
}
//-----------------------------------------------------------------------------
void SolverOptions::check_names() const
{
  for (const std::string& name : unread())
  {
    const std::string near = meant(name);
    if (_given.contains(name) and !near.empty())
    {
      throw std::invalid_argument("PETSc has no use for the option '" + name
                                  + "': is '" + near + "' meant?");
    }
  }
}
//-----------------------------------------------------------------------------
SolverOptions::Loan::Loan(SolverOptions& options) : _options(options)
{
  for (const auto& [name, value] : _options._values)
  {
    if (in_database(name))
      _before[name] = in_database_value(name);
    check(PetscOptionsSetValue(nullptr, ("-" + name).c_str(),
                               value.empty() ? nullptr : value.c_str()),
          "PetscOptionsSetValue");
  }
}
//-----------------------------------------------------------------------------
SolverOptions::Loan::~Loan()
{
  try
  {
    _options.note_unread();
  }
  catch (const std::exception&)
  {
  }
  for (const auto& [name, value] : _options._values)
  {
    const std::string key = "-" + name;
    if (auto it = _before.find(name); it != _before.end())
    {
      PetscOptionsSetValue(nullptr, key.c_str(),
                           it->second.empty() ? nullptr : it->second.c_str());
    }
    else
      PetscOptionsClearValue(nullptr, key.c_str());
  }
}
