#include "exchange.hpp"

#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/core/stopwatch.hpp"

namespace sfmcpp::bindings {
namespace {

// A view of const numbers cannot be written to.
template <class Number>
py::memoryview buffer_of(std::span<Number> values) {
  static double nothing = 0.0;  // Python has no view of nowhere
  return py::memoryview::from_buffer(values.empty() ? &nothing : values.data(),
                                     {static_cast<py::ssize_t>(values.size())},
                                     {py::ssize_t{sizeof(double)}});
}

py::list list_of(std::span<const int> counts) {
  py::list list;
  for (int count : counts) list.append(count);
  return list;
}

// Where ranks share cores, one that waits must leave them to the others; but to sleep at once would
// make every message wait for the clock.
constexpr double kSecondsAwake = 100e-6;
constexpr std::chrono::microseconds kNap{20};

py::object called(const py::object& function, const py::object& a, const py::object& b) {
  PyObject* answer = or_wait_for_the_end(
      [&] { return PyObject_CallFunctionObjArgs(function.ptr(), a.ptr(), b.ptr(), nullptr); });
  if (answer == nullptr) throw py::error_already_set();
  return py::reinterpret_steal<py::object>(answer);
}

void wait_for(const py::object& request) {
  const py::object test = request.attr("Test");
  const Stopwatch watch;
  while (!called(test, {}, {}).cast<bool>()) {
    if (watch.seconds() < kSecondsAwake) continue;
    const ReleasedGil released;
    std::this_thread::sleep_for(kNap);
  }
}

void call(const py::object& collective, std::span<const double> mine, std::span<double> others) {
  const HeldGil held;
  wait_for(called(collective, buffer_of(mine), buffer_of(others)));
}

}  // namespace

CommunicatorTransport::CommunicatorTransport(const py::object& communicator)
    : rank_(communicator.attr("Get_rank")().cast<int>()),
      num_ranks_(communicator.attr("Get_size")().cast<int>()),
      all_gather_(communicator.attr("Iallgather")),
      all_to_all_(communicator.attr("Ialltoall")),
      all_to_all_of_counts_(communicator.attr("Ialltoallv")) {}

void CommunicatorTransport::all_gather(std::span<const double> mine, std::span<double> all) {
  call(all_gather_, mine, all);
}

void CommunicatorTransport::all_to_all(std::span<const double> mine, std::span<double> received) {
  call(all_to_all_, mine, received);
}

void CommunicatorTransport::all_to_all(std::span<const double> mine,
                                       std::span<const int> counts,
                                       std::span<double> received,
                                       std::span<const int> received_counts) {
  const HeldGil held;
  wait_for(called(all_to_all_of_counts_,
                  py::make_tuple(buffer_of(mine), list_of(counts)),
                  py::make_tuple(buffer_of(received), list_of(received_counts))));
}

void bind_exchange(py::module_& m) {
  using E = CommunicatorExchange;
  py::class_<E>(m,
                "CommunicatorExchange",
                "What the ranks of a solve pass each other, over a communicator as mpi4py's.")
      .def(py::init<const py::object&>(), py::arg("communicator"))
      .def("interrupt", &E::interrupt, "Stop the solve of all ranks, as Ctrl-C does.")
      .def_property_readonly(
          "messages", [](const E& e) { return e.traffic().messages; }, "Collective calls.")
      .def_property_readonly(
          "bytes_sent", [](const E& e) { return e.traffic().bytes_sent; }, "To other ranks.")
      .def_property_readonly(
          "seconds_waited",
          [](const E& e) { return e.traffic().seconds_waited; },
          "For the other ranks and for the network [s].");
}

}  // namespace sfmcpp::bindings
