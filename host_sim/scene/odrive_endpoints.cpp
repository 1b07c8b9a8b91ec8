#include "host_sim/scene/odrive_endpoints.hpp"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"

namespace esmc::host {
namespace {

using drive::odrive::ValueType;
using Json = nlohmann::ordered_json;

constexpr std::uintmax_t bytes_max = 16U << 20U;  // the vendor's have some hundred kilobytes

bool fits(ValueType type, const std::string& name) {
  if (type == ValueType::u8) return name == "bool" || name == "uint8";
  return name == (type == ValueType::u32 ? "uint32" : "float");
}

/// "0.6.10", with anything but a digit after it.
bool parse_version(const std::string& text, std::array<std::uint8_t, 3>& out) {
  const char* at = text.data();
  const char* const last = text.data() + text.size();
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto [end, error] = std::from_chars(at, last, out[i]);
    if (error != std::errc()) return false;
    if (i + 1 < out.size() && (end == last || *end != '.')) return false;
    at = end + 1;
  }
  return true;
}

}  // namespace

OdriveEndpoints read_odrive_endpoints(const std::string& where, const std::string& path, std::string& text) {
  const auto fail = [&](const std::string& what) { throw InputError(where, "'drives.endpoints' " + what); };
  std::error_code error;
  if (path.find('\0') != std::string::npos) fail("must be a file name, without NUL");
  if (!std::filesystem::is_regular_file(path, error)) fail("names no regular file: " + path);
  if (std::filesystem::file_size(path, error) > bytes_max) fail("names a file of more than 16 MiB: " + path);
  std::ifstream file(path, std::ios::binary);
  if (!file) fail("names a file that cannot be read: " + path);
  text.assign(std::istreambuf_iterator<char>(file), {});
  const Json j = parse_json(text, false);
  if (!j.is_object() || !j.contains("endpoints") || !j["endpoints"].is_object()) {
    fail(
        "names a file that is not the vendor's flat_endpoints.json (an object with fw_version and "
        "endpoints): " +
        path);
  }
  OdriveEndpoints out;
  if (!j.contains("fw_version") || !j["fw_version"].is_string() ||
      !parse_version(j["fw_version"].get<std::string>(), out.firmware)) {
    fail("names a file without fw_version = \"MAJOR.MINOR.REVISION\": " + path);
  }
  for (const OdriveValueName& v : odrive_values) {
    if (!j["endpoints"].contains(v.path)) continue;
    const Json& e = j["endpoints"][v.path];
    const bool whole = e.is_object() && e.contains("id") && e["id"].is_number_unsigned() &&
                       e["id"] < 0x10000 && e.contains("type") && e["type"].is_string();
    if (!whole)
      fail(fmt::format("names a file whose {} has no id from 0 to 65535 and type: {}", v.path, path));
    if (!fits(v.type, e["type"].get<std::string>()))
      fail(fmt::format("names a file whose {} has another type than this program knows: {}", v.path, path));
    out.list.push_back({v.value, e["id"].get<std::uint16_t>(), v.type});
  }
  return out;
}

}  // namespace esmc::host
