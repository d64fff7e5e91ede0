#include "module.hpp"

#include <pybind11/pybind11.h>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/core/machine.hpp"

namespace py = pybind11;

namespace {

// The Python class is defined in sfmcpp.errors, so that code without the core can raise it too.
void register_errors() {
  // pybind11 asks for this signature.
  py::register_exception_translator(
      [](std::exception_ptr p) {  // NOLINT(performance-unnecessary-value-param)
        try {
          if (p) std::rethrow_exception(p);
        } catch (const sfmcpp::InvalidArgument& e) {
          py::set_error(py::module_::import("sfmcpp.errors").attr("InvalidArgument"), e.what());
        } catch (const sfmcpp::Error& e) {
          py::set_error(py::module_::import("sfmcpp.errors").attr("SfmcppError"), e.what());
        }
      });
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  m.doc() = "C++ core of sfmcpp; the public interface is the package sfmcpp.";
  m.attr("__version__") = SFMCPP_VERSION;
  m.attr("INSTRUCTION_SET") = py::str(std::string(sfmcpp::isa_name(sfmcpp::active_isa())));
  m.def(
      "usable_cores",
      [] { return sfmcpp::usable_cores(); },
      "Cores that this process may keep busy: it is bound to no others, or has no more time.");
  register_errors();
  sfmcpp::bindings::bind_losses(m);
  sfmcpp::bindings::bind_options(m);
  sfmcpp::bindings::bind_summary(m);
  sfmcpp::bindings::bind_exchange(m);
  sfmcpp::bindings::bind_solve(m);
  sfmcpp::bindings::bind_check(m);
  sfmcpp::bindings::bind_pose(m);
  sfmcpp::bindings::bind_constraint_kinds(m);
  sfmcpp::bindings::bind_camera_models(m);
  sfmcpp::bindings::bind_linearize(m);
  sfmcpp::bindings::bind_nearest(m);
  sfmcpp::bindings::bind_patches(m);
  sfmcpp::bindings::bind_files(m);
}
