// Preconditioners of the iterative solver.
#pragma once

#include <array>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace linear {
enum class PreconditionerKind { kAuto, kSchurJacobi, kClusters, kTwoLevels };
}

template <>
struct EnumTraits<linear::PreconditionerKind> {
  static constexpr std::string_view kWhat = "preconditioner";
  static constexpr auto kTable = std::to_array<EnumRow<linear::PreconditionerKind>>(
      {{linear::PreconditionerKind::kAuto,
        "auto",
        "clusters for many cameras whose Schur complement is formed in blocks, else "
        "schur-jacobi"},
       {linear::PreconditionerKind::kSchurJacobi,
        "schur-jacobi",
        "the blocks of single cameras of the Schur complement"},
       {linear::PreconditionerKind::kClusters,
        "clusters",
        "its blocks of clusters of cameras that see many points in common"},
       {linear::PreconditionerKind::kTwoLevels,
        "two-levels",
        "those, and neighbourhoods of cameras that move as one"}});
};

}  // namespace sfmcpp
