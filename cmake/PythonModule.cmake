# The extension module dolfinx_mortar.cpp (sources python/*.cpp).
#
# Where the headers of the Python packages are is asked of the interpreter;
# each answer can be given instead, for cross-compilation:
#   -Dnanobind_DIR=  -DMORTAR_DOLFINX_PY_DIR=  -DMORTAR_PETSC4PY_INCLUDE_DIR=

find_package(Python 3.9 REQUIRED COMPONENTS Interpreter Development.Module)

# The folder of a Python package, found without importing it: importing DOLFINx
# starts MPI, which may not be allowed here and may write to standard output.
function(mortar_python_package_dir package variable)
  execute_process(
    COMMAND
      ${Python_EXECUTABLE} -c
      "import importlib.util as u; print('<' + u.find_spec('${package}').submodule_search_locations[0] + '>')"
    OUTPUT_VARIABLE output
    RESULT_VARIABLE failed
    ERROR_QUIET
  )
  if(failed OR NOT output MATCHES "<(.*)>")
    message(
      FATAL_ERROR
      "${Python_EXECUTABLE} does not find the Python package ${package}: install it, or point Python_EXECUTABLE at the interpreter that has it."
    )
  endif()
  set(${variable} "${CMAKE_MATCH_1}" PARENT_SCOPE)
endfunction()

if(NOT MORTAR_DOLFINX_PY_DIR)
  mortar_python_package_dir(dolfinx dir)
  set(MORTAR_DOLFINX_PY_DIR ${dir} CACHE PATH "Python package dolfinx")
endif()
if(NOT MORTAR_PETSC4PY_INCLUDE_DIR)
  mortar_python_package_dir(petsc4py dir)
  set(
    MORTAR_PETSC4PY_INCLUDE_DIR ${dir}/include
    CACHE PATH "Headers of petsc4py"
  )
endif()
if(NOT nanobind_DIR)
  execute_process(
    COMMAND ${Python_EXECUTABLE} -m nanobind --cmake_dir
    OUTPUT_VARIABLE dir
    OUTPUT_STRIP_TRAILING_WHITESPACE
    ERROR_QUIET
  )
  set(nanobind_DIR "${dir}" CACHE PATH "CMake package of nanobind" FORCE)
endif()
find_package(nanobind CONFIG REQUIRED)

# nanobind shares C++ types between extensions only if both were built with the
# same internals: with another version every call with a mesh or a function
# space would fail, so stop here, where something can be done about it.
set(ours "")
foreach(file nb_abi.h nb_internals.cpp nb_internals.h)
  if(NOT ours AND EXISTS ${NB_DIR}/src/${file})
    file(
      STRINGS ${NB_DIR}/src/${file} line
      REGEX "define +NB_INTERNALS_VERSION +[0-9]+"
      LIMIT_COUNT 1
    )
    if(line MATCHES "([0-9]+) *$")
      set(ours ${CMAKE_MATCH_1})
    endif()
  endif()
endforeach()
file(GLOB extensions ${MORTAR_DOLFINX_PY_DIR}/cpp*.so)
set(theirs "")
foreach(extension ${extensions})
  file(
    STRINGS ${extension} line
    REGEX "v[0-9]+_[a-z_]*(gcc|clang|libstdcpp|libcpp|system)"
    LIMIT_COUNT 1
  )
  if(line MATCHES "v([0-9]+)_")
    set(theirs ${CMAKE_MATCH_1})
  endif()
endforeach()
message(
  STATUS
  "nanobind ${nanobind_VERSION}, internals ${ours} (DOLFINx: ${theirs})"
)
if(ours AND theirs AND NOT ours EQUAL theirs)
  message(
    FATAL_ERROR
    "Wrong nanobind: ${nanobind_VERSION} in ${nanobind_DIR} has internals ${ours} and DOLFINx was built with internals ${theirs}; install the version of nanobind that DOLFINx was built with."
  )
endif()

# NOMINSIZE: nanobind would compile for size (-Os) otherwise.
file(
  GLOB sources
  CONFIGURE_DEPENDS
  ${CMAKE_CURRENT_SOURCE_DIR}/python/*.cpp
)
nanobind_add_module(cpp NOMINSIZE ${sources})
set_target_properties(cpp PROPERTIES UNITY_BUILD ${MORTAR_UNITY})
# Has names that others have as well
set_source_files_properties(
  ${CMAKE_CURRENT_SOURCE_DIR}/python/wrap_facets.cpp
  PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON
)
target_link_libraries(cpp PRIVATE dolfinx_mortar Eigen3::Eigen)
target_compile_options(cpp PRIVATE ${MORTAR_COMPILE_OPTIONS})
target_compile_definitions(cpp PRIVATE MORTAR_VERSION="${PROJECT_VERSION}")
target_include_directories(cpp SYSTEM PRIVATE ${MORTAR_PETSC4PY_INCLUDE_DIR})

# <build>/python is ready for PYTHONPATH: the extension, and links to the Python
# files and subpackages, so that editing them needs no build.
set(package ${CMAKE_BINARY_DIR}/python/dolfinx_mortar)
set_target_properties(cpp PROPERTIES LIBRARY_OUTPUT_DIRECTORY ${package})
file(MAKE_DIRECTORY ${package})
file(GLOB stale LIST_DIRECTORIES TRUE ${package}/*)
foreach(file ${stale})
  if(IS_SYMLINK ${file})
    file(REMOVE ${file})
  endif()
endforeach()
file(
  GLOB files
  LIST_DIRECTORIES TRUE
  CONFIGURE_DEPENDS
  ${CMAKE_CURRENT_SOURCE_DIR}/python/dolfinx_mortar/*
)
list(FILTER files EXCLUDE REGEX "__pycache__|\\.so$")
foreach(file ${files})
  cmake_path(GET file FILENAME name)
  file(CREATE_LINK ${file} ${package}/${name} SYMBOLIC)
endforeach()

# Types of the extension, for type checkers and editors. They are asked of the
# extension itself, which imports DOLFINx and so starts MPI, once it is built.
if(MORTAR_STUBS)
  nanobind_add_stub(
    cpp_stub
    MODULE dolfinx_mortar.cpp
    OUTPUT ${package}/cpp.pyi
    PYTHON_PATH ${CMAKE_BINARY_DIR}/python
    DEPENDS cpp
  )
endif()

# A wheel has the Python files from pyproject.toml.
if(SKBUILD)
  install(TARGETS cpp LIBRARY DESTINATION dolfinx_mortar)
  if(MORTAR_STUBS)
    install(FILES ${package}/cpp.pyi DESTINATION dolfinx_mortar)
  endif()
endif()
