#include "sfmcpp/core/options_check.hpp"

#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/refusal.hpp"

namespace sfmcpp::options_check_test {
namespace {

using support::message_of;

TEST(OptionsCheck, IsSilentWhenEveryRuleHolds) {
  OptionsCheck check;
  check.require(true, "size", 3.0, "positive");
  EXPECT_NO_THROW(check.done());
}

TEST(OptionsCheck, ListsEveryViolationInOneMessage) {
  OptionsCheck check;
  check.require(false, "size", -3.0, "positive");
  check.require(true, "length", 1.0, "positive");
  check.require(false, "share", 1.5, "in [0, 1]");
  EXPECT_EQ(message_of([&] { check.done(); }),
            "size = -3: must be positive; share = 1.5: must be in [0, 1]");
}

TEST(SolveOptions, DefaultsAreLegal) { EXPECT_NO_THROW(ba::SolveOptions{}.validate()); }

TEST(SolveOptions, EveryIllegalOptionIsNamed) {
  ba::SolveOptions options;
  options.minimizer.termination = {.max_iterations = -1,
                                   .max_seconds = 0.0,
                                   .function_tolerance = -1.0,
                                   .gradient_tolerance = -1.0,
                                   .parameter_tolerance = -1.0};
  options.minimizer.initial_damping = 0.0;
  options.loss_scale_px = 0.0;
  options.linear_solver.pcg_tolerance = 1.0;
  options.linear_solver.pcg_max_iterations = 0;
  options.num_threads = -2;
  const std::string message = message_of([&] { options.validate(); });
  for (const char* violation : {"max_iterations = -1: must be",
                                "max_seconds = 0: must be",
                                "function_tolerance = -1: must be",
                                "gradient_tolerance = -1: must be",
                                "parameter_tolerance = -1: must be",
                                "initial_damping = 0: must be",
                                "loss_scale_px = 0: must be",
                                "pcg_tolerance = 1: must be",
                                "pcg_max_iterations = 0: must be",
                                "threads = -2: must be"}) {
    EXPECT_NE(message.find(violation), std::string::npos)
        << violation << " is missing in: " << message;
  }
}

TEST(SolveOptions, NumbersThatAreNoNumbersAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ba::SolveOptions options;
  options.minimizer.termination.function_tolerance = nan;
  EXPECT_THROW(options.validate(), InvalidArgument);
  options = {};
  options.minimizer.termination.max_seconds = nan;
  EXPECT_THROW(options.validate(), InvalidArgument);
  options = {};
  options.loss_scale_px = nan;
  EXPECT_THROW(options.validate(), InvalidArgument);
  options = {};
  options.minimizer.initial_damping = std::numeric_limits<double>::infinity();
  EXPECT_THROW(options.validate(), InvalidArgument);
}

}  // namespace
}  // namespace sfmcpp::options_check_test
