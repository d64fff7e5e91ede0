# Settings that every target of ours shares, and the sources that are compiled once per instruction set.

function(sfmcpp_target_defaults target)
  # Of the targets themselves, so that it holds in a project of another standard, and for whoever links to them.
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wno-psabi)
  # Products and sums are fused in kernels alone, for which it is chosen: elsewhere ARM, or -march=native, would do so too, and
  # a b − b a would not be zero.
  target_compile_options(${target} PRIVATE -ffp-contract=off)
  # A function is not to be replaced by one of its name elsewhere: calls within the library are direct, or inlined.
  target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU,Clang>:-fno-semantic-interposition>)
  target_compile_definitions(${target} PRIVATE $<$<CONFIG:Debug>:EIGEN_INITIALIZE_MATRICES_BY_NAN>)
  if(SFMCPP_CAMERA_PLUGIN)
    cmake_path(GET SFMCPP_CAMERA_PLUGIN STEM name)
    cmake_path(GET SFMCPP_CAMERA_PLUGIN FILENAME file)
    cmake_path(ABSOLUTE_PATH SFMCPP_CAMERA_PLUGIN BASE_DIRECTORY "${CMAKE_SOURCE_DIR}" OUTPUT_VARIABLE path)
    target_compile_definitions(${target} PUBLIC SFMCPP_CAMERA_PLUGIN_NAME="${name}"
                                                SFMCPP_CAMERA_PLUGIN=$<BUILD_INTERFACE:"${path}">$<INSTALL_INTERFACE:"sfmcpp/plugins/${file}">)
  endif()
  if(SFMCPP_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
endfunction()

# What assertions and sanitizers say of a source, and __FILE__ in a test, is its path within the project: the same object
# comes of every checkout, so that ccache compiles it once for all of them.
function(sfmcpp_path_within_project target)
  target_compile_options(${target} PRIVATE "-ffile-prefix-map=${CMAKE_SOURCE_DIR}/=")
endfunction()

# Variants of the core for tests, with assertions and these sanitizers.
set(sfmcpp_variants asan tsan)
set(sfmcpp_sanitizers_asan address,undefined)
set(sfmcpp_sanitizers_tsan thread)

# Nothing for a variant without a name.
function(sfmcpp_sanitize target variant)
  if(variant)
    set(sanitize -fsanitize=${sfmcpp_sanitizers_${variant}})
    target_compile_options(${target} PRIVATE -O1 -g1 -UNDEBUG ${sanitize} -fno-sanitize-recover=all -fno-omit-frame-pointer)
    target_link_options(${target} PRIVATE ${sanitize})
    sfmcpp_path_within_project(${target})
    set_target_properties(${target} PROPERTIES EXCLUDE_FROM_ALL ON)
  endif()
endfunction()

# Each source becomes one object library per instruction set. The code must live in namespace
# SFMCPP_ISA and define no symbol that another translation unit may share (see core/isa.hpp).
function(sfmcpp_add_isa_sources target variant)
  set(levels "baseline\;2\;")
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    list(APPEND levels "avx2\;4\;-march=x86-64-v3"
         "avx512\;8\;-march=x86-64-v4 -mprefer-vector-width=512")
  endif()
  foreach(level IN LISTS levels)
    list(GET level 0 isa)
    list(GET level 1 lanes)
    list(GET level 2 flags)
    separate_arguments(flags)
    add_library(${target}_${isa} OBJECT ${ARGN})
    sfmcpp_target_defaults(${target}_${isa})
    set_target_properties(${target}_${isa} PROPERTIES UNITY_BUILD OFF)  # kernels share the names of their helpers
    target_include_directories(${target}_${isa} PRIVATE "${CMAKE_CURRENT_SOURCE_DIR}/include")
    target_compile_definitions(${target}_${isa} PRIVATE SFMCPP_ISA=${isa} SFMCPP_LANES=${lanes})
    target_compile_options(${target}_${isa} PRIVATE ${flags} -ffp-contract=fast -fno-math-errno -fno-trapping-math)
    target_compile_options(${target}_${isa} PRIVATE -O3)
    sfmcpp_sanitize(${target}_${isa} "${variant}")
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:${target}_${isa}>)
  endforeach()
endfunction()
