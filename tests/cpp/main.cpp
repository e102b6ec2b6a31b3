// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Runs the tests on all ranks together. Rank 0 reports, for all of them.

#include <catch2/catch_session.hpp>
#include <catch2/catch_test_case_info.hpp>
#include <catch2/reporters/catch_reporter_event_listener.hpp>
#include <catch2/reporters/catch_reporter_registrars.hpp>
#include <chrono>
#include <iostream>
#include <petscsys.h>
#include <sstream>
#include <thread>
#include <vector>

namespace
{
/// Not the one of the tests: no message of theirs can be taken for one of ours.
MPI_Comm comm = MPI_COMM_NULL;

/// What this rank's reporter writes.
std::ostringstream report;

/// Lets all ranks begin the next test together. Where others do not follow one
/// whose test has failed, since they wait for it within the test, all end.
class Together : public Catch::EventListenerBase
{
public:
  using EventListenerBase::EventListenerBase;

  void testCaseEnded(const Catch::TestCaseStats& stats) override
  {
    using clock = std::chrono::steady_clock;
    const auto patience = std::chrono::seconds(10);
    const auto start = clock::now();
    MPI_Request request;
    MPI_Ibarrier(comm, &request);
    for (int done = 0; !done;)
    {
      MPI_Test(&request, &done, MPI_STATUS_IGNORE);
      if (done)
        break;
      if (stats.totals.assertions.failed > 0
          and clock::now() - start > patience)
      {
        std::cerr << stats.testInfo->name << ": others do not follow.\n"
                  << report.str() << std::endl;
        MPI_Abort(MPI_COMM_WORLD, 1);
      }
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
  }
};
CATCH_REGISTER_LISTENER(Together)

/// Write the report of rank 0, or those of all ranks where tests have failed.
void show_reports(int result)
{
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  const std::string own = rank == 0 or result != 0 ? report.str() : "";
  int length = own.size();
  std::vector<int> lengths(size), starts(size + 1, 0);
  MPI_Gather(&length, 1, MPI_INT, lengths.data(), 1, MPI_INT, 0, comm);
  for (int r = 0; r < size; ++r)
    starts[r + 1] = starts[r] + lengths[r];
  std::string all(rank == 0 ? starts[size] : 0, ' ');
  MPI_Gatherv(own.data(), length, MPI_CHAR, all.data(), lengths.data(),
              starts.data(), MPI_CHAR, 0, comm);
  if (rank != 0)
    return;
  for (int r = 0; r < size; ++r)
  {
    if (lengths[r] == 0)
      continue;
    if (size > 1)
      std::cout << "--- rank " << r << " of " << size << " ---\n";
    std::cout << all.substr(starts[r], lengths[r]);
  }
  std::cout << std::flush;
}
} // namespace

int main(int argc, char* argv[])
{
  MPI_Init(&argc, &argv);
  // The command line is Catch's
  PetscInitializeNoArguments();
  // Catch reports signals, with the test that they came in
  PetscPopSignalHandler();
  MPI_Comm_dup(MPI_COMM_WORLD, &comm);

  std::streambuf* out = std::cout.rdbuf(report.rdbuf());
  int result;
  {
    Catch::Session session;
    // The same order on all ranks
    session.configData().rngSeed = 1;
    session.configData().runOrder = Catch::TestRunOrder::Declared;
    result = session.applyCommandLine(argc, argv);
    if (result == 0)
      result = session.run();
  }
  std::cout.rdbuf(out);
  int worst = 0;
  MPI_Allreduce(&result, &worst, 1, MPI_INT, MPI_MAX, comm);
  show_reports(result);
  MPI_Comm_free(&comm);
  PetscFinalize();
  MPI_Finalize();
  return worst;
}
