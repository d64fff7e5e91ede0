# What find_package(sfmcpp) reads: the target sfmcpp::sfmcpp.
include(CMakeFindDependencyMacro)
find_dependency(Eigen3 @eigen_version@ NO_MODULE)
find_dependency(Threads)
include("${CMAKE_CURRENT_LIST_DIR}/sfmcpp-targets.cmake")
