#include "sfmcpp/optim/step_strategy.hpp"

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::optim {

std::vector<double> StepStrategy::save() {
  Memory memory;
  keep(memory);
  return memory.numbers();
}

void StepStrategy::restore(std::span<const double> saved) {
  Memory memory(saved);
  keep(memory);
  if (!memory.all_read())
    throw InvalidArgument("saved numbers of a method: more than this method has");
}

}  // namespace sfmcpp::optim
