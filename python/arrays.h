// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <span>
#include <stdexcept>
#include <string>
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

/// Refuse an array of the wrong size: nothing is ever read beyond its end.
/// @param[in] expected Number of values.
template <typename Array>
void check_size(const Array& a, std::size_t expected, const char* name)
{
  if (a.size() != expected)
  {
    throw std::invalid_argument(std::string(name) + " has "
                                + std::to_string(a.size()) + " values, but "
                                + std::to_string(expected) + " are needed.");
  }
}

/// Refuse an index that is not in [0, size).
inline void check_index(std::int64_t i, std::size_t size, const char* name)
{
  if (i < 0 or i >= static_cast<std::int64_t>(size))
  {
    throw nanobind::index_error((std::string(name) + " " + std::to_string(i)
                                 + " is not in [0, " + std::to_string(size)
                                 + ").")
                                    .c_str());
  }
}

/// A NumPy array for Python, with the name that it has in type hints
template <typename T>
struct Array : nanobind::object
{
  static constexpr auto Name
      = nanobind::detail::const_name("numpy.typing.NDArray[numpy.")
        + nanobind::detail::dtype_traits<T>::name
        + nanobind::detail::const_name("]");

  Array(nanobind::handle h, nanobind::detail::borrow_t b) : object(h, b) {}
  Array(nanobind::handle h, nanobind::detail::steal_t s) : object(h, s) {}
  static bool check_(nanobind::handle h) { return nanobind::ndarray_check(h); }
};

/// Hand a vector over to Python without a copy
template <typename T>
Array<T> as_array(std::vector<T>&& x, std::initializer_list<std::size_t> shape)
{
  auto* data = new std::vector<T>(std::move(x));
  nanobind::capsule owner(data, [](void* p) noexcept
                          { delete static_cast<std::vector<T>*>(p); });
  const nanobind::ndarray<T, nanobind::numpy> a(data->data(), shape, owner);
  return nanobind::steal<Array<T>>(nanobind::cast(a).release());
}

/// The same, with one axis
template <typename T>
Array<T> as_array(std::vector<T>&& x)
{
  const std::size_t n = x.size();
  return as_array(std::move(x), {n});
}

/// The same, with rows of `columns` values
template <typename T>
Array<T> as_rows(std::vector<T>&& x, std::size_t columns)
{
  const std::size_t n = x.size() / columns;
  return as_array(std::move(x), {n, columns});
}

/// Read-only view of data of an object that Python holds, and that lives as
/// long as the view
template <typename C, typename T>
Array<T> view(const C& object, const T* data,
              std::initializer_list<std::size_t> shape)
{
  const nanobind::ndarray<const T, nanobind::numpy> a(data, shape,
                                                      nanobind::find(object));
  return nanobind::steal<Array<T>>(nanobind::cast(a).release());
}

/// Read-only view of a member of `C`, with `columns` values in a row (0: one
/// axis only); it lives as long as the object, and shows its present values
template <typename C, typename B, typename T>
void def_array(nanobind::class_<C>& c, const char* name,
               std::vector<T> B::* member, const char* doc,
               std::size_t columns = 0)
{
  auto get = [member, columns](const C& self)
  {
    const std::vector<T>& v = self.*member;
    return columns ? view(self, v.data(), {v.size() / columns, columns})
                   : view(self, v.data(), {v.size()});
  };
  c.def_prop_ro(name, get, doc);
}

/// Copy of an array
template <typename T>
std::vector<T> copy(const In<T>& a)
{
  return {a.data(), a.data() + a.size()};
}

/// Values of an enum that is an IntEnum in Python, as an array: NumPy compares
/// its elements with members of the enum
template <typename Enum>
auto as_numbers(std::span<const Enum> values)
{
  std::vector<std::int8_t> numbers;
  for (Enum v : values)
    numbers.push_back(static_cast<std::int8_t>(v));
  return as_array(std::move(numbers));
}
} // namespace dolfinx_mortar_wrappers
