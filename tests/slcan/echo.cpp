/// Sends every frame back that it hears, as it heard it. usage: slcan_echo ENDPOINT BIT_RATE

#include <poll.h>

#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "hal/linux/byte_port.hpp"

int main(int argc, char** argv) {
  using namespace esmc::hal;
  if (argc != 3) return 2;
  std::string why;
  SerialPort port = SerialPort::open(argv[1], why);
  if (!port.is_open()) {
    std::fprintf(stderr, "%s: %s\n", argv[1], why.c_str());
    return 2;
  }
  SlcanAdapter adapter(std::move(port), slcan_speed(std::atoi(argv[2])));
  CanFrame f;
  while (!adapter.port().gone()) {
    while (adapter.try_receive(f)) {
      if (f.id == 0x7FF && !f.extended && f.remote) return 0;
      if (adapter.try_send(f) != SendStatus::ok) return 1;
    }
    pollfd p{adapter.port().descriptor(), POLLIN, 0};
    if (!adapter.port().has_input() && !adapter.port().gone() && ::poll(&p, 1, 30'000) == 0) return 1;
  }
  return 0;
}
