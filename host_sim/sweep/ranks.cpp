#include "host_sim/sweep/ranks.hpp"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

/// As OpenMPI, MPICH and Intel's mpirun, and Slurm's launcher say it.
bool started_together() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS"}) {
    const char* value = std::getenv(name);  // before there are threads
    if (value != nullptr && std::strtol(value, nullptr, 10) > 1) return true;
  }
  return false;
}

}  // namespace

std::unique_ptr<Ranks> join_ranks() {
  if (!started_together()) return nullptr;
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  void* module = ::dlopen((folder / "esmc_mpi.so").c_str(), RTLD_NOW | RTLD_GLOBAL);
  if (module == nullptr) {
    throw RunError(
        "mpirun has started several processes, but this program was built without MPI: install "
        "libopenmpi-dev and build again");
  }
  using Join = Ranks* (*)();
  auto* join = reinterpret_cast<Join>(::dlsym(module, "esmc_join_ranks"));  // NOLINT(*-reinterpret-cast)
  if (join == nullptr) throw RunError("esmc_mpi.so is not of this program");
  return std::unique_ptr<Ranks>(join());
}

}  // namespace esmc::host
