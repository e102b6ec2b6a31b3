// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include <algorithm>
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/solver/solver_options.h>
#include <petscsys.h>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
const std::string prefix = "unit_options_";

/// What PETSc's database has for a name with the prefix; "(none)" without it.
std::string in_database(const std::string& name)
{
  char text[64] = "";
  PetscBool found;
  PetscOptionsGetString(nullptr, nullptr, ("-" + prefix + name).c_str(), text,
                        sizeof(text), &found);
  return found ? text : "(none)";
}

/// An option of the command line, as long as this lives.
struct OnCommandLine
{
  std::string key;
  OnCommandLine(const std::string& name, const char* value)
      : key("-" + prefix + name)
  {
    PetscOptionsSetValue(nullptr, key.c_str(), value);
  }
  ~OnCommandLine() { PetscOptionsClearValue(nullptr, key.c_str()); }
};

std::string message_of(SolverOptions& options)
{
  try
  {
    options.check_names();
  }
  catch (const std::invalid_argument& e)
  {
    return e.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}
} // namespace

TEST_CASE("options have defaults that fit the solver")
{
  auto effective = [](std::map<std::string, std::string> given)
  { return SolverOptions(prefix, std::move(given)).effective(); };
  auto direct = effective({});
  CHECK(direct.at(prefix + "ksp_type") == "preonly");
  CHECK(direct.at(prefix + "pc_type") == "lu");
  CHECK(direct.at(prefix + "snes_linesearch_type") == "basic");
  auto multigrid = effective({{"pc_type", "gamg"}, {"ksp_rtol", "1e-5"}});
  CHECK(multigrid.at(prefix + "ksp_type") == "gmres");
  CHECK(multigrid.at(prefix + "ksp_rtol") == "1e-5");
  CHECK(multigrid.contains(prefix + "pc_gamg_threshold"));
  CHECK(!multigrid.contains(prefix + "pc_factor_mat_solver_type"));
  for (const auto& [name, value] : multigrid)
    CHECK(name.starts_with(prefix));
}

TEST_CASE("what is given counts more than the command line, this more than "
          "defaults")
{
  const OnCommandLine rtol("snes_rtol", "1e-3"), max_it("snes_max_it", "7"),
      own("ksp_view", nullptr);
  SolverOptions options(prefix, {{"snes_max_it", "9"}});
  const auto all = options.effective();
  CHECK(all.at(prefix + "snes_rtol") == "1e-3");
  CHECK(all.at(prefix + "snes_max_it") == "9");
  CHECK(all.contains(prefix + "ksp_view"));
  CHECK(all.at(prefix + "snes_linesearch_type") == "basic");
}

TEST_CASE("a loan leaves the database as it was")
{
  const OnCommandLine max_it("snes_max_it", "7"), view("ksp_view", nullptr);
  CHECK(in_database("snes_rtol") == "(none)");
  SolverOptions options(prefix, {{"snes_max_it", "9"}, {"snes_view", ""}});
  CHECK(in_database("snes_max_it") == "7");
  {
    const SolverOptions::Loan loan(options);
    CHECK(in_database("snes_max_it") == "9");
    CHECK(in_database("snes_rtol") == "1e-9");
    CHECK(in_database("snes_view") == "");
    CHECK(in_database("ksp_view") == "");
  }
  CHECK(in_database("snes_max_it") == "7");
  CHECK(in_database("snes_rtol") == "(none)");
  CHECK(in_database("snes_view") == "(none)");
  CHECK(in_database("ksp_view") == "");
  // Also where an error ends it
  try
  {
    const SolverOptions::Loan loan(options);
    throw std::runtime_error("error");
  }
  catch (const std::runtime_error&)
  {
  }
  CHECK(in_database("snes_max_it") == "7");
  CHECK(in_database("snes_rtol") == "(none)");
}

TEST_CASE("options that nothing asks for are named")
{
  SolverOptions options(
      prefix, {{"snes_maxit", "9"}, {"snes_max_it", "8"}, {"mine", "1"}});
  {
    const SolverOptions::Loan loan(options);
    CHECK(in_database("snes_max_it") == "8"); // asks for it
  }
  const auto unread = options.unread();
  CHECK(std::ranges::count(unread, "snes_maxit") == 1);
  CHECK(std::ranges::count(unread, "mine") == 1);
  CHECK(std::ranges::count(unread, "snes_max_it") == 0);
  // Defaults are nobody's fault
  CHECK(std::ranges::count(unread, "ksp_type") == 0);
  const std::string message = message_of(options);
  CHECK(contains(message, "'snes_maxit'"));
  CHECK(contains(message, "'snes_max_it'"));
}

TEST_CASE("names of one's own, and of nested solvers, are no slips of the pen")
{
  SolverOptions options(prefix, {{"mine", "1"}, {"sub_0_pc_type", "lu"}});
  {
    const SolverOptions::Loan loan(options);
  }
  CHECK(message_of(options).empty());
}

TEST_CASE("options that cannot work are refused")
{
  auto refused = [](const std::string& name, const std::string& value)
  {
    try
    {
      SolverOptions(prefix, {{name, value}});
    }
    catch (const std::invalid_argument& e)
    {
      return contains(e.what(), name);
    }
    return false;
  };
  CHECK(refused("snes_linesearch_type", "cp"));
  CHECK(refused("snes_mf", ""));
  CHECK(refused("snes_fd", ""));
  CHECK(refused("snes_lag_jacobian", "-1"));
  CHECK(refused("snes_lag_jacobian_persists", "1"));
  CHECK(!refused("snes_linesearch_type", "bt"));
  CHECK(!refused("snes_lag_jacobian", "2"));
  const OnCommandLine mf("snes_mf_operator", nullptr);
  CHECK_THROWS_AS(SolverOptions(prefix, {}), std::invalid_argument);
}
