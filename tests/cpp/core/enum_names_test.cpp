#include "sfmcpp/core/enum_names.hpp"

#include <set>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve_options.hpp"
#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/optim/summary.hpp"
#include "sfmcpp/residuals/constraint_kinds.hpp"

namespace sfmcpp::enum_names_test {
namespace {

template <class E>
class EveryEnum : public testing::Test {};

using Enums = testing::Types<CameraModelId,
                             LossKind,
                             ba::Gauge,
                             ba::AlgebraicWeights,
                             linear::LinearSolverKind,
                             linear::DampingMatrix,
                             optim::BacktrackingTest,
                             optim::LineSearchKind,
                             optim::Method,
                             optim::Termination,
                             residuals::ConstraintKind>;
TYPED_TEST_SUITE(EveryEnum, Enums);

TYPED_TEST(EveryEnum, NamesGoToValuesAndBack) {
  std::set<std::string_view> names;
  for (const auto& [value, name] : EnumNames<TypeParam>::kTable) {
    EXPECT_EQ(parse_enum<TypeParam>(enum_name(value)), value);
    names.insert(enum_name(value));
  }
  EXPECT_EQ(names.size(), EnumNames<TypeParam>::kTable.size()) << "two values share a name";
}

TYPED_TEST(EveryEnum, TableNamesEveryValueFromZeroWithoutGap) {
  std::set<std::size_t> values;
  for (const auto& entry : EnumNames<TypeParam>::kTable) {
    values.insert(static_cast<std::size_t>(entry.first));
  }
  EXPECT_EQ(values.size(), EnumNames<TypeParam>::kTable.size());
  EXPECT_EQ(*values.rbegin(), values.size() - 1);
  EXPECT_EQ(enum_name(static_cast<TypeParam>(values.size())), "unknown");
}

template <class E>
std::string message_for(std::string_view text) {
  try {
    parse_enum<E>(text);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "no error";
}

TEST(ParseEnum, ErrorNamesTheArgumentTheValueAndEveryChoice) {
  EXPECT_EQ(message_for<LossKind>("hubert"),
            "loss = 'hubert': must be one of squared, huber, cauchy, tukey, geman-mcclure, "
            "truncated, auto");
  EXPECT_EQ(message_for<linear::LinearSolverKind>(""),
            "linear_solver = '': must be one of auto, dense, sparse, iterative");
}

TEST(ParseEnum, DoesNotTakePrefixesOrOtherCases) {
  EXPECT_THROW(parse_enum<optim::Method>("lm-"), InvalidArgument);
  EXPECT_THROW(parse_enum<optim::Method>("LM"), InvalidArgument);
  EXPECT_EQ(parse_enum<optim::Method>("lm"), optim::Method::kLevenbergMarquardt);
}

}  // namespace
}  // namespace sfmcpp::enum_names_test
