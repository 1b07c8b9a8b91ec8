#include "host_sim/error.hpp"
#include "host_sim/live/server.hpp"

namespace esmc::host {

std::unique_ptr<Server> open_server(const ServerOptions&, Service&) {
  throw InputError("",
                   "esmc live was built without its web server: install libwebsockets-dev (host_sim/setup "
                   "live) and build again");
}

}  // namespace esmc::host
