#pragma once

namespace sfmcpp::optim {

// Why to stop at once, the gravest reason last: what one rank has met counts for all.
enum class Stop { kNo, kTime, kCallback, kInterrupt };

}  // namespace sfmcpp::optim
