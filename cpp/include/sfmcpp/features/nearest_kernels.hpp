// The inner loop of matching, for the instruction set chosen at run time: squared distances of many
// descriptors to the few of a panel, and the two smallest of each.
//
//   ‖a − b‖² = ‖a‖² + (‖b‖² − 2 s Σb) − 2 (a − s)ᵀb
//
// with s = 128 where products of bytes are summed (those instructions want one factor signed), else
// s = 0. All of it is exact in 32 bits, so that every instruction set gives the same distances.
#pragma once

#include <cstdint>

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::features {

// Of a descriptor, so that nothing overflows.
inline constexpr int kMaxDimension = 2048;
// In place of ‖a‖² and of ‖b‖² − 2sΣb for what fills up a tile: no distance comes near, and the sum
// of two still fits.
inline constexpr int kPadding = 1 << 29;
// Distances from here on are of padding, or of nothing at all.
inline constexpr int kNoDistance = 1 << 28;

// Best, second best and number of the best, each for `count` queries.
struct Smallest {
  int* best;
  int* second;
  int* index;
};

// Descriptors are cut into groups of four bytes: four elements, or two of 16 bits. Those of a tile
// (of a panel) stand side by side, the first group of each, then the second of each.
struct PanelTask {
  const std::uint32_t* rows;  // tiles of NearestKernels::rows descriptors
  const int* row_terms;       // ‖a‖²
  int num_rows;               // a multiple of NearestKernels::rows
  int first_row;              // its number

  const std::uint32_t* panel;  // `columns` descriptors
  const int* panel_terms;      // ‖b‖² − 2sΣb
  int first_column;            // its number

  int num_groups;

  // For each row `lanes` minima, the l-th of the columns that are l modulo `lanes`. Brought up to
  // date: panels must come in order.
  Smallest of_rows;
  // For each column of the panel, over these rows. Overwritten.
  Smallest of_columns;
};

struct NearestKernels {
  int lanes;      // columns that are treated at once
  int rows;       // of a tile
  int columns;    // of a panel, a multiple of `lanes`
  bool in_bytes;  // elements of one byte, shifted by 128 in rows; else of two
  void (*both_ways)(const PanelTask&);
  void (*rows_alone)(const PanelTask&);  // leaves `of_columns` alone
};

// With instructions that sum products of bytes where `byte_products` and there are such.
NearestKernels nearest_kernels(bool byte_products = true);

SFMCPP_DECLARE_FOR_EACH_ISA(NearestKernels nearest_kernels_of(bool byte_products))

}  // namespace sfmcpp::features
