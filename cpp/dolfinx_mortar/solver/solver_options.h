// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <mpi.h>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Whether a preconditioner is algebraic multigrid, which is one of the
/// corners of second-order cells, below a level of all nodes.
/// @param[in] pc_type PETSc's name of it.
bool has_corner_level(const std::string& pc_type);

/// @brief PETSc options of a problem, and what is best for those that are not
/// given.
///
/// They are in PETSc's database only while a problem is made and solved.
class SolverOptions
{
public:
  /// @param[in] prefix Prefix of all names.
  /// @param[in] given The user's options, without the prefix; they count more
  /// than what the command line says, and that more than defaults.
  /// @throw std::invalid_argument An option cannot work with interfaces.
  /// @param[in] saddle_point The system is one: a factorisation puts off many
  /// pivots, all the more on several ranks, and needs more memory than planned.
  /// @param[in] is_large Whether the model is large for a direct solver, which
  /// is the default else, and for saddle points; multigrid is the default for
  /// large ones. Asked, on all ranks, where no solver is given.
  SolverOptions(std::string prefix, std::map<std::string, std::string> given,
                bool saddle_point = false,
                const std::function<bool()>& is_large = {});

  /// Displacement dofs up to which no model is large. At 17 000 of a compact
  /// one multigrid takes half of the time of a factorisation, at 38 000 a
  /// third; up to here what fails least costs little more
  static constexpr std::int64_t never_large = 30000;

  /// Displacement dofs above which every model is large
  static constexpr std::int64_t always_large = 500000;

  /// Operations of a factorisation above which a model between these is large.
  /// A cube of 28 000 dofs takes 0.7e11, one of 73 000 takes 3.1e11
  static constexpr double largest_work = 5e10;

  /// True where multigrid has been chosen for the size
  bool is_multigrid_by_size() const { return _multigrid_by_size; }

  const std::string& prefix() const { return _prefix; }

  /// Kind of line search
  const std::string& line_search() const { return _line_search; }

  /// Names and values that count: the user's, the command line's, and defaults
  std::map<std::string, std::string> effective() const;

  /// @brief Refuse names that look like slips of the pen, once solvers have
  /// been set up. Nested solvers take their options later.
  /// @throw std::invalid_argument Nothing has asked for a name, but for one
  /// that is nearly the same.
  void check_names() const;

  /// Options, without the prefix, that nothing has asked for so far
  std::vector<std::string> unread() const;

  /// @brief Options in PETSc's database as long as this lives; what was there
  /// before is there again afterwards.
  class Loan
  {
  public:
    explicit Loan(SolverOptions& options);
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    ~Loan();

  private:
    SolverOptions& _options;
    std::map<std::string, std::string> _before;
  };

private:
  /// Value of an option without the prefix: the user's, or the command line's.
  std::optional<std::string> chosen(const std::string& name) const;
  void check_values() const;
  void note_unread();

  std::string _prefix, _line_search;
  std::map<std::string, std::string> _given, _values;
  bool _multigrid_by_size = false;
  std::set<std::string> _defaults;
  std::optional<std::set<std::string>> _unread;
};
} // namespace dolfinx_mortar
