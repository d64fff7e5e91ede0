// The machine that this process runs on.
#pragma once

namespace sfmcpp {

// Physical memory in bytes, or what a container may have of it.
double memory_limit_bytes();

// A whole number that identifies this machine, made from its name.
double machine_number();

}  // namespace sfmcpp
