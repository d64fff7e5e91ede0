#include "bal_problem.h"

#include <cstdio>
#include <memory>
#include <stdexcept>

namespace {

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

File Open(const std::string& path, const char* mode) {
  File file(std::fopen(path.c_str(), mode), &std::fclose);
  if (!file) throw std::runtime_error(path + ": cannot be opened");
  return file;
}

void Require(bool complete, const std::string& path, const char* section) {
  if (!complete) throw std::runtime_error(path + ": ends or is garbled in its " + section);
}

template <std::size_t N>
bool ReadBlock(std::FILE* file, std::array<double, N>& block) {
  for (double& value : block) {
    if (std::fscanf(file, "%lf", &value) != 1) return false;
  }
  return true;
}

bool ReadObservation(std::FILE* file, Observation& o, const BalProblem& problem) {
  if (std::fscanf(file, "%d %d %lf %lf", &o.camera, &o.point, &o.u_px, &o.v_px) != 4) return false;
  const int num_cameras = static_cast<int>(problem.cameras.size());
  const int num_points = static_cast<int>(problem.points.size());
  return o.camera >= 0 && o.camera < num_cameras && o.point >= 0 && o.point < num_points;
}

}  // namespace

BalProblem ReadBal(const std::string& path) {
  const File file = Open(path, "r");
  int num_cameras = 0, num_points = 0, num_observations = 0;
  const int read =
      std::fscanf(file.get(), "%d %d %d", &num_cameras, &num_points, &num_observations);
  Require(read == 3 && num_cameras > 0 && num_points > 0 && num_observations > 0, path, "header");
  BalProblem problem;
  problem.observations.resize(num_observations);
  problem.cameras.resize(num_cameras);
  problem.points.resize(num_points);
  for (Observation& o : problem.observations) {
    Require(ReadObservation(file.get(), o, problem), path, "observations");
  }
  for (auto& camera : problem.cameras) Require(ReadBlock(file.get(), camera), path, "cameras");
  for (auto& point : problem.points) Require(ReadBlock(file.get(), point), path, "points");
  return problem;
}

void WriteState(const BalProblem& problem, const std::string& path) {
  const File file = Open(path, "wb");
  const auto write = [&](const auto& blocks) {
    return std::fwrite(blocks.data(), sizeof(blocks[0]), blocks.size(), file.get()) ==
           blocks.size();
  };
  if (!write(problem.cameras) || !write(problem.points)) {
    throw std::runtime_error(path + ": cannot be written");
  }
}
