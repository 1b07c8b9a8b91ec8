#pragma once
/// The processes of a sweep over several machines. MPI is in a module that is loaded only where `mpirun` has
/// started the program; without mpirun it need not be installed.

#include <memory>
#include <string>

namespace esmc::host {

class Ranks {
 public:
  virtual ~Ranks() = default;
  [[nodiscard]] virtual int rank() const = 0;  ///< of this process, 0 .. size() - 1
  [[nodiscard]] virtual int size() const = 0;
  virtual void send(int to, const std::string& bytes) = 0;  ///< a message to rank `to`
  /// Waits for the next message; returns the rank that sent it. Without `wait`: -1 where there is none yet.
  [[nodiscard]] virtual int receive(std::string& bytes, bool wait) = 0;

 protected:
  Ranks() = default;
  Ranks(const Ranks&) = default;
  Ranks& operator=(const Ranks&) = default;
};

/// Joins the processes that mpirun has started; null: this one was started alone. Throws RunError where there
/// are several and MPI is not installed.
[[nodiscard]] std::unique_ptr<Ranks> join_ranks();

}  // namespace esmc::host
