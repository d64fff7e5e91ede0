#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

#include <pybind11/stl.h>

#include "arguments.hpp"
#include "module.hpp"
#include "sfmcpp/ba/solve_options.hpp"

namespace sfmcpp::bindings {
namespace {

using ba::OptionFacts;
using ba::SolveOptions;

using Named = std::vector<std::pair<std::string, std::string>>;  // names and what they mean

// An option as Python and the command line see it.
struct Option {
  std::string name;
  std::string description;
  std::string type;  // "str", "int", "float" or "bool"
  bool optional = false;
  std::optional<std::string> unit;
  std::optional<std::string> unset;
  std::optional<std::string> rule;  // of a number
  Named choices;
  py::object default_value;
};

template <class T>
constexpr bool kIsOptional = false;
template <class T>
constexpr bool kIsOptional<std::optional<T>> = true;

template <class E>
Named names_of() {
  Named names;
  for (const auto& row : EnumTraits<E>::kTable) names.emplace_back(row.name, row.description);
  return names;
}

template <class E, class Get>
void def_choice(py::class_<SolveOptions>& c, const OptionFacts& facts, const Get& get) {
  c.def_property(
      facts.name,
      [get](const SolveOptions& o) { return std::string(enum_name(get(o))); },
      [get](SolveOptions& o, const std::string& text) { get(o) = parse_enum<E>(text); },
      facts.description);
}

// Options keep a table, and with it what Python has made of it.
void def_loss(py::class_<SolveOptions>& c, const OptionFacts& facts) {
  c.def_property(
      facts.name,
      [](const SolveOptions& o) {
        if (o.loss_table) return NamedLoss(std::const_pointer_cast<LossTable>(o.loss_table));
        return NamedLoss(std::string(enum_name(o.loss)));
      },
      py::cpp_function(
          [](SolveOptions& o, const NamedLoss& named) { set_loss(named, o.loss, o.loss_table); },
          py::keep_alive<1, 2>()),
      facts.description);
}

template <class T, class Get>
void def_value(py::class_<SolveOptions>& c, const OptionFacts& facts, const Get& get) {
  c.def_property(
      facts.name,
      [get](const SolveOptions& o) -> T { return get(o); },
      [get](SolveOptions& o, T value) { get(o) = value; },
      facts.description);
}

// A number, or the text that stands for none.
template <class Get>
void def_number_or_text(py::class_<SolveOptions>& c, const OptionFacts& facts, const Get& get) {
  using Value = std::variant<double, std::string>;
  const std::string unset = facts.unset;
  const std::string rule = "must be a number of " + std::string(facts.unit) + " or '" + unset + "'";
  c.def_property(
      facts.name,
      [get, unset](const SolveOptions& o) { return get(o) ? Value(*get(o)) : Value(unset); },
      [get, unset, rule, name = facts.name](SolveOptions& o, const Value& value) {
        const auto* text = std::get_if<std::string>(&value);
        if (text != nullptr && *text != unset)
          throw InvalidArgument(std::string(name) + " = '" + *text + "': " + rule);
        get(o) = text == nullptr ? std::optional(std::get<double>(value)) : std::nullopt;
      },
      facts.description);
}

template <class T>
const char* python_type() {
  if (std::is_same_v<T, bool>) return "bool";
  return std::is_integral_v<T> ? "int" : "float";
}

template <class Get>
Option bind_option(py::class_<SolveOptions>& c, const OptionFacts& facts, const Get& get) {
  using T = std::remove_cvref_t<decltype(get(std::declval<SolveOptions&>()))>;
  Option option;
  option.name = facts.name;
  option.description = facts.description;
  if (facts.unit != nullptr) option.unit = facts.unit;
  if constexpr (std::is_enum_v<T>) {
    if constexpr (std::is_same_v<T, LossKind>) {
      def_loss(c, facts);
    } else {
      def_choice<T>(c, facts, get);
    }
    option.type = "str";
    option.choices = names_of<T>();
  } else if constexpr (kIsOptional<T>) {
    if (facts.unset != nullptr) {
      def_number_or_text(c, facts, get);
      option.unset = facts.unset;
    } else {
      def_value<T>(c, facts, get);
    }
    option.type = python_type<typename T::value_type>();
    option.optional = true;
  } else {
    def_value<T>(c, facts, get);
    option.type = python_type<T>();
  }
  if (option.type == "int" || option.type == "float") option.rule = facts.rule.text;
  option.default_value = py::cast(SolveOptions{}).attr(facts.name);
  return option;
}

}  // namespace

void bind_options(py::module_& m) {
  py::class_<Option>(m, "SolveOption", "What is known of an option of a solve.")
      .def_readonly("name", &Option::name)
      .def_readonly("description", &Option::description, "What it means, without a full stop.")
      .def_readonly("type", &Option::type, "'str', 'int', 'float' or 'bool'.")
      .def_readonly("optional", &Option::optional, "Whether it may have no value.")
      .def_readonly("unit", &Option::unit)
      .def_readonly("unset", &Option::unset, "The text for no value; None: None.")
      .def_readonly("rule", &Option::rule, "What a number must be, such as 'at least 0'.")
      .def_readonly("choices", &Option::choices, "Names and what they mean, if it has choices.")
      .def_readonly("default", &Option::default_value);
  py::class_<SolveOptions> c(
      m, "SolveOptions", "Options of a solve, with the defaults of the core.");
  c.def(py::init<>());
  c.def("validate",
        &SolveOptions::validate,
        "Raise InvalidArgument naming every option out of its range.");
  py::list options;
  ba::for_each_option([&](const OptionFacts& facts, const auto& get) {
    options.append(py::cast(bind_option(c, facts, get)));
  });
  m.attr("SOLVE_OPTIONS") = py::tuple(options);
}

}  // namespace sfmcpp::bindings
