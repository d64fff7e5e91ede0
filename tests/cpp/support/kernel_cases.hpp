// Every camera model with every instruction set, for tests of kernels with both as their parameter.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/all_models.hpp"
#include "support/instruction_sets.hpp"

namespace sfmcpp::support {

struct KernelCase {
  CameraModelId model;
  InstructionSet isa;
};

inline void PrintTo(const KernelCase& c, std::ostream* out) {
  *out << enum_name(c.model) << " " << c.isa.name;
}

inline std::vector<KernelCase> all_kernel_cases() {
  std::vector<KernelCase> cases;
  for (const CameraModelId model : all_models()) {
    for (const InstructionSet& isa : instruction_sets()) cases.push_back({model, isa});
  }
  return cases;
}

inline std::string name_of_kernel_case(const testing::TestParamInfo<KernelCase>& test) {
  return std::string(enum_name(test.param.model)) + "_" + std::string(test.param.isa.name);
}

}  // namespace sfmcpp::support
