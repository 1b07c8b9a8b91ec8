#pragma once
/// A TOML table as text that reads back to the same values, with numbers as short as that allows (0.35, not
/// 0.34999999999999998 as toml++ prints it).

#include <toml++/toml.h>
#include <string>

namespace esmc::host {

std::string toml_text(const toml::table& root);

}  // namespace esmc::host
