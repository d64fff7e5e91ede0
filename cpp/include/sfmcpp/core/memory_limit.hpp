// How much memory there is for this process.
#pragma once

namespace sfmcpp {

// Physical memory in bytes, or what a container may have of it.
double memory_limit_bytes();

}  // namespace sfmcpp
