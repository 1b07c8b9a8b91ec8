#include "host_sim/error.hpp"
#include "host_sim/web/server.hpp"

namespace esmc::host {

std::unique_ptr<Server> open_server(const ServerOptions&, Service&) {
  throw InputError(
      "",
      "this esmc was built without a web server: install libwebsockets-dev (host_sim/setup live) "
      "and build again");
}

}  // namespace esmc::host
