// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cmath>
#include <type_traits>

/// Four numbers at a time, for the few loops where the time of an interface
/// goes. They are compiled twice, for all processors and for those with
/// registers of four numbers (AVX2, three to four times fewer instructions),
/// and the processor at hand chooses.

#define MORTAR_INLINE [[gnu::always_inline]] inline

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__AVX2__)
#define MORTAR_CHOICE
#endif

namespace dolfinx_mortar
{
/// @brief Four numbers, side by side.
using Pack [[gnu::vector_size(32)]] = double;

/// @brief The same anywhere in an array.
using LoosePack [[gnu::vector_size(32), gnu::aligned(8), gnu::may_alias]]
= double;

/// @brief How many they are.
constexpr int pack_size = 4;

/// @brief The same number four times, or once.
template <typename T>
MORTAR_INLINE T constant(double x)
{
  if constexpr (std::is_same_v<T, double>)
    return x;
  else
    return T{x, x, x, x};
}

MORTAR_INLINE Pack load(const double* x)
{
  return *reinterpret_cast<const LoosePack*>(x);
}

MORTAR_INLINE void store(double* x, const Pack& v)
{
  *reinterpret_cast<LoosePack*>(x) = v;
}

MORTAR_INLINE Pack square_root(const Pack& v)
{
  return Pack{std::sqrt(v[0]), std::sqrt(v[1]), std::sqrt(v[2]),
              std::sqrt(v[3])};
}

#ifdef MORTAR_CHOICE
/// @brief A function compiled for registers of four numbers.
template <auto function, typename... Arguments>
[[gnu::target("avx2,fma")]] void call_wide(Arguments... arguments)
{
  function(arguments...);
}
#endif

/// @brief Call a function, which must be MORTAR_INLINE and so must all that it
/// calls in its loops, as compiled for the processor at hand.
template <auto function, typename... Arguments>
void call_packed(Arguments... arguments)
{
#ifdef MORTAR_CHOICE
  static const bool wide
      = __builtin_cpu_supports("avx2") and __builtin_cpu_supports("fma");
  if (wide)
    return call_wide<function>(arguments...);
#endif
  function(arguments...);
}
} // namespace dolfinx_mortar
