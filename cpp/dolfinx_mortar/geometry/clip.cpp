// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "clip.h"
#include <cmath>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
ClipPolygon dolfinx_mortar::clip(std::span<const std::array<double, 2>> slave,
                                 std::span<const std::array<double, 2>> master,
                                 double tol)
{
  using Kind = ClipVertex::Kind;
  const int ns = slave.size();
  const int nm = master.size();

  ClipPolygon in, out;
  in.size = nm;
  for (std::int8_t j = 0; j < nm; ++j)
    in.vertices[j] = {master[j], Kind::master, -1, j, j};

  // Vertex where slave edge i cuts the line of an edge
  auto cut = [ns](std::int8_t i, std::int8_t line, std::array<double, 2> p,
                  std::int8_t next) -> ClipVertex
  {
    if (line < 4)
      return {p, Kind::intersection, i, line, next};
    // Two slave edges: their common corner
    const std::int8_t k = line - 4;
    const std::int8_t corner = (k + 1) % ns == i ? i : k;
    return {p, Kind::slave, corner, -1, next};
  };

  for (std::int8_t i = 0; i < ns; ++i)
  {
    const auto& a = slave[i];
    const auto& b = slave[(i + 1) % ns];
    const double tx = b[0] - a[0], ty = b[1] - a[1];
    const double length = std::hypot(tx, ty);
    if (length == 0)
      continue;
    std::array<double, 16> d;
    for (int k = 0; k < in.size; ++k)
    {
      const auto& p = in.vertices[k].p;
      d[k] = (tx * (p[1] - a[1]) - ty * (p[0] - a[0])) / length;
    }

    out.size = 0;
    for (int k = 0; k < in.size; ++k)
    {
      const int l = (k + 1) % in.size;
      const ClipVertex& P = in.vertices[k];
      const ClipVertex& Q = in.vertices[l];
      const bool P_in = d[k] >= -tol;
      const bool Q_in = d[l] >= -tol;
      const std::int8_t along = 4 + i;
      auto point = [&]() -> std::array<double, 2>
      {
        const double t = d[k] / (d[k] - d[l]);
        return {P.p[0] + t * (Q.p[0] - P.p[0]), P.p[1] + t * (Q.p[1] - P.p[1])};
      };
      if (out.size > 13)
        break;
      if (P_in and Q_in)
        out.vertices[out.size++] = P;
      else if (P_in)
      {
        out.vertices[out.size++] = P;
        if (d[k] > tol)
          out.vertices[out.size++] = cut(i, P.line, point(), along);
        else
          out.vertices[out.size - 1].line = along;
      }
      else if (Q_in and d[l] > tol)
        out.vertices[out.size++] = cut(i, P.line, point(), P.line);
    }
    std::swap(in, out);
    if (in.size < 3)
      return in;
  }
  return in;
}
