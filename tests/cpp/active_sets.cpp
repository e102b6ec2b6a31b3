// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/contact/active_sets.h>
#include <string>

using namespace dolfinx_mortar;

namespace
{
int rank_of_world()
{
  int rank;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}

int size_of_world()
{
  int size;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

/// States from letters: open, stick (s) and slip (l).
std::vector<Status> states(const std::string& letters)
{
  std::vector<Status> s;
  for (char c : letters)
  {
    s.push_back(c == 's' ? Status::stick
                         : (c == 'l' ? Status::slip : Status::open));
  }
  return s;
}

/// Whether it cycles after each of some iterates, as a string of 0 and 1.
std::string cycles(const std::vector<std::string>& iterates)
{
  ActiveSets sets(MPI_COMM_WORLD);
  std::string found;
  for (const std::string& letters : iterates)
  {
    sets.record(states(letters));
    found += sets.cycling() ? '1' : '0';
  }
  return found;
}
} // namespace

TEST_CASE("changes of states are counted on all ranks", "[mpi]")
{
  const int size = size_of_world();
  ActiveSets sets(MPI_COMM_WORLD);
  CHECK(sets.size() == 0);
  // At first all are open
  CHECK(sets.record(states("osl")) == 2 * size);
  CHECK(sets.record(states("osl")) == 0);
  // One rank's node
  CHECK(sets.record(states(rank_of_world() == 0 ? "oss" : "osl")) == 1);
  CHECK(sets.record(states("loo")) == 3 * size);
  CHECK(sets.size() == 4);
  CHECK(sets.status(0)[0] == Status::slip);
  CHECK(sets.status(3)[1] == Status::stick);
}

TEST_CASE("nodes are counted by their states", "[mpi]")
{
  const int size = size_of_world();
  const ContactCounts n = count_nodes(
      MPI_COMM_WORLD, states(rank_of_world() == 0 ? "slslo" : "lo"));
  CHECK(n.stick == 2);
  CHECK(n.slip == 2 + size - 1);
  CHECK(n.active == 4 + size - 1);
  CHECK(count_nodes(MPI_COMM_WORLD, {}).active == 0);
}

TEST_CASE("states that come back are a cycle", "[mpi]")
{
  // Twice there and back, and once more
  CHECK(cycles({"o", "s", "o", "s", "o", "s"}) == "000011");
  CHECK(cycles({"o", "s", "l", "o", "s", "l", "o", "s"}) == "00000011");
  // After a beginning that does not belong to it
  CHECK(cycles({"ll", "oo", "os", "so", "os", "so", "os"}) == "0000011");
  CHECK(cycles({"o", "s", "l", "s", "o", "s", "l", "s", "o"}) == "000000001");
  CHECK(cycles({"oo", "so", "ss", "sl", "ll", "os", "ol", "oo", "so", "ss",
                "sl", "ll", "os", "ol", "oo"})
        == "000000000000001");
  // It ends
  CHECK(cycles({"o", "s", "o", "s", "o", "o"}) == "000010");
}

TEST_CASE("states that stay, or go on, are no cycle", "[mpi]")
{
  CHECK(cycles({"s", "s", "s", "s", "s", "s", "s", "s"}) == "00000000");
  CHECK(cycles({"ooo", "soo", "sso", "sss", "ssl", "sll", "lll"}) == "0000000");
  // A return alone
  CHECK(cycles({"o", "s", "o", "o", "o", "o"}) == "000000");
}

TEST_CASE("a cycle is one of all ranks", "[mpi]")
{
  const bool first = rank_of_world() == 0;
  // Only one rank changes states: still a cycle
  ActiveSets sets(MPI_COMM_WORLD);
  for (int i = 0; i < 5; ++i)
    sets.record(states(first and i % 2 ? "s" : "o"));
  CHECK(sets.cycling());
  // One rank's states settle only now: no cycle yet, were it not alone
  ActiveSets others(MPI_COMM_WORLD);
  const std::vector<std::string> settles = {"o", "l", "s", "s", "s"};
  for (int i = 0; i < 5; ++i)
    others.record(states(first ? settles[i] : (i % 2 ? "s" : "o")));
  CHECK(!others.cycling());
}
