#include "host_sim/web/server.hpp"

#include <libwebsockets.h>

#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

constexpr lws_usec_t period_us = 20'000;
constexpr unsigned timeout_s = 5;  ///< of a request, and of sending

/// Per connection; libwebsockets allocates it.
struct Connection {
  Client* client;
  std::string* received;  ///< parts of a message so far
  const Served* file;
  std::size_t sent;
  Served* made;  ///< for this connection; `file` points to it
};

class LwsServer final : public Server {
 public:
  LwsServer(const ServerOptions& options, Service& service) : options_(options), service_(service) {
    lws_set_log_level(0, nullptr);
    protocols_[0] = {"esmc", &LwsServer::callback, sizeof(Connection), 4096, 0, this, 0};
    lws_context_creation_info info{};
    info.iface = "127.0.0.1";
    info.port = options.port;
    info.protocols = protocols_.data();
    info.options = LWS_SERVER_OPTION_DISABLE_IPV6 | LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND |
                   LWS_SERVER_OPTION_SKIP_SERVER_CANONICAL_NAME;
    info.gid = static_cast<decltype(info.gid)>(-1);
    info.uid = static_cast<decltype(info.uid)>(-1);
    info.max_http_header_data = 4096;
    info.max_http_header_pool = connections_max;
    info.fd_limit_per_thread = connections_max + 8;  // the listening socket, the library's own
    info.timeout_secs = info.timeout_secs_ah_idle = timeout_s;
    info.keepalive_timeout = static_cast<int>(timeout_s);
    info.server_string = "esmc";
    info.user = this;
    context_ = lws_create_context(&info);
    lws_vhost* host = context_ != nullptr ? lws_get_vhost_by_name(context_, "default") : nullptr;
    port_ = host != nullptr ? lws_get_vhost_listen_port(host) : 0;
    if (port_ <= 0) {
      if (context_ != nullptr) lws_context_destroy(context_);
      throw InputError("", "--port " + std::to_string(options.port) +
                               ": cannot listen there on 127.0.0.1; 0 takes a free one");
    }
  }
  ~LwsServer() override { lws_context_destroy(context_); }
  LwsServer(const LwsServer&) = delete;
  LwsServer& operator=(const LwsServer&) = delete;

  [[nodiscard]] int port() const override { return port_; }
  [[nodiscard]] ServerCounts counts() const override { return counts_; }
  void run(const std::stop_token& stop) override {
    timer_.server = this;
    lws_sul_schedule(context_, 0, &timer_.entry, &LwsServer::on_timer, period_us);
    while (!stop.stop_requested() && lws_service(context_, 0) >= 0) {
    }
    lws_sul_cancel(&timer_.entry);
  }

 private:
  /// The library passes its entry back; the server follows it in memory.
  struct Timer {
    lws_sorted_usec_list_t entry{};
    LwsServer* server = nullptr;
  };
  static_assert(offsetof(Timer, entry) == 0);

  static void on_timer(lws_sorted_usec_list_t* entry) {
    LwsServer& s = *reinterpret_cast<Timer*>(entry)->server;  // NOLINT(*-reinterpret-cast): its first member
    s.service_.on_timer();
    lws_callback_on_writable_all_protocol(s.context_, s.protocols_.data());
    lws_sul_schedule(s.context_, 0, entry, &LwsServer::on_timer, period_us);
  }

  static int callback(lws* wsi, lws_callback_reasons reason, void* user, void* in, std::size_t length) {
    auto* s = static_cast<LwsServer*>(lws_context_user(lws_get_context(wsi)));
    auto* c = static_cast<Connection*>(user);
    try {
      switch (reason) {
        case LWS_CALLBACK_HTTP:
          return s->serve(wsi, *c, static_cast<const char*>(in));
        case LWS_CALLBACK_HTTP_WRITEABLE:
          return c != nullptr && c->file != nullptr ? send_file(wsi, *c) : 0;
        case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE:
          return s->upgrade(wsi, static_cast<const char*>(in));
        case LWS_CALLBACK_ESTABLISHED:
          *c = {s->service_.on_connect().release(), new std::string, nullptr, 0, nullptr};
          ++s->clients_;
          ++s->counts_.pages;
          lws_callback_on_writable(wsi);
          return 0;
        case LWS_CALLBACK_SERVER_WRITEABLE:
          return send_next(wsi, *c->client);
        case LWS_CALLBACK_RECEIVE:
          return s->receive(wsi, *c, {static_cast<const char*>(in), length});
        case LWS_CALLBACK_CLOSED:
          if (c->client != nullptr) --s->clients_;
          delete c->client;
          delete c->received;
          return 0;
        case LWS_CALLBACK_CLOSED_HTTP:
        case LWS_CALLBACK_HTTP_DROP_PROTOCOL:
          if (c != nullptr) delete std::exchange(c->made, nullptr);
          return 0;
        case LWS_CALLBACK_HTTP_BODY:
        case LWS_CALLBACK_HTTP_BODY_COMPLETION:
          return -1;
        default:
          return 0;
      }
    } catch (const std::exception&) {
      return -1;  // of one connection; exceptions cannot pass the library
    }
  }

  static std::string header(lws* wsi, lws_token_indexes which) {
    std::array<char, 256> text{};
    const int n = lws_hdr_copy(wsi, text.data(), static_cast<int>(text.size()), which);
    return n > 0 ? std::string(text.data(), static_cast<std::size_t>(n)) : std::string();
  }
  /// HTTP status of a refusal; 0: accepted. `page`: a WebSocket, which always has an origin.
  [[nodiscard]] unsigned refusal(lws* wsi, bool page) const {
    const bool has_origin = page || lws_hdr_total_length(wsi, WSI_TOKEN_ORIGIN) > 0;
    std::array<char, 256> text{};
    const char* token = lws_get_urlarg_by_name(wsi, "token=", text.data(), static_cast<int>(text.size()));
    const bool accepted = own_host(header(wsi, WSI_TOKEN_HOST), port_) &&
                          (!has_origin || own_origin(header(wsi, WSI_TOKEN_ORIGIN), port_)) &&
                          token != nullptr && same_token(token, options_.token);
    return accepted ? 0U : static_cast<unsigned>(HTTP_STATUS_FORBIDDEN);
  }
  int refuse(lws* wsi, unsigned status, const char* why) {
    ++counts_.refused;
    (void)lws_return_http_status(wsi, status, why);
    return -1;
  }

  int serve(lws* wsi, Connection& c, const char* path) {
    delete c.made;  // of the request before on this connection
    c = {};
    if (lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) <= 0)
      return refuse(wsi, HTTP_STATUS_METHOD_NOT_ALLOWED, "GET only");
    if (const unsigned status = refusal(wsi, false))
      return refuse(wsi, status, "the URL that esmc printed has the token, and only that opens the page");
    const auto file = options_.files.find(std::string_view(path));
    if (file == options_.files.end()) c.made = service_.download(path).release();
    c.file = file != options_.files.end() ? &file->second : c.made;
    if (c.file == nullptr) return refuse(wsi, HTTP_STATUS_NOT_FOUND, "no such file");
    std::array<unsigned char, LWS_PRE + 2048> buffer{};
    unsigned char *at = buffer.data() + LWS_PRE, *const begin = at,
                  *const end = buffer.data() + buffer.size() - 1;
    if (lws_add_http_common_headers(wsi, HTTP_STATUS_OK, c.file->type, c.file->body.size(), &at, end) != 0)
      return -1;
    const auto bytes = [](const char* text) {
      return reinterpret_cast<const unsigned char*>(text);  // NOLINT(*-reinterpret-cast)
    };
    for (const auto& [name, value] : headers) {
      const auto length = static_cast<int>(std::strlen(value));
      if (lws_add_http_header_by_name(wsi, bytes(name), bytes(value), length, &at, end) != 0) return -1;
    }
    if (lws_finalize_write_http_header(wsi, begin, &at, end) != 0) return -1;
    lws_callback_on_writable(wsi);
    return 0;
  }
  static constexpr std::array<std::pair<const char*, const char*>, 6> headers{{
      // Nothing from elsewhere, nothing inline, no frame around it.
      {"content-security-policy:",
       "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
       "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
      {"referrer-policy:", "no-referrer"},  // the URL has the token
      {"cache-control:", "no-store"},
      {"x-content-type-options:", "nosniff"},
      {"cross-origin-resource-policy:", "same-origin"},
      {"cross-origin-opener-policy:", "same-origin"},
  }};

  static int send_file(lws* wsi, Connection& c) {
    constexpr std::size_t portion = 4096;
    std::array<unsigned char, LWS_PRE + portion> buffer{};
    const std::size_t n = std::min(portion, c.file->body.size() - c.sent);
    std::memcpy(buffer.data() + LWS_PRE, c.file->body.data() + c.sent, n);
    const bool last = c.sent + n == c.file->body.size();
    if (lws_write(wsi, buffer.data() + LWS_PRE, n, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) <
        static_cast<int>(n))
      return -1;
    c.sent += n;
    if (!last) {
      lws_callback_on_writable(wsi);
      return 0;
    }
    c.file = nullptr;
    delete std::exchange(c.made, nullptr);
    return lws_http_transaction_completed(wsi) != 0 ? -1 : 0;
  }

  /// Positive: refused with a status of our own.
  int upgrade(lws* wsi, const char* to) {
    if (to == nullptr || std::strcmp(to, "websocket") != 0) return -1;
    std::array<char, 64> path{};
    (void)lws_hdr_copy(wsi, path.data(), static_cast<int>(path.size()), WSI_TOKEN_GET_URI);
    unsigned status = refusal(wsi, true);
    if (status == 0 && std::strcmp(path.data(), "/bench") != 0) status = HTTP_STATUS_NOT_FOUND;
    if (status == 0 && clients_ >= clients_max) status = HTTP_STATUS_SERVICE_UNAVAILABLE;
    if (status == 0) return 0;
    (void)refuse(wsi, status, "");
    return 1;
  }

  static int send_next(lws* wsi, Client& client) {
    const std::string text = client.next();
    if (text.empty()) return 0;
    std::vector<unsigned char> buffer(LWS_PRE + text.size());
    std::memcpy(buffer.data() + LWS_PRE, text.data(), text.size());
    const int sent = lws_write(wsi, buffer.data() + LWS_PRE, text.size(), LWS_WRITE_TEXT);
    return sent < static_cast<int>(text.size()) ? -1 : 0;
  }

  int receive(lws* wsi, Connection& c, std::string_view part) {
    if (c.received->size() + part.size() + lws_remaining_packet_payload(wsi) > message_max) {
      ++counts_.too_long;
      lws_close_reason(wsi, LWS_CLOSE_STATUS_MESSAGE_TOO_LARGE, nullptr, 0);
      return -1;
    }
    c.received->append(part);
    if (lws_is_final_fragment(wsi) == 0 || lws_remaining_packet_payload(wsi) > 0) return 0;
    ++counts_.messages;
    c.client->on_message(*c.received);
    c.received->clear();
    return 0;
  }

  ServerOptions options_;
  Service& service_;
  std::array<lws_protocols, 2> protocols_{};
  lws_context* context_ = nullptr;
  int port_ = 0;
  std::size_t clients_ = 0;
  ServerCounts counts_;
  Timer timer_;
};

}  // namespace

std::unique_ptr<Server> open_server(const ServerOptions& options, Service& service) {
  return std::make_unique<LwsServer>(options, service);
}

}  // namespace esmc::host
