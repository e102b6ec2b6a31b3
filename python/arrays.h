// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <initializer_list>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <span>
#include <vector>

namespace dolfinx_mortar_wrappers
{
/// Read-only contiguous input array of any shape
template <typename T>
using In = nanobind::ndarray<const T, nanobind::numpy, nanobind::c_contig>;

template <typename T>
std::span<const T> span(const In<T>& a)
{
  return {a.data(), a.size()};
}

/// Hand a vector over to Python without a copy
template <typename T>
auto as_array(std::vector<T>&& x, std::initializer_list<std::size_t> shape)
{
  auto* data = new std::vector<T>(std::move(x));
  nanobind::capsule owner(data, [](void* p) noexcept
                          { delete static_cast<std::vector<T>*>(p); });
  return nanobind::ndarray<T, nanobind::numpy>(data->data(), shape, owner);
}
} // namespace dolfinx_mortar_wrappers
