#pragma once
/// Edits of a scene file by commands that write values which they have computed.

#include <toml++/toml.h>

#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// An inline table with the keys of a leg.
toml::table leg_table(const LegParams<double>& leg);
/// A TOML array of these numbers.
toml::array number_array(const std::vector<double>& values);
/// The sub-table `name`, created if it is not there.
toml::table& sub_table(toml::table& of, const std::string& name);
/// Writes rotor_inertia (kg m2 at the joint) of [mechanism]: 0 for the base joints, whose rotors J1 contains,
/// and p's rotor2 for the elbows. Removes the key if p has no elbow rotors.
void set_elbow_rotors(toml::table& mechanism, MechanismType type, const FiveBarParams<double>& p);
/// Sets half_base (five-bar) and the legs, and with `masses` the effector's mass, gravity and the elbows'
/// rotors, of a [mechanism].
void set_mechanism(toml::table& mechanism, MechanismType type, const FiveBarParams<double>& p, bool masses);

/// The text of `scene`, read from `file`, for another folder: files that it names get absolute paths. Throws
/// InputError where it cannot be read back as a scene.
std::string edited_scene(toml::table scene, const std::string& file);
/// Throws InputError when `file`, which `option` names for writing, is one of the inputs.
void refuse_overwrite(const std::string& option, const std::string& file,
                      const std::vector<std::string>& inputs);
/// The files that a scene was read from: its own, and those that it names.
std::vector<std::string> files_of(const Scene& scene);

}  // namespace esmc::host
