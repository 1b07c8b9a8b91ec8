#pragma once
/// HTTP and WebSocket on the loopback interface, in the calling thread, by libwebsockets. It checks tokens
/// and origins; the service interprets the messages.

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>

namespace esmc::host {

// A browser lets any page send requests to 127.0.0.1. Three checks refuse them: the token, which only the
// terminal shows; `Origin` of a WebSocket, which a page cannot choose; and `Host`, which names another
// machine when a foreign name resolves to this one (DNS rebinding).

/// 128 bits of the operating system's entropy in hexadecimal. Throws RunError where there is none.
std::string make_token();

/// Whether both are equal; in the same time for all texts of one length: digits cannot be guessed one by one.
[[nodiscard]] bool same_token(std::string_view given, std::string_view token);

/// Whether a Host header is 127.0.0.1:PORT or localhost:PORT.
[[nodiscard]] bool own_host(std::string_view host, int port);
/// Whether an Origin header is http://127.0.0.1:PORT or http://localhost:PORT.
[[nodiscard]] bool own_origin(std::string_view origin, int port);

/// A file that a page may load.
struct Served {
  const char* type;  ///< as in Content-Type
  std::string body;
};

/// One page that is connected.
class Client {
 public:
  virtual ~Client() = default;
  /// The next message to the page; empty: none now. Called when the last one has been sent, so that a slow
  /// page gets fewer.
  [[nodiscard]] virtual std::string next() = 0;
  virtual void on_message(std::string_view message) = 0;  ///< of at most Server::message_max bytes
};

/// Answers the clients of a server, in its thread.
class Service {
 public:
  virtual ~Service() = default;
  [[nodiscard]] virtual std::unique_ptr<Client> on_connect() = 0;  ///< for a page that has connected
  /// Called about 50 times a second.
  virtual void on_timer() = 0;
  /// A file that is made when it is asked for, by its path; null: there is none.
  [[nodiscard]] virtual std::unique_ptr<Served> download(std::string_view path) {
    (void)path;
    return nullptr;
  }
};

/// A message that no page of ours sends.
struct Malformed {};

/// The latest of what pages are told, numbered from 0.
template <class T>
struct History {
  std::deque<T> list;
  std::uint64_t first = 0;  ///< number of the oldest
  void add(T x, std::size_t most) {
    list.push_back(std::move(x));
    if (list.size() <= most) return;
    list.pop_front();
    ++first;
  }
  [[nodiscard]] std::uint64_t end() const { return first + list.size(); }
  [[nodiscard]] const T& at(std::uint64_t number) const { return list[number - first]; }
};

struct ServerOptions {
  int port = 0;  ///< 0: one that is free
  std::string token;
  std::map<std::string, Served, std::less<>> files;  ///< by path; "/" is the page
};

/// Options for the page NAME.html with NAME.css and NAME.js, which have the new token at {{token}}.
ServerOptions page_options(int port, const std::string& name, std::string_view html, std::string_view css,
                           std::string_view js);

struct ServerCounts {
  std::uint64_t pages = 0, refused = 0, messages = 0, too_long = 0;
};

class Server {
 public:
  static constexpr std::size_t clients_max = 8;
  static constexpr std::size_t message_max = 64 * 1024;  ///< bytes, from a page
  static constexpr int connections_max = 64;

  virtual ~Server() = default;
  [[nodiscard]] virtual int port() const = 0;  ///< it listens to
  /// Serves until `stop`, which is read about 50 times a second.
  virtual void run(const std::stop_token& stop) = 0;
  [[nodiscard]] virtual ServerCounts counts() const = 0;
};

/// Opens a server on 127.0.0.1 that listens. Throws InputError where the port is taken, or where this program
/// was built without a web server. The service must outlive the server.
std::unique_ptr<Server> open_server(const ServerOptions& options, Service& service);

}  // namespace esmc::host
