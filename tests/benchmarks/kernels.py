# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Cost of the integrals of one slave facet and of their derivatives, without any assembly.

Nine facets of hex27 over four of one and a half times their size, the slave's nodes up to a
hundredth of its size off the plane. Besides times: the operations of the products that the
derivatives are made of, and what one core can do of them, measured by a loop of multiply-adds.

    python3 tests/benchmarks/kernels.py [--repeats 200]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dolfinx_mortar import cpp

sys.path.append(str(Path(__file__).parents[1]))
from facet_pairs import INTEGRATION, SPACE
from oracle import REFERENCE_NODES

QUAD9 = cpp.FacetType.quad9
DEGREE = 8
NORMALS = np.tile([0.0, 0.0, -1.0], (9, 1))
MULTIPLIERS = np.random.default_rng(1).normal(size=(9, 3))
ALL = np.ones(9, np.int8)
PEAK = r"""
#include <stdio.h>
#include <time.h>
typedef double V __attribute__((vector_size(32)));
int main() {
  V a[10], x = {.999, .999, .999, .999}, y = {1e-3, 1e-3, 1e-3, 1e-3};
  for (int i = 0; i < 10; i++) a[i] = x * i;
  struct timespec s, e;
  clock_gettime(CLOCK_MONOTONIC, &s);
  for (long k = 0; k < 50000000; k++)
#pragma GCC unroll 10
    for (int i = 0; i < 10; i++) a[i] = a[i] * x + y;
  clock_gettime(CLOCK_MONOTONIC, &e);
  V sum = a[0];
  for (int i = 1; i < 10; i++) sum += a[i];
  double t = e.tv_sec - s.tv_sec + 1e-9 * (e.tv_nsec - s.tv_nsec);
  printf("%g %g\n", 4e9 / t, sum[0]);
}
"""


def peak() -> float:
    """Operations that one core does in a second."""
    with tempfile.TemporaryDirectory() as name:
        source, program = Path(name) / "peak.c", Path(name) / "peak"
        source.write_text(PEAK)
        subprocess.run(["cc", "-O2", "-march=native", source, "-o", program], check=True)
        return max(float(subprocess.check_output([program]).split()[0]) for _ in range(3))


def facet(x: float, y: float, size: float) -> np.ndarray:
    """Positions of the nodes of a square facet."""
    return np.column_stack([np.array(REFERENCE_NODES["quad9"]) * size + [x, y], np.zeros(9)])


def facets() -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Slave facets, with the nodes of the masters they overlap and the numbers of these."""
    rng = np.random.default_rng(0)
    result = []
    for i, j in np.ndindex(3, 3):
        slave = facet(i, j, 1.0)
        slave[:, 2] += rng.uniform(-0.01, 0.01, 9)
        first, last = [[int(v / 1.5 + e) for v in (i, j)] for e in (1e-9, 2 / 3 - 1e-9)]
        masters = [
            facet(1.5 * a, 1.5 * b, 1.5)
            for a in range(first[0], last[0] + 1)
            for b in range(first[1], last[1] + 1)
        ]
        x = np.vstack(masters)
        _, nodes = np.unique(np.round(x / 0.375).astype(int), axis=0, return_inverse=True)
        result.append((slave, x, nodes.ravel().astype(np.int64)))
    return result


def integrate(slave, x, nodes, derivatives):
    """Integrals of one facet."""
    num = len(x) // 9
    return cpp.integrate_facet(
        QUAD9,
        -1,
        slave,
        NORMALS,
        ALL,
        MULTIPLIERS,
        [QUAD9] * num,
        ALL[:num],
        nodes,
        x,
        SPACE["dual"],
        INTEGRATION["segment"],
        DEGREE,
        derivatives,
        None,
    )


def num_points(slave, x) -> int:
    """Quadrature points of a facet."""
    masters = np.split(x, len(x) // 9)
    return sum(
        len(cpp.pair_points(QUAD9, -1, slave, QUAD9, 1, m, INTEGRATION["segment"], DEGREE, False).w)
        for m in masters
    )


def operations(points: int, fields: int) -> float:
    """Operations of the products of SegmentDerivative::add: for each point and sum 17 to make five
    factors, and five tables of 13 columns for two axes in the plane, one for the normal."""
    sums = -(-(9 + 27 + 9 * fields + 27) // 4) * 4
    return points * sums * (17 + 2 * 13 * (2 * 3 + 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=200)
    args = parser.parse_args()
    jobs = facets()
    points = np.mean([num_points(slave, x) for slave, x, _ in jobs])
    print(f"{points:.0f} quadrature points for each slave facet")
    limit = peak()
    print(f"multiply-adds of one core: {limit / 1e9:.1f} GFLOP/s")
    without = None
    for name, fields in (("none", 0), ("gap", 1), ("gap_and_slip", 4)):
        times = []
        for _ in range(3):
            start = time.perf_counter()
            for _ in range(args.repeats):
                for job in jobs:
                    integrate(*job, getattr(cpp.Derivatives, name))
            times.append((time.perf_counter() - start) / args.repeats / len(jobs))
        best = min(times)
        if without is None:
            without = best
            print(f"integrals: {1e3 * best:.3f} ms for each slave facet")
            continue
        work = operations(points, fields)
        print(
            f"derivatives ({name}): {1e3 * (best - without):.3f} ms more; their products have "
            f"{work / 1e6:.1f} MFLOP, {100 * work / limit / (best - without):.0f} % of the limit"
        )


if __name__ == "__main__":
    main()
