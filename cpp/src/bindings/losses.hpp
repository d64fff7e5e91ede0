#pragma once

#include <memory>
#include <string>
#include <variant>

#include <pybind11/pybind11.h>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/residuals/loss.hpp"

namespace sfmcpp::bindings {

// A loss in Python: its name, or a table.
using NamedLoss = std::variant<std::string, std::shared_ptr<LossTable>>;

// As `kind` and `table` have it: the kind of a table is squared.
inline void set_loss(const NamedLoss& named,
                     LossKind& kind,
                     std::shared_ptr<const LossTable>& table) {
  const auto* name = std::get_if<std::string>(&named);
  kind = name != nullptr ? parse_enum<LossKind>(*name) : LossKind::kSquared;
  table = name != nullptr ? nullptr : std::get<std::shared_ptr<LossTable>>(named);
}

}  // namespace sfmcpp::bindings
