#include "host_sim/web/server.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "host_sim/error.hpp"

namespace esmc::host {

std::string make_token() {
  std::array<std::uint8_t, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw RunError("the operating system gives no random bytes for a token");
  }
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

bool same_token(std::string_view given, std::string_view token) {
  if (given.size() != token.size()) return false;
  unsigned different = 0;
  for (std::size_t i = 0; i < token.size(); ++i) {
    different |=
        static_cast<unsigned char>(given[i]) ^ static_cast<unsigned>(static_cast<unsigned char>(token[i]));
  }
  return different == 0;
}

bool own_host(std::string_view host, int port) {
  const std::size_t colon = std::min(host.rfind(':'), host.size());
  const std::string_view name = host.substr(0, colon);
  return (name == "127.0.0.1" || name == "localhost") &&
         host.substr(colon) == std::string(":").append(std::to_string(port));
}

bool own_origin(std::string_view origin, int port) {
  constexpr std::string_view scheme = "http://";
  return origin.starts_with(scheme) && own_host(origin.substr(scheme.size()), port);
}

ServerOptions page_options(int port, const std::string& name, std::string_view html, std::string_view css,
                           std::string_view js) {
  ServerOptions o;
  o.port = port;
  o.token = make_token();
  std::string page(html);
  constexpr std::string_view place = "{{token}}";
  for (std::size_t at = 0; (at = page.find(place, at)) != std::string::npos;)
    page.replace(at, place.size(), o.token);
  o.files["/"] = {"text/html; charset=utf-8", std::move(page)};
  o.files["/" + name + ".css"] = {"text/css; charset=utf-8", std::string(css)};
  o.files["/" + name + ".js"] = {"text/javascript; charset=utf-8", std::string(js)};
  return o;
}

}  // namespace esmc::host
