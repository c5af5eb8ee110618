// The one list of what a world's state is: fields(archive, struct) for every struct with state.
//
// Saving, restoring, checking before a restore, hashing and the roll-back of a failed step all go
// through it. Each function takes its struct apart by a structured binding with ALL its members, so
// that a member added to a struct does not compile until somebody has said here what it is:
//
//   a(...)        state: what the next step reads before it writes it, and what users read out
//   a.same(...)   structure: a state can only be restored where it is equal
//   a.scratch(...) written in every step before it is read, or made from the rest
#pragma once
#include "archive.h"
#include "world.h"

namespace bt {

template <class A>
void same_fields(A& a, Law& law) {
  auto& [exponent, toe_strain, tension_only, damping_exponent, whole_velocity] = law;
  a.same(exponent, toe_strain, tension_only, damping_exponent, whole_velocity);
}

template <class A>
void same_fields(A& a, Material& material) {
  auto& [law, stiffness, damping, shear_stiffness, bending_stiffness, linear_density] = material;
  a.same(law, stiffness, damping, shear_stiffness, bending_stiffness, linear_density);
}

template <class A>
void same_fields(A& a, Shape& shape) {
  auto& [link, local, lo, hi, half_space, plane_normal, plane_offset, friction, surface, primitive] = shape;
  a.same(link, local, lo, hi, half_space, plane_normal, plane_offset, friction);
  a.same(primitive.kind, primitive.half, primitive.growth, primitive.radius, primitive.half_length);
  uint64_t mark = surface ? surface->mark() : 0;
  a.same(mark);
}

template <class A>
void same_fields(A& a, Tunnel& tunnel) {
  auto& [link, start, end, radius, chamfer, friction] = tunnel;
  a.same(link, start, end, radius, chamfer, friction);
}

template <class A>
void fields(A& a, Hold& hold) {
  auto& [id, particle, link, local, rigid, moves, clamped, direction, stiffness, goal, aim, target_before,
         target, viscosity, force, mean_force, mean_torque, kept_force, sum_force, step_force] = hold;
  a(id, particle, link, local, rigid, moves, clamped, direction, stiffness, goal, aim, target_before, target,
    viscosity, force, mean_force, kept_force, sum_force, step_force);
  a.scratch(mean_torque);
}

template <class A>
void fields(A& a, SpringSet& set) {
  auto& [reach, count, rest, stiffness, damping, inverse_rest, carried, elastic, lighter, start, before,
         history, length, force, slope, true_elastic, linear, elastic_slope, damping_slope, stiffness_now,
         direction, block, vector, damped, whole_position, whole_anchor] = set;
  a.same(reach, count, damped);
  // The slope of the last step is what contacts take their stiffness from.
  a(rest, stiffness, damping, carried, elastic, lighter, start, before, history, slope);
  a.scratch(inverse_rest, length, force, true_elastic, linear, elastic_slope, damping_slope, stiffness_now,
            direction, block, vector, whole_position, whole_anchor);
  if (a.applies())
    for (int k = 0; k < count; ++k) inverse_rest[k] = 1 / rest[k];
}

template <class A>
void fields(A& a, Chain& chain) {
  auto& [radius, friction, material, x, v, force, mass, point_mass, rest, scale, structure, shear, holds,
         overlaid, tunnel_of, x_before, v_before, acceleration,
         dt_before, smooth, quiet, bed, touching, touched, b, turn, foreseen, slack, most_slack, rest_set,
         kept, kept_smooth, start_x, start_v, start, start_x_before, start_v_before, start_dt_before, split,
         gathered, braked, next_tail, goal_tail, next, step, residual, anchor_x, anchor_v, goal, cg_remainder,
         cg_preconditioned, cg_direction, cg_image, column, solved, matrix, factor, inverse_blocks,
         residual_norm, worst_particle, n] = chain;
  a.same(n, radius, friction, material);
  a(x, v, force, mass, point_mass, rest, scale, structure, shear, holds, overlaid, tunnel_of);
  a(x_before, v_before, acceleration, dt_before, smooth, quiet, bed, touching, touched, split,
    gathered);
  a.scratch(b, turn, foreseen, slack, most_slack, rest_set, kept, kept_smooth,
            start_x, start_v, start, start_x_before, start_v_before, start_dt_before, braked, next_tail,
            goal_tail, next, step, residual, anchor_x, anchor_v, goal, cg_remainder, cg_preconditioned,
            cg_direction, cg_image, column, solved, matrix, factor, inverse_blocks, residual_norm,
            worst_particle);
}

template <class A>
void fields(A& a, Observer& observer) {
  auto& [n, root, effective_root, share, share_root, rates, forces, push, missed, noted, last, before, dt,
         samples, known, acted, held, released, now, s, e, one, other, turned, vectors] = observer;
  a(n, root, effective_root, share, share_root, rates, forces, push, last.forces, last.acceleration, last.cut,
    before.forces, before.acceleration, before.cut, dt, samples, known, acted, held, released, noted);
  a.scratch(missed, now, s, e, one, other, turned, vectors);
}

template <class A>
void fields(A& a, Stop& stop) {
  auto& [wanted, missing, held_back, coordinate, acts] = stop;
  a(wanted, missing, held_back, coordinate, acts);
}

template <class A>
void fields(A& a, Mover& mover) {
  auto& [rates, free, falls, gyration, limits, contacts, contacts_at, rests_on, contacts_kept, observer, root,
         change, forces, turns, torque, pull, unknown, freedom, basis, y, step, residual, gathered, first,
         lever, stopped_by, stops, directions, pushes, unstopped, pushed, doubted, rested, slipped, known,
         half, direction, through, within, within_acting, within_root, missing, given, along] = mover;
  // What is told before every step is state where a step may be taken back to (before_movers_).
  a(rates, free, falls, gyration, limits, contacts, contacts_at, rests_on, contacts_kept, observer, root,
    change, turns, unknown, stopped_by, stops, directions, pushes, unstopped, pushed, doubted, rested,
    slipped);
  a.scratch(torque, pull, freedom, basis, forces, y, step, residual, gathered, first, lever, known, half,
            direction, through, within, within_acting, within_root, missing, given, along);
}

template <class A>
void fields(A& a, Link& link) {
  auto& [pose, centre, start_pose, start_centre, now_velocity, now_spin, velocity, spin, mover, yielded,
         moved, jacobian, root, touches, touching, force, torque, before_force, before_torque, reached, given,
         stepped, load, turned] = link;
  // As with movers.
  a(pose, centre, start_pose, start_centre, now_velocity, now_spin, velocity, spin, mover, yielded, moved,
    jacobian, root, touches, touching, force, torque);
  a.scratch(before_force, before_torque, reached, given, stepped, load, turned);
}

template <class A>
void fields(A& a, Plane& plane) {
  auto& [point, normal, u, hole] = plane;
  a(point, normal, u, hole);
}

template <class A>
void fields(A& a, Entry& entry) {
  auto& [known, inside, wanted, distance, clearance, motion, reach, age, asked, now, first, second, listed,
         nearby] = entry;
  a(known, inside, distance, clearance, age, asked, first, second, listed);
  a.scratch(wanted, motion, reach, now, nearby);
  if (a.applies()) nearby.clear();  // it is made again from where it was made
}

template <class A>
void fields(A& a, ContactMemory& memory) {
  auto& [key, carried, confirmed, sliding, mean_force, b, stuck] = memory;
  a(key, carried, confirmed, sliding, mean_force, b, stuck);
}

// Rows are of the last step, and only read out after it; what sleeps goes on pushing at links.
template <class A>
void fields(A& a, Row& row) {
  auto& [key, kind, spot, other, link, moves, arm, normal, offset, allowed, beyond, axis_point, axis, ring,
         through, radius, stiffness, softest, grip, carried, before, multiplier, friction, stuck, reference,
         stuck_at, stuck_at_other, side, follows, stays, limit, direct, held, joins, passes, pressed, sliding,
         kept_multiplier, kept_sliding, changes, gap, normal_force, raw, displacement, tangent_force,
         total_force, linear_force, last_mean, mean_force, slid, block, levers, lever, lever_share] = row;
  a(key, kind, spot, other, link, normal, beyond, gap, normal_force, tangent_force, mean_force);
  a.scratch(moves, arm, offset, allowed, axis_point, axis, ring, through, radius, stiffness, softest, grip,
            carried, before, multiplier, friction, stuck, reference, stuck_at, stuck_at_other, side, follows,
            stays, limit, direct, held, joins, passes, pressed, sliding, kept_multiplier, kept_sliding,
            changes, raw, displacement, total_force, linear_force, last_mean, slid, block, levers, lever,
            lever_share);
}

template <class A>
void fields(A& a, Spot& spot) {
  auto& [chain, first, w0, w1] = spot;
  a(chain, first, w0, w1);
}

// What a step changes, but for planes and rows, which it keeps aside itself (World::begin).
template <class A>
void World::moving_fields(A& a) {
  size_t count = chains.size();
  a.same(count);
  for (auto& c : chains) {
    bool there = c != nullptr;
    a.same(there);
    if (there) fields(a, *c);
  }
  a(links, movers, memory_, whole_dt_, way_back_, asleep_rows_, rest_gravity_);
  if (a.applies()) broad_phase_.clear();  // what it finds does not depend on what it has kept
}

template <class A>
void World::all_fields(A& a) {
  auto& [options_, chains_, links_, movers_, shapes_, tunnels_, shape_alive_, tunnel_alive_, context,
         whole_dt, whole, done, size, parts, looks, room, looking, stray, unsettled, settlings, backup,
         backup_memory, way_back, before_links, before_movers, slots, caches, queries, finder, pairs, touches,
         rows, found, before, asleep_rows, rest_gravity, restful, restless, reach, keys, memory, touching,
         bores, bores_by_link, groups, group_of, report, attempt, kept_moving, kept_before, kept_links,
         kept_movers, begun, told_contacts, kept_entries, kept_rows] = *this;
  moving_fields(a);
  // Done by it.
  a.scratch(chains_, links_, movers_, memory, whole_dt, way_back, asleep_rows, rest_gravity);
  // The start of the last step, which keep() and begin() put aside themselves.
  std::vector<char> none;
  a(way_back ? kept_moving : none, before_links, before_movers);
  a.same(shape_alive_, shapes_, tunnel_alive_, tunnels_);
  for (auto& of_chain : caches)
    for (NearCache& cache : of_chain) {
      auto& [entries, local, motion] = cache;
      a(entries);
      a.scratch(local, motion);
    }
  a(rows);
  // Options are the user's, as they are now.
  a.scratch(options_, context, whole, done, size, parts, looks, room, looking, stray, unsettled, settlings,
            backup, backup_memory, slots, queries, finder, pairs, touches, found, before, restful, restless,
            reach, keys, touching, bores, bores_by_link, groups, group_of, report, attempt, kept_before,
            kept_links, kept_movers, begun, told_contacts, kept_entries, kept_rows);
}

}  // namespace bt
