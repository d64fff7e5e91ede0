// Solves one BAL file with Ceres and writes what happened:
//
//     ceres_driver FILE OUTCOME.json STATE.f64 [key=value ...]
//
// Keys: linear_solver, preconditioner, dense_library, explicit_schur, jacobian, threads,
// max_iterations, max_seconds, function_tolerance.
#include <cstdlib>
#include <iostream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>

#include <glog/logging.h>

#include "bal_problem.h"
#include "outcome.h"
#include "process_memory.h"
#include "reprojection.h"

namespace {

using Settings = std::map<std::string, std::string>;

Settings ParseSettings(int argc, char** argv) {
  Settings settings{{"linear_solver", "DENSE_SCHUR"},
                    {"preconditioner", "SCHUR_JACOBI"},
                    {"dense_library", "LAPACK"},
                    {"explicit_schur", "0"},
                    {"jacobian", "analytic"},
                    {"threads", "2"},
                    {"max_iterations", "50"},
                    {"max_seconds", "1e6"},
                    {"function_tolerance", "1e-6"}};
  for (int i = 4; i < argc; ++i) {
    const std::string argument = argv[i];
    const std::string key = argument.substr(0, argument.find('='));
    if (key.size() == argument.size() || settings.count(key) == 0) {
      throw std::runtime_error("argument " + argument +
                               ": must be one of the known key=value pairs");
    }
    settings[key] = argument.substr(key.size() + 1);
  }
  return settings;
}

ceres::Solver::Options MakeOptions(const Settings& settings) {
  ceres::Solver::Options options;
  if (!ceres::StringToLinearSolverType(settings.at("linear_solver"), &options.linear_solver_type) ||
      !ceres::StringToDenseLinearAlgebraLibraryType(settings.at("dense_library"),
                                                    &options.dense_linear_algebra_library_type) ||
      !ceres::StringToPreconditionerType(settings.at("preconditioner"),
                                         &options.preconditioner_type)) {
    throw std::runtime_error("linear_solver, preconditioner or dense_library: unknown to Ceres");
  }
  options.use_explicit_schur_complement = settings.at("explicit_schur") == "1";
  options.num_threads = std::stoi(settings.at("threads"));
  options.max_num_iterations = std::stoi(settings.at("max_iterations"));
  options.max_solver_time_in_seconds = std::stod(settings.at("max_seconds"));
  options.function_tolerance = std::stod(settings.at("function_tolerance"));
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.logging_type = ceres::SILENT;
  return options;
}

// Of those that are observed: no other is part of the problem.
std::shared_ptr<ceres::ParameterBlockOrdering> PointsFirst(BalProblem& bal) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const Observation& o : bal.observations) {
    ordering->AddElementToGroup(bal.points[o.point].data(), 0);
    ordering->AddElementToGroup(bal.cameras[o.camera].data(), 1);
  }
  return ordering;
}

void AddResiduals(BalProblem& bal, bool analytic, ceres::Problem& problem) {
  const auto create = analytic ? &AnalyticReprojection::Create : &AutoDiffReprojection::Create;
  for (const Observation& o : bal.observations) {
    problem.AddResidualBlock(
        create(o.u_px, o.v_px), nullptr, bal.cameras[o.camera].data(), bal.points[o.point].data());
  }
}

void Run(int argc, char** argv) {
  Memory memory{ResidentBytes(), 0, 0};
  const Settings settings = ParseSettings(argc, argv);
  BalProblem bal = ReadBal(argv[1]);
  memory.inputs_bytes = ResidentBytes();
  ResetPeak();

  ceres::Problem::Options problem_options;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  AddResiduals(bal, settings.at("jacobian") == "analytic", problem);
  ceres::Solver::Options options = MakeOptions(settings);
  options.linear_solver_ordering = PointsFirst(bal);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  memory.peak_bytes = PeakResidentBytes();
  if (summary.termination_type == ceres::FAILURE)
    throw std::runtime_error("Ceres: " + summary.message);
  WriteState(bal, argv[3]);
  WriteOutcome(summary, memory, argv[2]);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::cerr << "usage: ceres_driver FILE OUTCOME.json STATE.f64 [key=value ...]\n";
    return EXIT_FAILURE;
  }
  google::InitGoogleLogging(argv[0]);
  try {
    Run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "ceres_driver: " << error.what() << "\n";
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
