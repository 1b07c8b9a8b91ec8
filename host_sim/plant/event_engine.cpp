// The engines of event_driven. A file of their own: their many uses of a plant must not change how the
// compiler treats the others.

#include "host_sim/error.hpp"
#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "host_sim/plant/engine.hpp"
#include "host_sim/plant/event_driven.hpp"

namespace esmc::host {
namespace {

/// Radau of fixed steps; where Newton's iteration fails, the step is divided.
template <class Sys>
class DividingRadau5 : public Radau5<Sys> {
 public:
  using Radau5<Sys>::Radau5;
  using State = typename Sys::State;
  /// Throws Diverged where no part of the step can be solved for.
  void step(double t, double h, State& y) {
    constexpr int most = 4096;
    const State before = y;
    for (int parts = 1; parts <= most; parts *= 4) {
      y = before;
      for (int i = 0; i < parts && finite(y); ++i) Radau5<Sys>::step(t + i * h / parts, h / parts, y);
      if (finite(y)) return;
    }
    if (!finite(before)) return;
    if (!finite(this->first_)) return;  // not the solver's failure: the state itself runs away
    throw Diverged(fmt::format(
        "radau5 cannot solve its equations at t = {:.6g} s, not even with steps of {:.2g} s: a smaller "
        "simulation.step, another integrator, or simulation.accuracy",
        t, h / most));
  }

 private:
  [[nodiscard]] bool finite(const State& y) const { return all_finite(this->size(), y); }
};

}  // namespace

template <class Plant>
std::unique_ptr<Engine<Plant>> make_event_engine(const Plant& plant, std::unique_ptr<Attachments> attached,
                                                 const std::vector<Effect>& effects, const Resolution& r,
                                                 const typename Plant::State& initial) {
  using Sys = EventSystem<Plant>;
  const auto with = [&]<class Inner>() -> std::unique_ptr<Engine<Plant>> {
    return std::make_unique<EventEngine<Plant, Inner>>(plant, std::move(attached), effects, r, initial);
  };
  switch (r.between) {
    case Between::semi_implicit_euler:
    case Between::midpoint:
      return with.template operator()<ChainedStages<Sys, 2>>();
    case Between::heun3:
      return with.template operator()<ChainedStages<Sys, 3>>();
    case Between::dopri5:
      return with.template operator()<Dopri5<Sys>>();
    case Between::dopri8:
      return with.template operator()<Dopri8<Sys>>();
    case Between::radau5:
      return with.template operator()<Radau5<Sys>>();
    case Between::rk4:
      break;
  }
  return with.template operator()<Rk4<Sys>>();
}

template <class Plant, class Sys>
std::unique_ptr<Engine<Plant>> make_radau_engine(const Plant& plant, std::unique_ptr<Attachments> attached,
                                                 const typename Plant::State& initial) {
  using Stepper = DividingRadau5<Sys>;
  return std::make_unique<EngineOf<Plant, Sys, Stepper>>(plant, std::move(attached), Method::radau5, initial,
                                                         [](const Sys& s) { return Stepper(s); });
}

#define ESMC_RADAU(Plant, Sys)                                                  \
  template std::unique_ptr<Engine<Plant>> make_radau_engine<Plant, Sys<Plant>>( \
      const Plant&, std::unique_ptr<Attachments>, const Plant::State&)
ESMC_RADAU(FiveBarPlant, BareSystem);
ESMC_RADAU(FiveBarPlant, LoadedSystem);
ESMC_RADAU(RrPlant, BareSystem);
ESMC_RADAU(RrPlant, LoadedSystem);
#undef ESMC_RADAU
template std::unique_ptr<Engine<FiveBarPlant>> make_event_engine(const FiveBarPlant&,
                                                                 std::unique_ptr<Attachments>,
                                                                 const std::vector<Effect>&,
                                                                 const Resolution&,
                                                                 const FiveBarPlant::State&);
template std::unique_ptr<Engine<RrPlant>> make_event_engine(const RrPlant&, std::unique_ptr<Attachments>,
                                                            const std::vector<Effect>&, const Resolution&,
                                                            const RrPlant::State&);

}  // namespace esmc::host
