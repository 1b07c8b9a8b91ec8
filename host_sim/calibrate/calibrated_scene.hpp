#pragma once
/// A scene with the values of a calibration.

#include <string>
#include <vector>

#include "host_sim/calibrate/geometry.hpp"
#include "host_sim/record/recording.hpp"

namespace esmc::host {

/// TOML to paste: [mechanism] and the corrected offsets, and nothing else.
std::string calibrated_snippet(const Scene& scene, const Unknowns& value);
/// The whole scene of a run with these values; factors of control.model on lengths are gone. Throws
/// InputError where it is not possible.
std::string calibrated_scene(const RecordedRun& run, const Unknowns& value);
/// Throws InputError when `file` is one of the inputs.
void refuse_overwrite(const std::string& file, const std::vector<std::string>& inputs);

}  // namespace esmc::host
