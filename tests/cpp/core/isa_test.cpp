#include "sfmcpp/core/isa.hpp"

#include <cstdio>
#include <cstdlib>
#include <string>

#include <gtest/gtest.h>

#include "sfmcpp/core/error.hpp"
#include "support/instruction_sets.hpp"

namespace sfmcpp::isa_test {
namespace {

// The instruction set is read once: each case needs a process of its own.
class IsaDeathTest : public testing::TestWithParam<std::string> {
 protected:
  IsaDeathTest() { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
};

[[noreturn]] void exit_with_isa_asked_for(const std::string& name) {
  setenv("SFMCPP_ISA", name.c_str(), 1);
  std::exit(static_cast<int>(active_isa()));
}

TEST_P(IsaDeathTest, EnvironmentVariableChoosesAnInstructionSetThatTheMachineHas) {
  const auto sets = support::instruction_sets();
  int expected = static_cast<int>(sets.size()) - 1;
  for (std::size_t k = 0; k < sets.size(); ++k) {
    if (sets[k].name == GetParam()) expected = static_cast<int>(k);
  }
  EXPECT_EXIT(exit_with_isa_asked_for(GetParam()), testing::ExitedWithCode(expected), "");
}

INSTANTIATE_TEST_SUITE_P(Names, IsaDeathTest, testing::Values("baseline", "avx2", "avx512", ""));

[[noreturn]] void exit_with_refusal_of(const std::string& name) {
  setenv("SFMCPP_ISA", name.c_str(), 1);
  try {
    active_isa();
  } catch (const InvalidArgument& error) {
    std::fputs(error.what(), stderr);
    std::exit(7);
  }
  std::exit(0);
}

using IsaRefusalDeathTest = IsaDeathTest;

TEST_P(IsaRefusalDeathTest, AnotherNameIsRefused) {
  EXPECT_EXIT(exit_with_refusal_of(GetParam()),
              testing::ExitedWithCode(7),
              "SFMCPP_ISA = '" + GetParam() + "': must be one of baseline, avx2, avx512");
}

INSTANTIATE_TEST_SUITE_P(Names, IsaRefusalDeathTest, testing::Values("sse2", "AVX2"));

TEST(Isa, NamesAreThoseOfTheKernels) {
  int k = 0;
  for (const auto& set : support::instruction_sets()) {
    EXPECT_EQ(isa_name(static_cast<Isa>(k++)), set.name);
  }
}

}  // namespace
}  // namespace sfmcpp::isa_test
