#include "sfmcpp/core/machine.hpp"

#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "sfmcpp/core/parallel.hpp"

#if defined(__linux__)
#include <sched.h>
#endif

namespace sfmcpp::machine_test {
namespace {

using Files = std::map<std::string, std::string>;

// Files of a system, in a folder of their own.
class System {
 public:
  explicit System(const Files& files) {
    std::filesystem::remove_all(root_);
    for (const auto& [name, content] : files) {
      const std::filesystem::path path = root_ / name;
      std::filesystem::create_directories(path.parent_path());
      std::ofstream(path) << content;
    }
  }
  System(const System&) = delete;
  System& operator=(const System&) = delete;
  ~System() { std::filesystem::remove_all(root_); }
  std::string root() const { return root_.string(); }

 private:
  std::filesystem::path root_ =
      std::filesystem::path(testing::TempDir()) / ("sfmcpp_system_" + std::to_string(getpid()));
};

double memory_of(const Files& files) { return memory_limit_bytes(System(files).root()); }
int cores_of(const Files& files) { return usable_cores(System(files).root()); }

TEST(Machine, MemoryIsThatOfTheTightestGroupAroundThisProcess) {
  const std::string group = "0::/slurm/job_7/step_0\n";
  EXPECT_EQ(memory_of({{"proc/self/cgroup", group},
                       {"sys/fs/cgroup/slurm/job_7/step_0/memory.max", "max\n"},
                       {"sys/fs/cgroup/slurm/job_7/memory.max", "1000000\n"},
                       {"sys/fs/cgroup/slurm/memory.max", "2000000\n"}}),
            1e6);
  EXPECT_EQ(memory_of({{"proc/self/cgroup", group},
                       {"sys/fs/cgroup/slurm/job_7/step_0/memory.max", "3000000\n"},
                       {"sys/fs/cgroup/slurm/job_7/memory.max", "4000000\n"}}),
            3e6);
}

TEST(Machine, MemoryOfGroupsOfVersionOneIsFound) {
  EXPECT_EQ(memory_of({{"proc/self/cgroup", "5:devices:/x\n4:memory:/job\n0::/\n"},
                       {"sys/fs/cgroup/memory/job/memory.limit_in_bytes", "5000000\n"},
                       {"sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"}}),
            5e6);
}

TEST(Machine, AContainerSeesItsGroupAsTheMountPoint) {
  const Files files{{"sys/fs/cgroup/memory.max", "6000000\n"}, {"sys/fs/cgroup/cpu.max", "1 1\n"}};
  EXPECT_EQ(memory_of(files), 6e6);
  EXPECT_EQ(cores_of(files), 1);
}

TEST(Machine, WithoutGroupsAllMemoryAndCoresAreLeft) {
  const double memory = memory_of({});
  EXPECT_GT(memory, 1e7);
  EXPECT_EQ(memory_of({{"proc/self/cgroup", "0::no path\nno line\n"}}), memory);
  EXPECT_GE(cores_of({}), 1);
  EXPECT_EQ(cores_of({{"sys/fs/cgroup/cpu.max", "max 100000\n"}}), cores_of({}));
}

TEST(Machine, AShareOfACoreIsOneCore) {
  EXPECT_EQ(cores_of({{"proc/self/cgroup", "0::/pod\n"},
                      {"sys/fs/cgroup/pod/cpu.max", "20000 100000\n"}}),
            1);
  EXPECT_EQ(cores_of({{"proc/self/cgroup", "3:cpu,cpuacct:/\n3:cpu:/pod\n"},
                      {"sys/fs/cgroup/cpu/pod/cpu.cfs_quota_us", "50000\n"},
                      {"sys/fs/cgroup/cpu/pod/cpu.cfs_period_us", "100000\n"}}),
            1);
  EXPECT_EQ(cores_of({{"sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n"},
                      {"sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n"}}),
            cores_of({}));
}

#if defined(__linux__)
TEST(Machine, ThreadsAreNoMoreThanTheCoresThatAThreadIsBoundTo) {
  constexpr long kManyObservations = 100'000'000;
  int found = 0, threads = 0;
  std::thread([&] {
    cpu_set_t all, one;
    CPU_ZERO(&one);
    sched_getaffinity(0, sizeof all, &all);
    for (int core = 0; CPU_COUNT(&one) == 0; ++core) {
      if (CPU_ISSET(core, &all)) CPU_SET(core, &one);
    }
    sched_setaffinity(0, sizeof one, &one);
    found = usable_cores();
    threads = resolve_num_threads(0, kManyObservations);
  }).join();
  EXPECT_EQ(found, 1);
  EXPECT_EQ(threads, 1);
  EXPECT_EQ(resolve_num_threads(3, kManyObservations), 3);
}
#endif

}  // namespace
}  // namespace sfmcpp::machine_test
