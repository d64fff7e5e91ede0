# Finds Eigen 3.4 or 5: its versions count as incompatible where the first number differs.
find_package(Eigen3 3.4 QUIET NO_MODULE)
if(NOT Eigen3_FOUND)
  set(sfmcpp_other_eigens ${Eigen3_CONSIDERED_VERSIONS})
  find_package(Eigen3 5.0 QUIET NO_MODULE)
endif()
if(NOT Eigen3_FOUND)
  list(JOIN sfmcpp_other_eigens ", " sfmcpp_other_eigens)
  if(sfmcpp_other_eigens)
    set(sfmcpp_other_eigens " (there is ${sfmcpp_other_eigens})")
  endif()
  message(FATAL_ERROR "Eigen 3.4 or 5 is not found${sfmcpp_other_eigens}: must be installed "
    "(apt-get install libeigen3-dev), or its place given by -DCMAKE_PREFIX_PATH=/where/eigen/is, for pip by the "
    "environment: CMAKE_PREFIX_PATH=/where/eigen/is pip install .")
endif()
