"""`pytest` runs the tests on one rank, then on two and on three.

The session that the user starts runs all tests itself. Then it starts pytest
under `mpirun` for all further numbers in the option --ranks side by side, and
takes in the reports of each rank 0, one number after the other, so that they
count like its own. In such a run

* a test that fails on one rank fails on all, with the messages of all ranks, and
  the ranks go on with the next test together;
* where they cannot, because ranks wait for one that has given up, the run ends
  after a while instead of never.
"""

import contextlib
import faulthandler
import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx.jit
import pytest
import ufl
from programs import YIELDING

# A form may be in the hands of another run: give it longer than ten seconds.
dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (100, "Seconds")
# Meshes are small: more optimisation takes longer than it saves.
dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS["cffi_extra_compile_args"] = (["-O1", "-g0"], "Flags")
# UFL makes a cell anew, and all of its sub-entities with theirs, each time that somebody asks an
# element for it: more than half of the time that small problems take. They differ by name alone.
_cells, _make_cell = {}, ufl.Cell.__init__


def _take_known_cell(self, name):
    if name not in _cells:
        _make_cell(cell := ufl.Cell.__new__(ufl.Cell), name)
        _cells[name] = cell
    slots = [slot for c in ufl.Cell.__mro__ for slot in getattr(c, "__slots__", ())]
    for attribute in {*slots, *vars(_cells[name])}:
        if hasattr(_cells[name], attribute):
            setattr(self, attribute, getattr(_cells[name], attribute))


ufl.Cell.__init__ = _take_known_cell
# The file that takes the reports of rank 0, in a run that a session has started.
REPORTS = os.environ.get("MORTAR_TEST_REPORTS")
# MPI adds to the environment of its processes what mpirun must not see.
ENVIRONMENT = YIELDING | os.environ

comm = MPI.COMM_WORLD.Dup()  # no test's message can be taken for one of ours


def pytest_addoption(parser):
    parser.addoption(
        "--ranks", default="1,2,3", help="run the tests on one rank, then on each further number"
    )
    parser.addoption(
        "--patience", type=float, default=300, help="seconds that a test on several ranks may take"
    )

    parser.addoption(
        "--every",
        type=int,
        default=1,
        help="of a test with parameters, run the first and each so many-th set of these only",
    )
    parser.addoption(
        "--part", default="1/1", help="I/N: run the tests I, I + N, I + 2 N and so on only"
    )
    parser.addoption(
        "--deal",
        metavar="WORD",
        help="of a test with parameters, run the first set on one rank and on one of the further"
        " numbers of ranks, each other set on one of all; another WORD deals them out otherwise",
    )


def pytest_collection_modifyitems(config, items):
    every, word = config.getoption("every"), config.getoption("deal")
    further = sorted({n for n in numbers_of_ranks(config) if n > 1})
    part, parts = map(int, config.getoption("part").split("/"))
    seen, kept = {}, []
    for i, item in enumerate(items):
        name = item.nodeid.partition("[")[0]
        seen[name] = number = seen.get(name, -1) + 1
        keep = number % every == 0 and i % parts == part - 1
        if word and further and not item.get_closest_marker("serial"):
            # By name, since a parity of numbers would give one parameter to one number of ranks
            share = zlib.crc32((word + item.nodeid).encode())
            if number > 0:
                # Half of them on one rank, where they take the least time
                keep = keep and [1, 1, *further][share % (2 + len(further))] == comm.size
            elif comm.size > 1:
                keep = keep and further[share % len(further)] == comm.size
        kept.append(keep)
    config.hook.pytest_deselected(
        items=[i for i, keep in zip(items, kept, strict=True) if not keep]
    )
    items[:] = [i for i, keep in zip(items, kept, strict=True) if keep]


def numbers_of_ranks(config):
    return [int(n) for n in config.getoption("ranks").split(",")]


def pytest_configure(config):
    config.pluginmanager.register(OneOfSeveral(config) if comm.size > 1 else Conductor(config))


def pytest_collection_finish(session):
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    result = yield
    # Objects of PETSc and DOLFINx must be destroyed by all ranks together.
    gc.collect()
    gc.freeze()  # to look at all that is left again would take 13 ms after each test
    PETSc.garbage_cleanup()
    comm.Barrier()
    return result


@pytest.fixture
def tmp_path(tmp_path):
    """One temporary folder for all ranks."""
    return comm.bcast(tmp_path)


class OneOfSeveral:
    """One rank among several: keeps together with the others."""

    def __init__(self, config):
        self.config = config
        self.patience = config.getoption("patience")

    def pytest_sessionstart(self, session):
        if comm.rank > 0:  # rank 0 tells what went wrong on the others
            terminal = self.config.pluginmanager.getplugin("terminalreporter")
            terminal._tw._file = open(os.devnull, "w")

    def pytest_collection_modifyitems(self, config, items):
        serial = [item for item in items if item.get_closest_marker("serial")]
        items[:] = [item for item in items if not item.get_closest_marker("serial")]
        config.hook.pytest_deselected(items=serial)

    def pytest_collection_finish(self, session):
        self.send("collected", len(session.items))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session):
        collected = comm.allgather((session.testsfailed, [item.nodeid for item in session.items]))
        if any(c != collected[0] for c in collected):
            self.abort("the ranks have not collected the same tests")
        return (yield)

    def pytest_internalerror(self, excrepr):
        self.abort(str(excrepr))

    def pytest_keyboard_interrupt(self, excinfo):
        self.abort(str(excinfo.value))

    def abort(self, message):
        """End all ranks: an exit on one would wait for the others in PetscFinalize."""
        self.config.pluginmanager.getplugin("capturemanager").suspend_global_capture()
        print(f"--- rank {comm.rank} ---\n{message}", file=sys.__stderr__, flush=True)
        MPI.COMM_WORLD.Abort(1)

    def pytest_runtest_logstart(self, nodeid, location):
        self.send("started", [nodeid, location])
        faulthandler.dump_traceback_later(self.patience, exit=True, file=sys.__stderr__)

    def pytest_runtest_logfinish(self):
        faulthandler.cancel_dump_traceback_later()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_makereport(self, item, call):
        report = yield
        message = report.longreprtext if report.failed else ""
        failed, any_failed = bytearray([report.failed]), bytearray(1)
        request = comm.Iallreduce([failed, MPI.BYTE], [any_failed, MPI.BYTE], op=MPI.BOR)
        give_up = time.monotonic() + (20 if report.failed else self.patience)
        while not request.Test():
            if time.monotonic() > give_up:
                self.abort(f"{item.nodeid}, {call.when}: others do not follow.\n{message}")
            time.sleep(1e-4)
        if any_failed[0]:
            report.outcome = "failed"
            messages = enumerate(comm.allgather(message))
            report.longrepr = "\n".join(f"--- rank {r} ---\n{m}" for r, m in messages if m)
        return report

    def pytest_runtest_logreport(self, report):
        hook = self.config.hook.pytest_report_to_serializable
        self.send("report", hook(config=self.config, report=report))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session):
        self.send("finished", session.testsfailed)

    def send(self, kind, data):
        if REPORTS and comm.rank == 0:
            with open(REPORTS, "a") as file:
                file.write(json.dumps([kind, data]) + "\n")


class Conductor:
    """The session on one rank: lets those on several ranks follow its own."""

    def __init__(self, config):
        self.config = config
        self.numbers = [n for n in numbers_of_ranks(config) if n > 1]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session):
        result = yield
        options = self.config.option
        if session.items and not options.collectonly and not options.usepdb:
            handler = signal.signal(signal.SIGTERM, lambda *_: pytest.exit("terminated", 143))
            with contextlib.ExitStack() as runs:
                runs.callback(signal.signal, signal.SIGTERM, handler)
                # While ranks of one wait for each other, those of another have the cores
                started = [runs.enter_context(self.run_on(number)) for number in self.numbers]
                for number, run in zip(self.numbers, started, strict=True):
                    terminal = self.config.pluginmanager.getplugin("terminalreporter")
                    terminal.ensure_newline()
                    terminal.write_sep("-", f"on {number} ranks")
                    self.follow(*run, number, session)
        return result

    @contextlib.contextmanager
    def run_on(self, number):
        """A run, which ends with the context: process, file of reports and of other output."""
        mpirun = shutil.which("mpirun") or shutil.which("mpiexec") or "mpirun"
        command = [mpirun, "-n", str(number), sys.executable, "-m", "mpi4py", "-m", "pytest"]
        command += [*self.config.invocation_params.args, "--capture=sys", "--color=no"]
        with tempfile.TemporaryDirectory() as folder:
            reports, output = Path(folder, "reports"), Path(folder, "output")
            reports.touch()
            with output.open("w") as file:
                process = subprocess.Popen(
                    command,
                    cwd=self.config.invocation_params.dir,
                    env=ENVIRONMENT | {"MORTAR_TEST_REPORTS": str(reports)},
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            try:
                yield process, reports, output
            finally:
                end(process)

    def follow(self, process, reports, output, number, session):
        """Take in what rank 0 reports, until the run ends or falls silent."""
        config, hook = self.config, self.config.hook
        suffix = f" on {number} ranks"
        current, n_failed, finished = ["start", ("", None, "")], 0, False
        silent_since = time.monotonic()
        with reports.open() as lines:
            while True:
                ended = process.poll() is not None
                for kind, data in map(json.loads, complete_lines(lines)):
                    silent_since = time.monotonic()
                    if kind == "collected":
                        session.testscollected += data
                    elif kind == "started":
                        current = data
                        hook.pytest_runtest_logstart(nodeid=data[0] + suffix, location=data[1])
                    elif kind == "report":
                        report = hook.pytest_report_from_serializable(config=config, data=data)
                        report.nodeid += suffix
                        n_failed += report.failed
                        hook.pytest_runtest_logreport(report=report)
                    elif kind == "finished":
                        finished = True
                if ended:
                    break
                if time.monotonic() - silent_since > config.getoption("patience") + 30:
                    end(process)
                time.sleep(0.05)
        if not finished or (process.returncode not in (0, 5) and n_failed == 0):
            tail = output.read_text(errors="replace").splitlines()[-80:]
            nodeid, location = current
            report = pytest.TestReport(
                nodeid=nodeid + suffix,
                location=tuple(location),
                keywords={},
                outcome="failed",
                longrepr="\n".join(
                    [f"mpirun ended with {process.returncode}, having written:", *tail]
                ),
                when="call",
            )
            hook.pytest_runtest_logreport(report=report)


def complete_lines(file):
    """The lines that have been written in full since the last call."""
    while True:
        position = file.tell()
        line = file.readline()
        if not line.endswith("\n"):
            file.seek(position)
            return
        yield line


def end(process):
    """End a run under mpirun, and with it its ranks."""
    for signum, seconds in (signal.SIGTERM, 10), (signal.SIGKILL, None):
        if process.poll() is None:
            os.killpg(process.pid, signum)
            try:
                process.wait(seconds)
            except subprocess.TimeoutExpired:
                pass
