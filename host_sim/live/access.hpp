#pragma once
/// Access to a server on this machine: by its token, from a page of its own.
///
/// A browser lets any page send requests to 127.0.0.1. Three checks refuse them: the token, which only the
/// terminal shows; `Origin` of a WebSocket, which a page cannot choose; and `Host`, which names another
/// machine when a foreign name resolves to this one (DNS rebinding).

#include <string>
#include <string_view>

namespace esmc::host {

/// 128 bits of the operating system's entropy in hexadecimal. Throws RunError where there is none.
std::string make_token();

/// Whether both are equal; in the same time for all texts of one length: digits cannot be guessed one by one.
[[nodiscard]] bool same_token(std::string_view given, std::string_view token);

/// Whether a Host header is 127.0.0.1:PORT or localhost:PORT.
[[nodiscard]] bool own_host(std::string_view host, int port);
/// Whether an Origin header is http://127.0.0.1:PORT or http://localhost:PORT.
[[nodiscard]] bool own_origin(std::string_view origin, int port);

}  // namespace esmc::host
