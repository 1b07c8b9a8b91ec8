#include "host_sim/operate/points.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

constexpr std::array spaces{"effector", "base_joints"};  // in the order of link::Space
constexpr std::size_t name_max = 32, points_max = 1000;

bool letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool good_name(const std::string& n) {
  return !n.empty() && n.size() <= name_max && letter(n.front()) && std::ranges::all_of(n, [](char c) {
    return letter(c) || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

Points::Point point_of(const toml::node& node, const std::string& file) {
  const toml::array* const list = node.as_array();
  Points::Point out{};
  bool good = list != nullptr && list->size() == out.size();
  for (std::size_t i = 0; good && i < out.size(); ++i) {
    const auto v = (*list)[i].value<double>();
    good = v && std::isfinite(*v);
    if (good) out[i] = *v;
  }
  if (!good) refuse_at(place(node, file), "a point is two finite numbers: NAME = [0.05, 0.2]");
  return out;
}

}  // namespace

Points::Points(std::string file, link::Space space) : file_(std::move(file)), space_(space) {
  if (!std::filesystem::exists(file_)) return;
  const toml::table root = parse_scene_file(file_, {});
  const std::string own = spaces[static_cast<std::size_t>(space_)];
  if (root["space"].value_or(std::string{}) != own)
    refuse_at(file_, "space must be \"{}\", as the reference of the scene has it", own);
  for (const auto& [key, node] : root) {
    if (key.str() != "space" && (key.str() != "points" || !node.is_table()))
      refuse_at(place(node, file_), "unknown key '{}'; allowed are space and [points]", printable(key.str()));
  }
  if (const toml::table* list = root["points"].as_table()) {
    for (const auto& [key, node] : *list) {
      const std::string name(key.str());
      if (!good_name(name)) refuse_at(place(node, file_), "'{}' is no name of a point", printable(name));
      points_[name] = point_of(node, file_);
    }
  }
}

void Points::teach(const std::string& name, const Point& at) {
  if (!good_name(name))
    refuse_at("", "'{}' is no name of a point: 1 to {} letters, digits, _ and -, a letter first",
              printable(name), name_max);
  if (points_.size() >= points_max) refuse_at(file_, "has {} points already", points_max);
  auto next = points_;
  next[name] = at;
  toml::table list;
  for (const auto& [n, p] : next) list.insert(n, toml::array{p[0], p[1]});
  print_or_write(
      toml_text(toml::table{{"space", spaces[static_cast<std::size_t>(space_)]}, {"points", list}}), file_);
  points_ = std::move(next);
}

const Points::Point& Points::at(const std::string& name) const {
  if (const auto found = points_.find(name); found != points_.end()) return found->second;
  std::string known;
  for (const auto& [n, p] : points_) known += (known.empty() ? "" : ", ") + n;
  refuse_at("", "there is no point '{}' in {}; taught are: {}", printable(name), file_,
            known.empty() ? "none" : known);
}

}  // namespace esmc::host
