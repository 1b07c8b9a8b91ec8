#pragma once
/// The program of a scene as the table that its controller follows.

#include <memory>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/plan/plan.hpp"

namespace esmc::host {

/// Problem of planning a program: masses and lengths of the controller's model, friction and payload of the
/// scene's effects (without such effects the model's friction), the limits of controller, drives and moves
/// and, with [uncertainty], a reserve of torque for the worst plant. The scene has a program.
template <class M>
plan::Problem<M> program_problem(const Scene& scene);

/// The plan of a scene's program, computed once. Throws InputError naming the move where it cannot be driven.
std::shared_ptr<const plan::Plan> planned_program(const Scene& scene);
/// The plan of a problem, computed at each call. Throws InputError like planned_program().
template <class M>
plan::Plan planned(const plan::Problem<M>& p);

}  // namespace esmc::host
