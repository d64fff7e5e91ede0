// How closely the cameras hang together by the points that they share.
#pragma once

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/observation_graph.hpp"

namespace sfmcpp::linear {

// The spectral gap of a random walk from a camera to one of its points and on to one of the cameras
// that see it: 1 where all cameras see all points, about 1/3 in a collection of photos of one
// place, some hundredths along a road; it falls with the square of the length of a chain. The walk
// is a model of the Schur complement with one unknown for each camera and point (with ones in J,
// S = D − A V⁻¹ Aᵀ for the counts D, V and the incidences A), so its gap tells how fast conjugate
// gradients converge.
//
// From above, by a few steps of Lanczos' method, which end once the gap is known to be below
// `least`. The same bits on every rank, and for every number of them and of threads.
double covisibility_gap(const ObservationGraph& graph,
                        ThreadPool& pool,
                        Exchange& exchange,
                        double least);

}  // namespace sfmcpp::linear
