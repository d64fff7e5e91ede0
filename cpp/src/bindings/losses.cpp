#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "module.hpp"

namespace sfmcpp::bindings {
namespace {

// f of each squared residual.
template <class F>
auto each(const F& f, const py::array_t<double>& squared) {
  return py::vectorize([&](double s) { return f(s); })(squared);
}

// Of squared residuals: ρ, ρ′ and the slope of the influence.
py::tuple loss_terms(const NamedLoss& named, double scale, const py::array_t<double>& squared) {
  Loss loss{.scale = scale};
  set_loss(named, loss.kind, loss.table);
  return py::make_tuple(each([&](double s) { return loss.rho(s); }, squared),
                        each([&](double s) { return loss.derivative(s); }, squared),
                        each([&](double s) { return loss.influence_slope(s); }, squared));
}

}  // namespace

void bind_losses(py::module_& m) {
  using T = LossTable;
  m.attr("LOSS_TABLE_TERMS") = T::kTerms;
  py::class_<T, std::shared_ptr<T>>(m, "LossTable", "A robust loss whose derivative is a table.")
      .def(py::init<std::string, std::vector<double>, std::vector<double>>(),
           py::arg("name"),
           py::arg("knots"),
           py::arg("coefficients"))
      .def_property_readonly("name", &T::name);
  m.def("loss_terms",
        &loss_terms,
        py::arg("loss"),
        py::arg("scale"),
        py::arg("squared"),
        "ρ, ρ′ and d(s ρ′)/ds of squared residuals s.");
}

}  // namespace sfmcpp::bindings
