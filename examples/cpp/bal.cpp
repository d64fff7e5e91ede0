// Reads a bundle adjustment problem in the large (BAL; grail.cs.washington.edu/projects/bal), as
// plain text, and solves it: ./bal problem-49-7776-pre.txt
#include <cmath>
#include <fstream>
#include <iostream>
#include <vector>

#include <sfmcpp/ba/solve.hpp>
#include <sfmcpp/core/error.hpp>

namespace {

struct Bal {
  std::vector<double> cameras, intrinsics, points, pixels;
  std::vector<int> intrinsics_index, camera_index, point_index;
};

// BAL has camera_from_world, x_camera = R x + t, and looks along -z with y up. Ours is
// world_from_camera, [Rᵀ | -Rᵀ t], and looks along z with y down: the second and third row of R and
// t change signs, as does v.
void append_camera(const double* bal, Bal& out) {
  const double angle = std::hypot(bal[0], bal[1], bal[2]);
  const double a = angle > 0 ? std::sin(angle) / angle : 1.0;
  const double b = angle > 0 ? (1 - std::cos(angle)) / (angle * angle) : 0.5;
  const double x = bal[0], y = bal[1], z = bal[2];
  const double r[3][3] = {{1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y},
                          {b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x},
                          {b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)}};
  for (int i = 0; i < 3; ++i) {
    const double centre = -(r[0][i] * bal[3] + r[1][i] * bal[4] + r[2][i] * bal[5]);
    out.cameras.insert(out.cameras.end(), {r[0][i], -r[1][i], -r[2][i], centre});
  }
  out.intrinsics.insert(out.intrinsics.end(), {bal[6], bal[7], bal[8]});  // f, k1, k2
  out.intrinsics_index.push_back(static_cast<int>(out.intrinsics_index.size()));
}

bool read(const char* path, Bal& out) {
  std::ifstream file(path);
  int cameras = 0, points = 0, observations = 0;
  file >> cameras >> points >> observations;
  for (int k = 0; k < observations && file; ++k) {
    int camera = 0, point = 0;
    double u = 0.0, v = 0.0;
    file >> camera >> point >> u >> v;
    out.camera_index.push_back(camera);
    out.point_index.push_back(point);
    out.pixels.insert(out.pixels.end(), {u, -v});
  }
  for (int i = 0; i < cameras && file; ++i) {
    double bal[9] = {};
    for (double& number : bal) file >> number;
    append_camera(bal, out);
  }
  out.points.resize(file ? 3 * static_cast<std::size_t>(points) : 0);
  for (double& number : out.points) file >> number;
  return observations > 0 && !file.fail();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: bal FILE, a problem of BAL as plain text\n";
    return 2;
  }
  Bal bal;
  if (!read(argv[1], bal)) {
    std::cerr << argv[1] << ": cannot be read as a problem of BAL in plain text\n";
    return 2;
  }
  const sfmcpp::ba::Problem problem{.camera_model = sfmcpp::CameraModelId::kBal,
                                    .cameras = bal.cameras,
                                    .intrinsics = bal.intrinsics,
                                    .points = bal.points,
                                    .intrinsics_index = bal.intrinsics_index,
                                    .camera_index = bal.camera_index,
                                    .point_index = bal.point_index,
                                    .pixels = bal.pixels};
  const sfmcpp::ba::SolveOptions options;  // squared residuals, all intrinsics free
  sfmcpp::optim::Events events;
  events.on_iteration = [](const sfmcpp::optim::Iteration& iteration) {
    std::cout << iteration.number << "  cost " << iteration.cost << "\n";
    return sfmcpp::optim::Signal::kContinue;
  };
  try {
    // Cameras, intrinsics and points: first the start, then the result.
    sfmcpp::optim::State state = sfmcpp::ba::state_of(problem);
    const sfmcpp::ba::SolveSummary summary = sfmcpp::ba::solve(problem, options, events, state);
    const auto& [initial_cost, final_cost, termination, message, iterations] = summary.minimizer;
    std::cout << initial_cost << " -> " << final_cost << ": " << message << "\n"
              << "focal length of the first camera: " << state.intrinsics[0] << " px\n";
  } catch (const sfmcpp::InvalidArgument& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
  return 0;
}
