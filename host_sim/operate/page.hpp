#pragma once
/// `esmc operate BUS SCENE --page`: the operator's page, another console over the same connection.

#include <nlohmann/json_fwd.hpp>

#include "host_sim/operate/console.hpp"

namespace esmc::host {

/// Prints the page's address and serves it until Ctrl-C; orders of a page are commands of `console`. The sign
/// of life is given only while the page that has the word answers. `port` 0: one that is free. Returns the
/// exit status 0. Throws InputError where the port is taken, and RunError when bus or controller are gone.
int run_page(Connection& link, Console& console, const Scene& scene, int port);

}  // namespace esmc::host
