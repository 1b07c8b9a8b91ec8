#pragma once
/// Reading eval cases: typed access to JSON that fails with a sentence, and writing vectors and matrices
/// back.

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "host_sim/error.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

/// One object of the input with the place to name in errors ("FILE:LINE: case 'id': state").
class Node {
 public:
  Node(const Json& value, std::string where, std::string path)
      : value_(&value), where_(std::move(where)), path_(std::move(path)) {}

  [[nodiscard]] bool has(const char* key) const { return value_->is_object() && value_->contains(key); }
  [[nodiscard]] Node at(const char* key) const {
    if (!has(key)) fail(std::string("missing key '") + name(key) + "'");
    return {(*value_)[key], where_, name(key)};
  }
  [[nodiscard]] Node at(std::size_t i) const {
    if (!value_->is_array() || i >= value_->size())
      fail("'" + path_ + "' must be an array with more entries");
    return {(*value_)[i], where_, path_ + "[" + std::to_string(i) + "]"};
  }
  [[nodiscard]] std::size_t size() const { return value_->is_array() ? value_->size() : 0; }
  template <class S>
  [[nodiscard]] S number() const {
    if (!value_->is_number()) fail("'" + path_ + "' must be a number");
    const auto v = static_cast<S>(value_->get<double>());
    if (!std::isfinite(v)) fail("'" + path_ + "' must be finite");
    return v;
  }
  template <class S>
  [[nodiscard]] S number(const char* key) const {
    return at(key).number<S>();
  }
  template <class S, int N>
  [[nodiscard]] Eigen::Matrix<S, N, 1> vector(const char* key) const {
    const Node list = at(key);
    if (list.size() != N) list.fail("'" + list.path_ + "' must have " + std::to_string(N) + " entries");
    Eigen::Matrix<S, N, 1> out;
    for (int i = 0; i < N; ++i) out[i] = list.at(static_cast<std::size_t>(i)).template number<S>();
    return out;
  }
  [[nodiscard]] std::string text(const char* key) const {
    const Node v = at(key);
    if (!v.value_->is_string()) v.fail("'" + v.path_ + "' must be a string");
    return v.value_->get<std::string>();
  }
  /// +1 or -1.
  [[nodiscard]] int sign() const {
    const auto v = number<double>();
    if (v != 1.0 && v != -1.0) fail("'" + path_ + "' must be 1 or -1");
    return v > 0 ? 1 : -1;
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(where_, what); }

 private:
  [[nodiscard]] std::string name(const char* key) const { return path_.empty() ? key : path_ + "." + key; }
  const Json* value_;
  std::string where_, path_;
};

template <class Derived>
Json to_json_array(const Eigen::MatrixBase<Derived>& m) {
  Json out = Json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    if constexpr (Derived::ColsAtCompileTime == 1) {
      out.push_back(m(i, 0));
    } else {
      Json row = Json::array();
      for (Eigen::Index k = 0; k < m.cols(); ++k) row.push_back(m(i, k));
      out.push_back(std::move(row));
    }
  }
  return out;
}

}  // namespace esmc::host
