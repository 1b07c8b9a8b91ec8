#include "host_sim/operate/fault_values.hpp"

#include <nlohmann/json.hpp>

#include "host_sim/record/fault_record.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

nlohmann::ordered_json fault_values(Fault fault, const ControllerNews& news, const Scene& scene) {
  auto values = nlohmann::ordered_json::object();
  const std::size_t second = news.joint[3] ? 2 : 1;  // with four motors the third is the other base joint
  if (!news.joint[0] || !news.joint[second]) return values;
  Scene of_base_joints = scene;  // the angles of passive joints are not sent
  of_base_joints.all_sensors = false;
  with_world(scene, [&]<class Traits>(Traits) {
    using M = typename Traits::Mechanism;
    Sample<M> sample;
    sample.angle[0] = static_cast<double>((*news.joint[0])[0]);
    sample.angle[M::joints / 2] = static_cast<double>((*news.joint[second])[0]);
    TickResult<M> result;
    result.fault = fault;
    FaultFinder<Traits> finder(of_base_joints);
    finder.see(result, sample);
    if (const auto& found = finder.found(); found && found->measured && found->limit)
      values = {{"where", found->where},
                {"measured", *found->measured},
                {"limit", *found->limit},
                {"unit", found->unit}};
  });
  return values;
}

}  // namespace esmc::host
