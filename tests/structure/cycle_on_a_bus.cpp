/// `Cycle::receive` and `Cycle::tick` are templates over the bus, so the control archive does not hold them.
/// Here they are compiled as a board compiles them, on a bus that is only declared, for the symbols to be
/// looked at.

#include "firmware/cycle/instances.hpp"

namespace esmc::structure {

struct OpaqueBus {
  hal::SendStatus try_send(const hal::CanFrame& f);
  bool try_receive(hal::CanFrame& f);
};

template <class M>
TickResult<M> whole_tick(OdriveCycle<M>& cycle, OpaqueBus& bus, Command command) {
  cycle.receive(bus);
  cycle.command(command);
  return cycle.tick(bus, cycle.complete());
}

template TickResult<FiveBar<double>> whole_tick(OdriveCycle<FiveBar<double>>&, OpaqueBus&, Command);
template TickResult<FiveBar<float>> whole_tick(OdriveCycle<FiveBar<float>>&, OpaqueBus&, Command);
template TickResult<Rr<double>> whole_tick(OdriveCycle<Rr<double>>&, OpaqueBus&, Command);
template TickResult<Rr<float>> whole_tick(OdriveCycle<Rr<float>>&, OpaqueBus&, Command);

}  // namespace esmc::structure
